"""What of a long recording the search looks at: a few windows, spread over what is fitted to and what chooses.

A search makes hundreds of simulations, and soon does not become surer of a name by more samples. The last fit and the
judgement take all.
"""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnose.data.candidates import PlacesInMotion
from dtbacklash.diagnose.data.command import held_equivalent
from dtbacklash.diagnose.data.compare import Record
from dtbacklash.diagnose.data.evidence import Evidence, stretch_of
from dtbacklash.diagnose.data.in_motion import begun
from dtbacklash.diagnose.data.records import slowest_decay_of
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.channels import runs

#: of fewer samples nothing is cut off: that would save no time, and all of them tell of the noise
CUT_FROM = 5000
#: of a record with a mask of what is looked for: first sample, and the one behind the last
Run = tuple[Record, int, int]


def portion(rig: Rig, records: list[Record]) -> list[Record]:
    """The records, or windows of them where they have more samples than a search needs.

    records : divided, so that no sample both trains and is held out.
    """
    rules = settings()
    counts = {part: sum(int(getattr(r, part).sum()) for r in records) for part in ("train", "held")}
    total = sum(counts.values())
    if total <= CUT_FROM:
        return records
    if total <= rules.search_samples_max:
        return [_looked_at(r) for r in records if r.train.any() or r.held.any()]
    shortest = rules.search_window_decays / slowest_decay_of(rig, records) / records[0].sample_time_s
    found: list[Record] = []
    for part, count in counts.items():
        budget = count * rules.search_samples_max // total
        windows = int(np.clip(budget / shortest, 1, rules.search_windows))
        found += _windows(
            [(r, a, b) for r in records for a, b in runs(getattr(r, part))], windows, budget // windows, part == "train"
        )
    return found


def _looked_at(record: Record) -> Record:
    """The record up to the last sample that is fitted to or chooses: the search has no use for what only judges."""
    end = int(np.flatnonzero(record.train | record.held)[-1]) + 1
    return record if end == record.samples else cut_off(record, 0, end)


def whole(evidence: Evidence, records: list[Record], smooth: bool) -> Evidence:
    """The evidence of a search about all records, with its blocks and its floor.

    records : what :func:`portion` was given; the evidence itself where that was all. smooth : how the command is read.
    """
    if sum(r.samples for r in evidence.records) == sum(r.samples for r in records):
        return evidence
    rig, blocks = evidence.nominal, evidence.blocks
    if smooth:
        records = [replace(r, u=held_equivalent(r.u)) for r in records]
    records = [begun(rig, blocks, r) for r in records]
    return replace(evidence, records=records, stretch=stretch_of(records), moving=PlacesInMotion(rig, blocks, records))


def _windows(pieces: list[Run], count: int, samples: int, trains: bool) -> list[Record]:
    """As many windows of so many samples, spread evenly over the pieces; at the end of a piece shorter."""
    lengths = np.array([b - a for _, a, b in pieces])
    ends = np.cumsum(lengths)
    spare = int(ends[-1]) - samples
    found = []
    for begin in np.linspace(0, max(spare, 0), count).astype(int):
        k = int(np.searchsorted(ends, begin, side="right"))
        record, a, b = pieces[k]
        at = a + int(begin - (ends[k] - lengths[k]))
        at = max(a, min(at, b - samples))
        found.append(_window(record, at, min(at + samples, b), trains))
    return found


def _window(record: Record, a: int, b: int, trains: bool) -> Record:
    none = np.zeros(b - a, dtype=bool)
    return replace(cut_off(record, a, b), train=~none if trains else none, held=none if trains else ~none)


def cut_off(record: Record, a: int, b: int) -> Record:
    """Samples a to b of a record that has not been looked at yet: how it begins is not known of it."""
    return Record(
        record.sample_time_s, record.u[a:b], {c: v[a:b] for c, v in record.y.items()}, record.train[a:b],
        record.held[a:b], record.from_s + a * record.sample_time_s, judge=np.zeros(b - a, dtype=bool),
    )  # fmt: skip
