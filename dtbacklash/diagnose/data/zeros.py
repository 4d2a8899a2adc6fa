"""Zeros of position sensors: a machine that is turned on at another place counts its positions from there.

The first recording has the zeros of the rig. Every further one has its own, wherever a recording shows it: a free body
begins where it is measured, so that no zero matters to it (:func:`.pull.zero_channels`). An own zero is taken off
twice: here from the readings, as far as the nominal rig knows it, so that springs to the ground and first states are
where they belong; and in each comparison of a model as a constant without a prior (:meth:`.Evidence.without_zeros`).
"""

from dataclasses import replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, Record, longest_step_s, residual
from dtbacklash.diagnose.data.evidence import by_recording
from dtbacklash.diagnose.data.pull import cut, zero_channels
from dtbacklash.diagnose.data.tempo import tempo_rad_s
from dtbacklash.physics.rig import Rig

#: a zero counts as shown if taking off the mean residual leaves less than this share of it
LEFT = 0.5
#: how often what is then left is taken off as well: a zero also changes where the simulation begins
TIMES = 2


def aligned(rig: Rig, records: list[Record]) -> list[Record]:
    """The records with the positions of those that have own zeros counted from the zeros of the first recording.

    Of both the mean residual of the nominal rig is the zero; their difference is taken off. What the rig lacks and
    what is the same in both so stays.
    """
    if not any(r.own_zero for r in records):
        return records
    step, channels = longest_step_s(records), tuple(n for n in rig.sensors if all(n in r.y for r in records))
    recordings = by_recording(records)
    for block in cut(rig, channels, step, tempo_rad_s(rig, records)):
        names = zero_channels(rig, block, step)
        if names:
            first = _zero(rig, block, recordings[0], names)
            recordings = [
                [_counted_from(r, names, _zero(rig, block, own, names) - first) for r in own] if own[0].own_zero
                else own for own in recordings
            ]  # fmt: skip
    moved = {(r.recording, r.from_s): r for own in recordings for r in own}
    return [moved[r.recording, r.from_s] for r in records]


def _zero(rig: Rig, block: Block, records: list[Record], names: tuple[str, ...]) -> Floats:
    """(names,) what has to be taken off a recording for the mean residual to vanish; 0 where nothing makes it."""

    def left(zero: Floats) -> Floats:
        return _mean(rig, block, [_counted_from(r, names, zero) for r in records], names)

    zero = first = left(np.zeros(len(names)))
    shown = np.ones(len(names), dtype=bool)
    for _ in range(TIMES):
        more = left(zero)
        shown &= np.abs(more) <= LEFT * np.abs(first)
        zero = np.where(shown, zero + more, 0.0)
    return zero


def _mean(rig: Rig, block: Block, records: list[Record], names: tuple[str, ...]) -> Floats:
    """(names,) mean residual of what is used of a recording; 0 where it does not stay finite."""
    columns = [block.channels.index(n) for n in names]
    with np.errstate(over="ignore", invalid="ignore"):
        each = [residual(rig, block, r, "coarse")[r.used][:, columns] for r in records]
        mean: Floats = np.concatenate(each).mean(axis=0) if sum(map(len, each)) else np.zeros(len(names))
    return np.nan_to_num(mean, nan=0.0, posinf=0.0, neginf=0.0)


def _counted_from(record: Record, names: tuple[str, ...], zero: Floats) -> Record:
    """A record with its positions counted from other zeros."""
    off = dict(zip(names, zero.tolist(), strict=True))
    return replace(
        record, y=record.y | {n: record.y[n] - by for n, by in off.items()},
        zero=record.zero | {n: record.zero.get(n, 0.0) + by for n, by in off.items()},
    )  # fmt: skip
