"""Novelty indexes beside the mode's amplitude (the paper's section 4.2, outlook): which subsystem has changed.

- frequency: the dominant mode's frequency in the prediction error over omega_d, from the rate at which the phase of the
  lock-in's analytic signal turns. 1 for whatever leaves the structure as it is; it says something only while the mode
  swings by itself: it is NaN below an amplitude, while the amplitude rises, and for one period after.
- motor: the torque that the voltage leaves over on the believed motor (:mod:`.equation`), rms.
- structure: what the structure's linear observer leaves over behind the gap in force,
  ``den/chi q3 - num/chi theta_d`` (:mod:`.observer`), rms.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.core.library import lib, struct
from dtbacklash.twin.bank.equation import MotorEquation, motor_struct
from dtbacklash.twin.gap.observer import Path, TwinModel, path_struct

#: places of the indexes in tables
FREQUENCY, MOTOR, STRUCTURE = lib.FREQUENCY, lib.MOTOR, lib.STRUCTURE
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


def indexes_struct(watch: Watch, state: WatchState, values: Floats, limits: Floats, hysteresis: float) -> Any:
    """What the loop keeps and fills of the indexes.

    values : (N+1, 3) every index of each sample, SI. limits : (3,) of |ratio - 1|, N m, m; an index that rises above
    its own is told, and again only after it has been below ``hysteresis`` times that.
    """
    paths = {"from_q3": path_struct(watch.from_q3), "from_theta_d": path_struct(watch.from_theta_d)}
    own = {name: getattr(watch, name) for name in ("frequency", "sample_time", "keep", "keep_turning", "least_m")}
    return struct(
        "Indexes", motor=motor_struct(watch.motor), **paths, **own, **state._asdict(), values=values, limits=limits,
        hysteresis=hysteresis,
    )  # fmt: skip
