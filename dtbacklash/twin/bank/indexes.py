"""Novelty indexes beside the mode's amplitude (the paper's section 4.2, outlook): which subsystem has changed.

- frequency: the dominant mode's frequency in the prediction error over omega_d, from the rate at which the phase of the
  lock-in's analytic signal turns. 1 for whatever leaves the structure as it is; it says something only while the mode
  swings by itself: it is NaN below an amplitude, while the amplitude rises, and for one period after.
- motor: the torque that the voltage leaves over on the believed motor (:mod:`.motor`), rms.
- structure: what the structure's linear observer leaves over behind the gap in force,
  ``den/chi q3 - num/chi theta_d`` (:mod:`.observer`), rms.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.compiled import inlined
from dtbacklash.physics.effects.play import play
from dtbacklash.twin.bank.equation import MotorEquation, residual_torque
from dtbacklash.twin.gap.observer import Path, TwinModel

#: places of the indexes in tables
FREQUENCY, MOTOR, STRUCTURE = 0, 1, 2
#: time constants of the rms, two periods of the paper's mode, and of the frequency's means, one period, s
MEAN_S, TURNING_S = 0.5, 0.25


class Watch(NamedTuple):
    """What the indexes are made with.

    from_q3, from_theta_d : of the twin's model. frequency : omega_d, rad/s. keep, keep_turning : of the means, per
    sample. least_m : amplitude of the mode from which on its frequency counts.
    """

    motor: MotorEquation
    from_q3: Path
    from_theta_d: Path
    frequency: float
    sample_time: float
    keep: float
    keep_turning: float
    least_m: float


class WatchState(NamedTuple):
    """Memory: of the motor's equation, of both paths, theta_d behind the gap, the phasor before, means, whether begun.

    means : (5,) imaginary and real part of the phasor's turning since it decays, squares of torque, of output error, of
    the phasor. armed : (3,) 1 where an index may raise an alarm. begun : (2,) whether, and samples of decay.
    """

    past: Floats
    lags: Floats
    by_q3: Floats
    by_theta_d: Floats
    theta_d: Floats
    phasor: Floats
    means: Floats
    armed: Floats
    begun: Floats


def new_watch(
    motor: MotorEquation, model: TwinModel, frequency_rad_s: float, sample_time_s: float, least_m: float
) -> Watch:
    """From what is believed of motor and structure."""
    keep, turning = math.exp(-sample_time_s / MEAN_S), math.exp(-sample_time_s / TURNING_S)
    return Watch(motor, model.from_q3, model.from_theta_d, frequency_rad_s, sample_time_s, keep, turning, least_m)


def new_watch_state(watch: Watch) -> WatchState:
    """Before the first sample."""
    n, m = watch.from_q3.b.size, watch.from_theta_d.b.size
    past, lags, by_q3, by_theta_d, theta_d, phasor, means, begun = (np.zeros(i) for i in (8, 9, n, m, 1, 2, 5, 2))
    return WatchState(past, lags, by_q3, by_theta_d, theta_d, phasor, means, np.ones(3), begun)


@inlined
def _through(path, state, u):
    """One sample through a path: its output; the state moves on."""
    n = state.shape[0]
    out = state[0] + path.d * u
    for i in range(n):
        following = path.b[i] * u
        for j in range(i, n):
            following += path.phi[i, j] * state[j]
        state[i] = following
    return out


@inlined
def _begin(W, Z, theta_m, q3, u):
    """As if everything had been at rest before the first sample."""
    Z.begun[0] = 1.0
    Z.theta_d[0] = theta_m
    for i in range(4):
        Z.past[i], Z.past[4 + i] = theta_m, u
    for i in range(Z.by_q3.shape[0]):
        Z.by_q3[i] = W.from_q3.start[i] * q3
    for i in range(Z.by_theta_d.shape[0]):
        Z.by_theta_d[i] = W.from_theta_d.start[i] * theta_m


@inlined
def _ratio(W, Z, real, imag):
    """Frequency of the mode over omega_d, NaN while it is not known. real, imag : of the phasor, m."""
    before_real, before_imag = Z.phasor[0], Z.phasor[1]
    Z.phasor[0], Z.phasor[1] = real, imag
    square, keep = real * real + imag * imag, W.keep_turning
    Z.means[4] = keep * Z.means[4] + (1.0 - keep) * square
    if not square < Z.means[4]:  # driven, not swinging: what turns is no mode
        Z.means[0] = Z.means[1] = Z.begun[1] = 0.0
        return np.nan
    Z.means[0] = keep * Z.means[0] + (1.0 - keep) * (before_real * imag - before_imag * real)
    Z.means[1] = keep * Z.means[1] + (1.0 - keep) * (before_real * real + before_imag * imag)
    Z.begun[1] += 1.0
    if Z.begun[1] * W.sample_time * W.frequency < 2.0 * math.pi or square < W.least_m * W.least_m:
        return np.nan
    return 1.0 + math.atan2(Z.means[0], Z.means[1]) / (W.sample_time * W.frequency)


@inlined
def index_step(W, Z, real, imag, theta_m, q3, u, gap_hat, out):
    """The indexes after one more sample, into ``out`` (3,): ratio, N m, m.

    real, imag : m, both channels of the lock-in, :func:`.novelty.novelty_step`. gap_hat : rad.
    """
    if Z.begun[0] == 0.0:
        _begin(W, Z, theta_m, q3, u)
    out[0] = _ratio(W, Z, real, -imag)  # the error's analytic signal seen from omega_d
    torque, _ = residual_torque(W.motor, Z.past, Z.lags, theta_m, u)
    Z.theta_d[0] = play(Z.theta_d[0], theta_m, gap_hat)
    error = _through(W.from_q3, Z.by_q3, q3) + _through(W.from_theta_d, Z.by_theta_d, Z.theta_d[0])
    Z.means[2] = W.keep * Z.means[2] + (1.0 - W.keep) * torque * torque
    Z.means[3] = W.keep * Z.means[3] + (1.0 - W.keep) * error * error
    out[1], out[2] = math.sqrt(Z.means[2]), math.sqrt(Z.means[3])


@inlined
def rising(Z, values, limits, hysteresis):
    """The first armed index that is above its limit, which disarms it; -1 for none.

    limits : (3,) of |ratio - 1|, N m, m. An index is armed again below ``hysteresis`` times its limit.
    """
    found = -1
    for i in range(3):
        size = abs(values[i] - 1.0) if i == 0 else values[i]
        if Z.armed[i] == 0.0:
            if not size >= hysteresis * limits[i]:
                Z.armed[i] = 1.0
        elif size > limits[i] and found < 0:
            Z.armed[i] = 0.0
            found = i
    return found
