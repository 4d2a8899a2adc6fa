"""What a body's acceleration leaves over: the equation of motion of one body, from filtered recordings.

The residual is ``a - (nominal acceleration at the measured state)``. The state is a low-passed, differentiated
recording; the nominal acceleration follows from the linear nominal equations, by least squares of the nominal
machine's own simulation: so no equation has to be written down for each machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from dtbacklash.arrays import Floats
from studies.baselines.case import Case, simulated

LOW_PASS_HZ, RATE_HZ = 30.0, 200.0
#: share of a recording at its ends that filters spoil
EDGE = 0.03


@dataclass(frozen=True)
class Body:
    """One body whose position is recorded: (N,) position, speed and what its acceleration leaves over, and its noise.

    residual : of the recording. floor : rms of the same of the nominal machine with the sensors' noise.
    """

    place: str
    position: Floats
    speed: Floats
    residual: Floats
    floor: float


def bodies(case: Case, which: int = -1) -> list[Body]:
    """The bodies with a recorded position."""
    table, channels = case.recordings[which], case.said["predict"]
    u = table["u"].to_numpy()
    shown = simulated(case.rig, u, case.step_s)
    rng = np.random.default_rng(0)
    noisy = {c: shown[c] + case.noise[c] * rng.standard_normal(len(u)) for c in channels}
    measured = {c: table[c].to_numpy() for c in channels}
    found = []
    for name in channels:
        sensor = case.rig.sensors[name]
        if sensor.quantity != "position":
            continue
        clean, own, noise = (_equation(case, name, signals, u) for signals in (shown, measured, noisy))
        fit, *_ = np.linalg.lstsq(clean[0], clean[1], rcond=None)
        left, floor = own[1] - own[0] @ fit, noise[1] - noise[0] @ fit
        found.append(Body(sensor.of, own[2], own[3], left, float(np.sqrt(np.mean(floor**2)))))
    return found


def _equation(case: Case, name: str, signals: dict[str, Floats], u: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """(N, terms) states and command, (N,) acceleration, position, speed of one body, low-passed and thinned."""
    every = max(1, round(1.0 / RATE_HZ / case.step_s))
    low = butter(4, LOW_PASS_HZ, fs=1.0 / case.step_s, output="sos")
    edge = round(EDGE * len(u))
    terms = [sosfiltfilt(low, u)]
    for channel in case.said["predict"]:
        smooth = sosfiltfilt(low, signals[channel])
        terms += [smooth, np.gradient(smooth, case.step_s)]
    position = sosfiltfilt(low, signals[name])
    speed = np.gradient(position, case.step_s)
    thin = slice(edge, len(u) - edge, every)
    return (
        np.column_stack(terms)[thin], np.gradient(speed, case.step_s)[thin], position[thin], speed[thin],
    )  # fmt: skip
