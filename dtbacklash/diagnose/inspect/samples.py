"""Faults of samples and channels: spikes, clipping, nothing but noise, readings that repeat or hang."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.ndimage import median_filter
from scipy.signal import coherence

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.floor import quantum, sensor_noise, white_noise
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.recording.channels import clipped, runs

#: the median's window: most of it lies beside the longest spike (samples)
SPIKE_WINDOW_SAMPLES = 7
#: an encoder jitters by fewer counts than a spike has (counts)
SPIKE_COUNTS = 5.0
#: a spike is so much further off the cubic through its neighbours than usual; a turning point is not (ratio)
SPIKE_ROUGHNESS = 3.0
#: what is more frequent is a signal's own way and no spike (share of samples)
SPIKES_SHARE_MAX = 0.01
#: a signal jumps where its step is so much larger than the rms of its steps (ratio)
JUMP_RATIO = 3.0
#: so long after a jump of the command a current may answer like a spike (samples)
JUMP_ANSWER_SAMPLES = 20
#: a channel that changes more often at two samples in a row is read at every sample (share of changes)
HELD_TOGETHER_SHARE = 0.01
#: and one that changes by fewer counts may move slowly over them (counts)
HELD_COUNTS = 3.0
#: fewer equal readings are no pattern (samples)
HUNG_SAMPLES_MIN = 5
#: where readings repeat more often than this, a sensor's counts are coarse and it does not hang (share of samples)
HUNG_REPEATS_SHARE = 0.05
#: how seldom equal readings by chance may be taken for a sensor that hangs (probability)
HUNG_CHANCE = 1e-3
#: with fewer, noise is coherent by chance (stretches)
COHERENCE_STRETCHES_MIN = 16
#: how seldom noise alone may be taken for a signal (probability)
COHERENCE_CHANCE = 1e-3

#: the slope beside a gap is that of a parabola through as many samples
SLOPE_SAMPLES = 12


def spikes(values: Floats, u: Floats) -> np.ndarray:
    """(N,) the samples that stand alone, far off the median of their neighbours.

    A jump is no spike, and neither is what happens often (chatter, a torque ripple, the counts of an encoder), nor what
    follows a jump of the command ``u`` (N,) or the beginning: a current does. Of a signal that moves a spike shifts the
    medians of its neighbours too: it is one if none of them stands out once it is bridged.
    """
    away, free = _away(values), ~_after_jumps(u)
    # many spikes would pass for what is usual: that is asked where all that stand off furthest are bridged
    most = 1.0 - SPIKE_WINDOW_SAMPLES * SPIKES_SHARE_MAX
    bridge = np.zeros(len(values), dtype=bool)
    for start, stop in runs((away > _least(values, away, most)) & free):
        bridge[_furthest(away, start, stop)[: SETTINGS.spike_samples_max]] = True
    bare = _straight(values, bridge)
    least = _least(values, _away(bare), SETTINGS.spike_usual_share)
    bent = SPIKE_ROUGHNESS * float(np.quantile(_roughness(bare), SETTINGS.spike_usual_share))
    found = np.zeros(len(values), dtype=bool)
    for start, stop in runs((away > least) & free):
        found[_alone(values, _furthest(away, start, stop), least)] = True
    found &= _roughness(values) > bent
    return found if found.mean() <= SPIKES_SHARE_MAX else np.zeros(len(values), dtype=bool)


def _away(values: Floats) -> Floats:
    """(N,) how far each sample is off the median of its neighbours."""
    off: Floats = np.abs(values - median_filter(values, SPIKE_WINDOW_SAMPLES, mode="nearest"))
    return off


def _roughness(values: Floats) -> Floats:
    """(N,) how far each sample is off the cubic through its neighbours."""
    off: Floats = np.abs(np.convolve(np.pad(values, 2, "edge"), np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0, "valid"))
    return off


def _least(values: Floats, away: Floats, usual: float) -> float:
    """How far off its median a sample has to be: beyond what is usual (a quantile), an encoder's jitter, and noise."""
    counts = SPIKE_COUNTS * quantum(values)
    return max(SETTINGS.spike_ratio * float(np.quantile(away, usual)), counts, SETTINGS.spike_ratio * _noise(values))


def _furthest(away: Floats, start: int, stop: int) -> np.ndarray:
    """The samples from ``start`` to ``stop``, those that are furthest off first."""
    furthest: np.ndarray = start + np.argsort(-away[start:stop])
    return furthest


def _straight(values: Floats, missing: np.ndarray) -> Floats:
    """(N,) the values with straight lines over what is missing."""
    at = np.arange(len(values))
    return np.where(missing, np.interp(at, at[~missing], values[~missing]), values)


def _alone(values: Floats, furthest: np.ndarray, least: float) -> np.ndarray:
    """As few of the samples that are furthest off as leave none of them so far off once these are bridged; or none."""
    first = max(int(furthest.min()) - SPIKE_WINDOW_SAMPLES, 0)
    near = values[first : int(furthest.max()) + SPIKE_WINDOW_SAMPLES + 1]
    for count in range(1, SETTINGS.spike_samples_max + 1):
        missing = np.zeros(len(near), dtype=bool)
        missing[furthest[:count] - first] = True
        if np.all(_away(_straight(near, missing))[furthest - first] <= least):
            return furthest[:count]
    return furthest[:0]


def unwrapped(values: Floats) -> tuple[Floats, int]:
    """(N,) an angle, rad, without its jumps by a whole turn, and how many there were.

    A jump is one only if every step without it is below a quarter of a turn: else nothing is changed.
    """
    turned = int(np.sum(np.abs(np.diff(values)) > math.pi))
    straight = np.unwrap(values)
    if turned == 0 or np.abs(np.diff(straight)).max() > 0.5 * math.pi:
        return values, 0
    return straight, turned


def _after_jumps(u: Floats) -> np.ndarray:
    """(N,) the samples shortly after where the command jumps, and of the beginning."""
    steps = np.abs(np.diff(u, prepend=u[0]))
    jumps = steps > jump(steps)
    jumps[0] = True
    near: np.ndarray = np.convolve(jumps, np.ones(JUMP_ANSWER_SAMPLES), "full")[: len(u)] > 0.5
    return near


def jump(steps: Floats) -> float:
    """The size from which on a step from one sample to the next is a jump. steps : all of a signal."""
    return JUMP_RATIO * float(np.sqrt(np.mean(steps**2)))


def _noise(values: Floats) -> float:
    """Noise from sample to sample, robustly: the median step, as of a normal distribution."""
    return float(np.median(np.abs(np.diff(values, 2)))) / (0.6745 * math.sqrt(6.0))


def at_limits(values: Floats) -> np.ndarray:
    """(N,) the samples at which a sensor's range ends; none where only a few levels are ever taken."""
    found = np.zeros(len(values), dtype=bool)
    for _, mask in clipped(values):
        found |= mask
    return found


def bridged(values: Floats, missing: np.ndarray) -> Floats:
    """(N,) the values with each run of ``missing`` replaced by the cubic that leaves and meets the rest smoothly.

    It has the channel's noise and counts: the noise floor is read from all of it, quiet stretches would lower that.
    """
    found = np.array(values, dtype=float)
    good = np.flatnonzero(~missing)
    if len(good) < 2:
        return found
    for start, stop in runs(missing):
        before, after = good[good < start][-SLOPE_SAMPLES:], good[good >= stop][:SLOPE_SAMPLES]
        if not len(before) or not len(after):
            found[start:stop] = values[before[-1] if len(before) else after[0]]
            continue
        ends = [before[-1], after[0]]
        slopes = [_slope(before, values, before[-1]), _slope(after, values, after[0])]
        if stop - start <= SETTINGS.spike_samples_max:  # noise in the slopes would be more than what a line misses
            slopes = [(values[ends[1]] - values[ends[0]]) / (ends[1] - ends[0])] * 2
        found[start:stop] = CubicHermiteSpline(ends, values[ends], slopes)(np.arange(start, stop))
    count = quantum(values[~missing])
    found[missing] += _noise(values[~missing]) * np.random.default_rng(0).standard_normal(int(missing.sum()))
    if count > 0.0:
        found[missing] = count * np.round(found[missing] / count)
    return found


def _slope(at: np.ndarray, values: Floats, where: int) -> float:
    """Slope per sample at ``where`` of the parabola through the samples ``at``."""
    if len(at) < 2:
        return 0.0
    return float(np.polyfit(at - where, values[at], min(2, len(at) - 1))[-2])


def noise_alone(values: Floats, others: Mapping[str, Floats]) -> float:
    """Share of a channel's variance that is white noise; 0 if the channel is coherent with anything.

    White noise is coherent by chance: of K independent stretches, the coherence at a frequency exceeds x with the
    probability (1 - x)^(K - 1). A machine that rests shows noise alone as well; then nothing can be said of it either.

    Parameters
    ----------
    others : the command and the other channels, (N,) each.

    Returns
    -------
    0 to 1, and 1 for a constant.
    """
    variance = float(np.var(values))
    if variance == 0.0:
        return 1.0
    share = min(white_noise(values) ** 2 / variance, 1.0) if len(values) >= 64 else 0.0
    if share < SETTINGS.dead_noise_share:
        return share
    length = max(32, min(1024, len(values) // COHERENCE_STRETCHES_MIN))
    chance = COHERENCE_CHANCE / (length // 2 + 1) / max(len(others), 1)
    level = 1.0 - chance ** (1.0 / max(len(values) // length - 1, 1))
    moving = (other for other in others.values() if np.ptp(other) > 0.0)
    alive = any(np.max(coherence(values, other, nperseg=length)[1]) > level for other in moving)
    return 0.0 if alive else share


#: fewer changes of a reading show no pattern
CHANGES_MIN = 30
#: so many steps before a pause, and after the one that ends it, tell how fast the motion is
BESIDE = 2


def fresh(values: Floats) -> np.ndarray | None:
    """(N,) the samples at which a channel was read, where it was read more seldom than it was recorded; else None.

    Such a reading changes by several counts at a time, and still never at two samples in a row.
    """
    steps = np.diff(values)
    changed = np.flatnonzero(steps) + 1
    gaps = np.diff(changed)
    if len(changed) < CHANGES_MIN or float(np.mean(gaps == 1)) > HELD_TOGETHER_SHARE:
        return None
    if float(np.median(np.abs(steps[changed - 1]))) < HELD_COUNTS * quantum(values):
        return None  # it moves slowly over the counts of its sensor
    found = np.zeros(len(values), dtype=bool)
    found[changed] = True
    return found


def between(values: Floats, known: np.ndarray) -> Floats:
    """(N,) the values that are known, and on a cubic spline through them those between, with the channel's noise.

    The first value counts as known too: it was read then or shortly before. Quiet stretches would lower the noise
    floor, which is read from all of it.
    """
    at = np.union1d([0], np.flatnonzero(known))
    sigma, count = sensor_noise(values[at])
    where = np.minimum(np.arange(len(values)), at[-1])
    found = np.asarray(CubicSpline(at, values[at])(where), dtype=float)
    found += np.where(known, 0.0, sigma * np.random.default_rng(0).standard_normal(len(values)))
    return count * np.round(found / count) if count > 0.0 else found


def hung(values: Floats) -> np.ndarray:
    """(N,) the samples at which a channel repeats its last reading for so long as chance does not, then jumps on.

    A jump leads to where the motion has gone on to, and is larger than the steps beside it. A machine that friction
    holds does not jump on: it sets off and goes on, as all that has mass. What repeats often anyway (a coarse encoder)
    is no fault.
    """
    steps = np.diff(values)
    same = np.concatenate([[False], steps == 0.0])
    found = np.zeros(len(values), dtype=bool)
    long = [(a, b) for a, b in runs(same) if b - a >= HUNG_SAMPLES_MIN]
    often = (same.sum() - sum(b - a for a, b in long)) / len(values)
    if not long or often > HUNG_REPEATS_SHARE:
        return found
    least = math.log(HUNG_CHANCE / len(values)) / math.log(max(often, 1.0 / len(values)))
    sizes = np.abs(steps)
    far = max(jump(steps), HELD_COUNTS * quantum(values))
    for a, b in long:
        if b - a < least or b == len(values):
            continue
        beside = max(sizes[max(a - 1 - BESIDE, 0) : a - 1].max(initial=0.0), sizes[b : b + BESIDE].max(initial=0.0))
        if sizes[b - 1] > max(far, JUMP_RATIO * beside):
            found[a:b] = True
    return found
