"""Faults of samples and channels: spikes, clipping, nothing but noise, readings that repeat or hang.

A channel is given without the samples at which it was not read.
"""

import math
from collections.abc import Mapping

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.resampling import noise_of
from dtbacklash.diagnosis.records import Mask
from dtbacklash.recording.channels import clipped, filled, runs

#: what lasts longer than a spike is a motion (samples)
SPIKE_SAMPLES_MAX = 2
#: a spike is so much further off its median than usual and than noise, which outliers of noise are not (ratio)
SPIKE_RATIO = 8.0
#: this quantile is how far samples usually are off their median (share)
SPIKE_USUAL_SHARE = 0.998
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
#: fewer changes of a reading show no pattern
CHANGES_MIN = 30
#: so many steps before a pause, and after the one that ends it, tell how fast the motion is
BESIDE = 2
#: a channel of whose variance more is white noise, coherent with nothing, is dead (share)
DEAD_NOISE_SHARE = 0.8
#: samples back to which white noise is compared with itself
WHITE_LAGS = 8
#: with fewer, noise is coherent by chance (stretches)
COHERENCE_STRETCHES_MIN = 16
#: how seldom noise alone may be taken for a signal (probability)
COHERENCE_CHANCE = 1e-3
#: a channel of counts repeats its values: it has this many at most (share of samples)
COUNTED_SHARE = 0.5


def spikes(values: Floats, u: Floats) -> Mask:
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
        bridge[_furthest(away, start, stop)[:SPIKE_SAMPLES_MAX]] = True
    bare = filled(np.where(bridge, np.nan, values))
    least = _least(values, _away(bare), SPIKE_USUAL_SHARE)
    bent = SPIKE_ROUGHNESS * float(np.quantile(_roughness(bare), SPIKE_USUAL_SHARE))
    found = np.zeros(len(values), dtype=bool)
    for start, stop in runs((away > least) & free):
        found[_alone(values, _furthest(away, start, stop), least)] = True
    found &= _roughness(values) > bent
    return found if found.mean() <= SPIKES_SHARE_MAX else np.zeros(len(values), dtype=bool)


def _away(values: Floats) -> Floats:
    """(N,) how far each sample is off the median of its neighbours."""
    middle = SPIKE_WINDOW_SAMPLES // 2
    near = np.lib.stride_tricks.sliding_window_view(np.pad(values, middle, "edge"), SPIKE_WINDOW_SAMPLES)
    off: Floats = np.abs(values - np.partition(near, middle)[:, middle])
    return off


def _roughness(values: Floats) -> Floats:
    """(N,) how far each sample is off the cubic through its neighbours."""
    off: Floats = np.abs(np.convolve(np.pad(values, 2, "edge"), np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0, "valid"))
    return off


def _least(values: Floats, away: Floats, usual: float) -> float:
    """How far off its median a sample has to be: beyond what is usual (a quantile), an encoder's jitter, and noise."""
    counts = SPIKE_COUNTS * quantum(values)
    return max(SPIKE_RATIO * float(np.quantile(away, usual)), counts, SPIKE_RATIO * noise_of(values)[0])


def _furthest(away: Floats, start: int, stop: int) -> Mask:
    """The samples from ``start`` to ``stop``, those that are furthest off first."""
    furthest: np.ndarray = start + np.argsort(-away[start:stop])
    return furthest


def _alone(values: Floats, furthest: np.ndarray, least: float) -> Mask:
    """As few of the samples that are furthest off as leave none of them so far off once these are bridged; or none."""
    first = max(int(furthest.min()) - SPIKE_WINDOW_SAMPLES, 0)
    near = values[first : int(furthest.max()) + SPIKE_WINDOW_SAMPLES + 1]
    for count in range(1, SPIKE_SAMPLES_MAX + 1):
        missing = np.zeros(len(near), dtype=bool)
        missing[furthest[:count] - first] = True
        if np.all(_away(filled(np.where(missing, np.nan, near)))[furthest - first] <= least):
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


def _after_jumps(u: Floats) -> Mask:
    """(N,) the samples shortly after where the command jumps, and of the beginning."""
    steps = np.abs(np.diff(u, prepend=u[0]))
    jumps = steps > jump(steps)
    jumps[0] = True
    near: np.ndarray = np.convolve(jumps, np.ones(JUMP_ANSWER_SAMPLES), "full")[: len(u)] > 0.5
    return near


def jump(steps: Floats) -> float:
    """The size from which on a step from one sample to the next is a jump. steps : all of a signal."""
    return JUMP_RATIO * float(np.sqrt(np.mean(steps**2)))


def at_limits(values: Floats) -> Mask:
    """(N,) the samples at which a sensor's range ends; none where only a few levels are ever taken."""
    found = np.zeros(len(values), dtype=bool)
    for _, mask in clipped(values):
        found |= mask
    return found


def noise_alone(values: Floats, others: Mapping[str, Floats]) -> float:
    """Share of a channel's variance that is white noise; 0 if the channel is coherent with anything.

    White noise is like none of the samples before (Box and Pierce, J. Am. Stat. Assoc. 65 (1970) 1509); what moves
    slowly is, by its share of the variance. Noise is coherent by chance: of K independent stretches, the coherence at a
    frequency exceeds x with the probability (1 - x)^(K - 1). A machine that rests shows noise alone as well; then
    nothing can be said of it either.

    Parameters
    ----------
    values : (N,). others : the command and the other channels, (N,) each.

    Returns
    -------
    0 to 1, and 1 for a constant.
    """
    if not len(values) or np.ptp(values) == 0.0:
        return 1.0
    off = values - values.mean()
    alike = max(abs(float(off[lag:] @ off[:-lag])) for lag in range(1, min(WHITE_LAGS, len(off) - 1) + 1))
    share = 1.0 - alike / float(off @ off)
    if share < DEAD_NOISE_SHARE:
        return share
    from scipy.signal import coherence

    length = max(32, min(1024, len(values) // COHERENCE_STRETCHES_MIN))
    chance = COHERENCE_CHANCE / (length // 2 + 1) / max(len(others), 1)
    level = 1.0 - chance ** (1.0 / max(len(values) // length - 1, 1))
    moving = (other for other in others.values() if np.ptp(other) > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):  # where one of them rests
        alive = any(np.nanmax(coherence(values, other, nperseg=length)[1]) > level for other in moving)
    return 0.0 if alive else share


def quantum(values: Floats) -> float:
    """Size of a count, in the channel's unit; 0 if the channel is not counted."""
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) > COUNTED_SHARE * len(values):
        return 0.0
    steps = np.diff(levels)
    step = float(np.quantile(steps, 0.1))
    counts = steps / step
    regular = np.abs(counts - np.round(counts)) < 0.05
    return step if regular[counts < 20].mean() > 0.95 else 0.0


def stale(values: Floats) -> Mask:
    """(N,) the samples that repeat the last reading of a channel that is read more seldom than it is recorded.

    Such a reading changes by several counts at a time, and still never at two samples in a row. The first value is one:
    it was read then or shortly before, and where a machine begins at rest its first state is known by it.
    """
    steps = np.diff(values)
    changed = np.flatnonzero(steps) + 1
    gaps = np.diff(changed)
    found = np.zeros(len(values), dtype=bool)
    if len(changed) < CHANGES_MIN or float(np.mean(gaps == 1)) > HELD_TOGETHER_SHARE:
        return found
    if float(np.median(np.abs(steps[changed - 1]))) < HELD_COUNTS * quantum(values):
        return found  # it moves slowly over the counts of its sensor
    found[1:] = steps == 0.0
    return found


def hung(values: Floats) -> Mask:
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
