"""Delays: where a sensor's delay starts from, by shifting what the model predicts for it; no simulation is needed.

A delay longer than the signal's own correlation has a fit with many valleys: the grid is as fine as the samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.diagnose.compare import Block
from dtbacklash.physics.rig import SENSOR_PREFIX

if TYPE_CHECKING:
    from dtbacklash.diagnose.candidates import Candidate, Values
    from dtbacklash.diagnose.locate import Bank

#: delays are tried up to this many samples, in steps of STEP samples
REACH, STEP = 30.0, 0.5
#: of the best delays, as many are simulated
KEPT = 2


def delay_grid(candidate: Candidate, bank: Bank) -> list[Values]:
    """The best few starts of a sensor's delay, or nothing if the candidate is not one."""
    channel = candidate.place.removeprefix(SENSOR_PREFIX)
    block = next((b for b in bank.evidence.blocks if channel in b.channels), None)
    if candidate.effect.name != "delay" or candidate.place == channel or block is None:
        return []
    shifts = np.arange(STEP, REACH + STEP, STEP)
    left = np.array([_left(bank, block, channel, shift) for shift in shifts])
    low = np.r_[np.inf, left, np.inf]
    valleys = np.flatnonzero((left <= low[:-2]) & (left <= low[2:]))
    best = valleys[np.argsort(left[valleys])][:KEPT]
    step, size = bank.evidence.records[0].sample_time_s, candidate.effect.size
    return [{size.name: float(min(shifts[k] * step, size.high))} for k in best]


def _left(bank: Bank, block: Block, channel: str, shift: float) -> float:
    """Mean square of what is left of a channel when its prediction comes ``shift`` samples later."""
    column, total = block.channels.index(channel), 0.0
    floor = bank.evidence.floor[block.name][column]
    for record, residuals in zip(bank.evidence.records, bank.fitted.residuals[block.name], strict=True):
        at = np.arange(record.samples)
        measured = record.y[channel]
        shown = measured - residuals[:, column] * floor
        late = np.interp(at - shift, at, shown)
        total += float(np.sum((measured - late)[record.train] ** 2))
    return total
