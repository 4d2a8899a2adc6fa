"""Three parts of the recordings: one is fitted to, one chooses the structure, and one judges, once and at the end.

The part that chose among fifty candidates flatters its choice. So nothing sees the last part until everything has been
chosen; before it judges, the structure is fitted anew to the other two parts.
"""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnose.data.compare import Record, longest_step_s
from dtbacklash.diagnose.data.evidence import Evidence, by_recording, stretch_of
from dtbacklash.diagnose.fit.free import all_free
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import ON, fit
from dtbacklash.diagnose.search.model import Model
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.errors import UserError

#: what chooses at a turn lasts so long at least: what is near what was fitted to flatters (stretches)
TURN_STRETCHES = 3

#: of fewer samples no mean square says anything
PART_SAMPLES_MIN = 10


def marked(records: list[Record]) -> list[Record]:
    """The recordings with the last of what is held out of each marked: it judges."""
    return [r for own in by_recording(records) for r in _marked(own)]


def _marked(records: list[Record]) -> list[Record]:
    held = np.concatenate([r.held for r in records])
    at = np.flatnonzero(held)
    last = np.zeros(len(held), dtype=bool)
    last[at[len(at) - round(SETTINGS.judging_share * len(at)) :]] = True
    parts = np.split(last, np.cumsum([r.samples for r in records])[:-1])
    return [replace(r, judge=judge) for r, judge in zip(records, parts, strict=True)]


def check_parts(records: list[Record], given: tuple[str, object]) -> None:
    """Refuse recordings of which too little is fitted to, chooses or judges.

    given : key and value of what the user chose the parts by.

    Raises
    ------
    UserError : with that key.
    """
    parts = marked(records)
    counts = {
        "to fit to": sum(int(r.train.sum()) for r in parts),
        "to choose by": sum(int((r.held & ~r.judge).sum()) for r in parts),
        "to judge on": sum(int(r.judge.sum()) for r in parts),
    }
    least = min(counts, key=lambda part: counts[part])
    if counts[least] < PART_SAMPLES_MIN:
        raise UserError(*given, f"leaves {counts[least]} samples {least}, and at least {PART_SAMPLES_MIN} are needed")


def divided(records: list[Record]) -> list[Record]:
    """The recordings with the last of the held-out data kept for judging, and the rest interleaved with the fit's.

    Stretches to fit and to choose by take turns: a limit that only one of them reached could not be fitted and chosen.
    """
    kept = [replace(r, held=r.held & ~r.judge) for r in marked(records)]
    least = TURN_STRETCHES * stretch_of(kept)
    taking_turns: list[Record] = []
    for own in by_recording(kept):
        shortest = least * round(longest_step_s(kept) / own[0].sample_time_s)
        turns = sum(int(r.held.sum()) for r in own) // shortest
        taking_turns += [_by_turns(r, int(np.clip(turns, 1, SETTINGS.turns_max))) for r in own]
    return taking_turns


def _by_turns(record: Record, turns: int) -> Record:
    """A record with as many samples that train and as many that are held out, by turns."""
    at = np.flatnonzero(record.used)
    count = int(record.held.sum())
    if turns == 1 or count in (0, len(at)):
        return record
    held = np.zeros(record.samples, dtype=bool)
    held[at[np.arange(len(at)) * turns % len(at) >= len(at) - count]] = True
    return replace(record, train=record.used & ~held, held=held)


def judging(evidence: Evidence) -> Evidence:
    """The same with only what judges held out; itself where nothing is marked to judge."""
    if not any(r.judge.any() for r in evidence.records):
        return evidence
    return replace(evidence, records=[replace(r, held=r.judge) for r in evidence.records])


def for_judgement(evidence: Evidence) -> Evidence:
    """The same with all that fitted or chose to be fitted to, and what judges held out."""
    records = [replace(r, train=r.used, held=r.judge, judge=np.zeros_like(r.judge)) for r in evidence.records]
    return replace(evidence, records=records, stretch=stretch_of(records))


def refitted(model: Model, evidence: Evidence) -> Model:
    """The model fitted anew to another part of the recordings, from where its last fits ended."""

    def again(before: Fit) -> Fit:
        return fit(evidence, before.rig, *all_free(evidence, before.rig), rounds=ON)

    nominal = again(model.nominal)
    fitted = again(model.fitted) if model.named else nominal
    return replace(model, evidence=evidence, nominal=nominal, fitted=fitted)
