"""Start values of a sensor's delay, by shifting the model's prediction on a grid, without a simulation."""

import numpy as np

from dtbacklash.diagnose.data.candidates import Candidate
from dtbacklash.diagnose.data.compare import Block, usual_step_s
from dtbacklash.diagnose.propose.projection import Projection
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.rig import SENSOR_PREFIX

#: delays are tried as finely: a fit has a valley each sample (samples)
DELAY_STEP_SAMPLES = 0.5


def delay_grid(candidate: Candidate, projection: Projection) -> list[Values]:
    """The best few start values of a sensor's delay; empty for another candidate."""
    step = DELAY_STEP_SAMPLES
    channel = candidate.place.removeprefix(SENSOR_PREFIX)
    block = next((b for b in projection.evidence.blocks if channel in b.channels), None)
    if not candidate.effect.is_delay or candidate.place == channel or block is None:
        return []
    shifts = np.arange(step, SETTINGS.delay_reach_samples + step, step)
    left = np.array([_sum_of_squares(projection, block, channel, shift) for shift in shifts])
    low = np.r_[np.inf, left, np.inf]
    valleys = np.flatnonzero((left <= low[:-2]) & (left <= low[2:]))
    best = valleys[np.argsort(left[valleys])][: SETTINGS.scanned_starts]
    sample, size = usual_step_s(projection.evidence.records), candidate.effect.size
    return [{size.name: float(min(shifts[k] * sample, size.high))} for k in best]


def _sum_of_squares(projection: Projection, block: Block, channel: str, shift: float) -> float:
    """Sum of a channel's squared training residuals with its prediction ``shift`` samples of the usual rate later."""
    column, total = block.channels.index(channel), 0.0
    floor, step = projection.evidence.floor[block.name][column], usual_step_s(projection.evidence.records)
    for record, residuals in zip(projection.evidence.records, projection.fitted.residuals[block.name], strict=True):
        at = np.arange(record.samples)
        measured = record.y[channel]
        shown = measured - residuals[:, column] * floor
        late = np.interp(at - shift * (step / record.sample_time_s), at, shown)
        total += float(np.sum((measured - late)[record.train] ** 2))
    return total
