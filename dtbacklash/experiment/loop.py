"""The closed loop, compiled: plant, sensors, controller and novelty index, sample by sample."""

import math
from typing import NamedTuple

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.compiled import compiled, inlined
from dtbacklash.control.laws import control_step, crossing_samples
from dtbacklash.physics.kernel.sample import advance, read_sensor, sense
from dtbacklash.physics.kernel.step import screw_angle
from dtbacklash.twin.gap.novelty import novelty_step

#: why a segment ended
RAN, NOVELTY, DIVERGED = 0, 1, 2


class Signals(NamedTuple):
    """What goes into a run, (N+1,) each: reference (m, or V in open loop), half-gap rad, noise (N+1, sensors) SI.

    ``noise`` may have no rows: then there is none. ``resolution`` (sensors,): size of a count, 0 for none. ``moving`` :
    -1, 0 or 1, how the reference moves, where it is known ahead; else empty.
    """

    reference: Floats
    gap: Floats
    noise: Floats
    resolution: Floats
    moving: Floats = np.zeros(0)


class Traces(NamedTuple):
    """What comes out: (N+1,) voltage, theta_d, gap estimate, prediction error, novelty; (N+1, sensors) the rest."""

    u: Floats
    theta_d: Floats
    gap_hat: Floats
    eps: Floats
    novelty: Floats
    truth: Floats
    seen: Floats


class GapInForce(NamedTuple):
    """The believed half-gap: ``gap`` rad at sample ``since``, growing by ``growth`` a sample."""

    gap: float
    growth: float = 0.0
    since: int = 0

    def at(self, k: int) -> float:
        """The half-gap at sample k, rad."""
        return max(self.gap + self.growth * (k - self.since), 0.0)


@inlined
def _measure(P, S, signals, k, rate, traces):
    """What the sensors show at sample k, with noise and counts; the truth goes beside it."""
    seen = traces.seen[k]
    sense(P, S, signals.gap[k], rate, seen)
    for s in range(seen.shape[0]):
        traces.truth[k, s] = read_sensor(P, S, s, signals.gap[k], rate)
        if signals.noise.shape[0] > 0:
            seen[s] += signals.noise[k, s]
        count = signals.resolution[s]
        if count > 0.0:
            seen[s] = count * math.floor(seen[s] / count + 0.5)


@compiled
def run_segment(P, S, C, X, detector, oscillator, signals, traces, roles, first, stop, in_force, limits, before):
    """Run the samples ``first <= k < stop``.

    roles : sensors (index or -1) that show theta_m and q3. oscillator : (sos, cos_step, sin_step) of the lock-in filter
        and ``detector`` its state. in_force : :class:`GapInForce`. limits : |q3| that counts as diverged, m, and the
        novelty that ends the segment, m (inf for never). before : novelty before the first sample, m; it has to rise
        through its limit.

    Returns (k, why) : the sample after the last one that was run, and RAN, NOVELTY or DIVERGED.
    """
    last = signals.gap.shape[0] - 1
    for k in range(first, stop):
        rate = (signals.gap[min(k + 1, last)] - signals.gap[min(k, last - 1)]) / P.sample_time
        _measure(P, S, signals, k, rate, traces)
        theta_m = traces.seen[k, roles[0]] if roles[0] >= 0 else 0.0
        q3 = traces.seen[k, roles[1]] if roles[1] >= 0 else 0.0
        believed = max(in_force.gap + in_force.growth * (k - in_force.since), 0.0)
        toward = signals.moving[min(k + crossing_samples(C, believed), last)] if signals.moving.shape[0] > 0 else 0.0
        u, eps = control_step(C, X, signals.reference[k], theta_m, q3, believed, in_force.growth, toward)
        traces.u[k], traces.eps[k], traces.gap_hat[k] = u, eps, believed
        traces.theta_d[k] = screw_angle(P, S, signals.gap[k]) if P.rotor >= 0 else 0.0
        level = novelty_step(detector, oscillator[0], oscillator[1], oscillator[2], eps)
        traces.novelty[k] = level
        if not abs(q3) <= limits[0] or not math.isfinite(u):
            return k, DIVERGED
        if k < last:
            advance(P, S, k * P.sample_time, u, signals.gap[k], signals.gap[k + 1], signals.reference, k)
        if level > limits[1] and not before > limits[1]:
            return k + 1, NOVELTY
        before = level
    return stop, RAN
