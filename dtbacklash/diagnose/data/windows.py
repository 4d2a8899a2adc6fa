"""The windows of a long recording that the search uses, spread over its training and its held-out part.

The search makes hundreds of simulations and hardly needs more samples; the last fit and the judgement use all.
"""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnose.data.candidates import PlacesInMotion
from dtbacklash.diagnose.data.command import held_equivalent
from dtbacklash.diagnose.data.compare import Record
from dtbacklash.diagnose.data.evidence import Evidence, by_recording, stretch_of
from dtbacklash.diagnose.data.in_motion import with_start
from dtbacklash.diagnose.data.records import slowest_decay_of
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.channels import runs

#: so many windows of what is fitted to, and of what chooses: what changes with time shows in several (windows)
SEARCH_WINDOWS = 4

#: a recording of fewer samples is used whole
CUT_FROM = 5000
#: a record, the first sample of a run in it, and the one after its last
Run = tuple[Record, int, int]


def portion(rig: Rig, records: list[Record]) -> list[Record]:
    """The records, or windows of them where they have more samples than a search needs; no mask may overlap."""
    counts = {part: sum(int(getattr(r, part).sum()) for r in records) for part in ("train", "held")}
    total = sum(counts.values())
    if total <= CUT_FROM:
        return records
    if total <= SETTINGS.search_samples_max:
        return [_without_judging_end(r) for r in records if r.train.any() or r.held.any()]
    shortest_s = SETTINGS.search_window_decays / slowest_decay_of(rig, records)
    chosen: list[Record] = []
    for part in counts:
        for together in by_recording(records):
            pieces = [(r, a, b) for r in together for a, b in runs(getattr(r, part))]
            budget = sum(b - a for _, a, b in pieces) * SETTINGS.search_samples_max // total
            if budget == 0:
                continue
            windows = int(np.clip(budget / (shortest_s / together[0].sample_time_s), 1, SEARCH_WINDOWS))
            chosen += _windows(pieces, windows, budget // windows, part == "train")
    return chosen


def _without_judging_end(record: Record) -> Record:
    """The record up to its last training or held-out sample."""
    end = int(np.flatnonzero(record.used)[-1]) + 1
    return record if end == record.samples else cut_off(record, 0, end)


def whole(evidence: Evidence, records: list[Record], smooth: bool) -> Evidence:
    """A search's evidence with all ``records`` instead of :func:`portion` of them, with its blocks and its floor.

    smooth : whether the command is smooth between its samples.
    """
    if sum(r.samples for r in evidence.records) == sum(r.samples for r in records):
        return evidence
    rig, blocks = evidence.nominal, evidence.blocks
    if smooth:
        records = [replace(r, u=held_equivalent(r.u)) for r in records]
    records = [with_start(rig, blocks, r) for r in records]
    return replace(evidence, records=records, stretch=stretch_of(records), moving=PlacesInMotion(rig, blocks, records))


def _windows(pieces: list[Run], count: int, samples: int, trains: bool) -> list[Record]:
    """``count`` windows of so many samples, spread evenly over the pieces; shorter than that at the end of a piece."""
    lengths = np.array([b - a for _, a, b in pieces])
    ends = np.cumsum(lengths)
    spare = int(ends[-1]) - samples
    windows = []
    for begin in np.linspace(0, max(spare, 0), count).astype(int):
        k = int(np.searchsorted(ends, begin, side="right"))
        record, a, b = pieces[k]
        at = a + int(begin - (ends[k] - lengths[k]))
        at = max(a, min(at, b - samples))
        window = cut_off(record, at, min(at + samples, b))
        train = np.full(window.samples, trains)
        windows.append(replace(window, train=train, held=~train))
    return windows


def cut_off(record: Record, a: int, b: int) -> Record:
    """Samples a to b of a record; how this part begins is not known yet."""
    return Record(
        record.sample_time_s, record.u[a:b], {c: v[a:b] for c, v in record.y.items()}, record.train[a:b],
        record.held[a:b], record.from_s + a * record.sample_time_s, judge=np.zeros(b - a, dtype=bool),
        recording=record.recording, own_zero=record.own_zero, zero=record.zero,
    )  # fmt: skip
