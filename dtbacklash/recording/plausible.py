"""Wrong units: a channel that fits what is expected of it once it is multiplied by 1000 or 57.3."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import detrend

from dtbacklash.recording.command import refined
from dtbacklash.recording.model import Floats, Recording, Refused

if TYPE_CHECKING:
    from dtbacklash.physics.rig import Rig

#: factor between what is recorded and what is expected -> what was mistaken
FACTORS = {
    1e3: "a factor 1000 too large (micrometres for millimetres, millivolts for volts, ...)",
    1e-3: "a factor 1000 too small (metres for millimetres, kilovolts for volts, ...)",
    180 / math.pi: "a factor 57.3 too large (degrees for radians)",
    math.pi / 180: "a factor 57.3 too small (radians for degrees)",
}
SCALE_TOLERANCE = 0.05  # of a ratio of sizes: sizes alone say little
SIGNAL_TOLERANCE = 0.5  # of a ratio of two signals that have the same shape: no missing physics makes a factor 500
SAME_SHAPE = 0.95  # correlation from which two signals have the same shape
BLOCKS = 400  # for the changes of a signal over time

Expectation = float | Floats


def check_units(recording: Recording, expect: Mapping[str, Expectation]) -> None:
    """Refuse a channel that is off by the factor of a wrong unit.

    Parameters
    ----------
    expect : channel -> its rms size about its mean in SI, or (N,) the signal that a nominal model gives. A ratio
        of sizes must lie within 5 % of a factor; where two signals have the same shape (correlation
        above 0.95), within a factor 1.5.

    Raises
    ------
    Refused : names the channel and what was mistaken.
    """
    for name, expected in expect.items():
        if name not in recording.channels:
            continue
        ratio, tolerance = _ratio(recording.channels[name], expected)
        for factor, mistake in FACTORS.items():
            if ratio > 0.0 and abs(math.log(ratio / factor)) < math.log1p(tolerance):
                raise Refused(
                    f"channel {name} looks to be in a wrong unit: it is {mistake}; {recording.units[name]} in SI"
                )


def _ratio(values: Floats, expected: Expectation) -> tuple[float, float]:
    """Size of ``values`` relative to what is expected (0: unknown), and how far from a factor it may lie."""
    if isinstance(expected, (int, float)):
        return (float(np.std(values)) / expected if expected > 0.0 else 0.0), SCALE_TOLERANCE
    n = min(len(values), len(expected))
    for form in (_changes, detrend):
        a, b = form(values[:n]), form(np.asarray(expected[:n], dtype=float))
        size_a, size_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
        if size_a * size_b > 0.0 and math.isfinite(size_b) and float(a @ b) > SAME_SHAPE * size_a * size_b:
            return size_a / size_b, SIGNAL_TOLERANCE
    return 0.0, SIGNAL_TOLERANCE


def _changes(values: Floats) -> Floats:
    """Differences between the means of consecutive blocks: blind to a drift."""
    length = max(1, len(values) // BLOCKS)
    blocks = values[: len(values) // length * length].reshape(-1, length).mean(axis=1)
    return np.diff(blocks)


def expectations(rig: Rig, recording: Recording) -> dict[str, Expectation]:
    """What a rig lets expect of the sensors, for :func:`check_units`.

    The nominal rig's answer to the recorded command; and, where the motor's angle is recorded, its answer to
    that angle for all that the screw moves, which no error of the motor's model can spoil.
    """
    from dtbacklash.errors import UserError
    from dtbacklash.physics.simulate import simulate

    u, step = recording.channels.get("u"), recording.sample_time_s
    if u is None or len(u) < 2 or rig.only("amplifier") is None:
        return {}
    result: dict[str, Expectation] = {}
    angles = [s for s in rig.sensors.values() if s.quantity == "position" and rig.elements[s.of].kind == "rotor"]
    try:
        fine, parts = refined(recording)
        nominal = simulate(rig, fine, step / parts)
        result |= {name: y[::parts] for name, y in nominal.sensors.items()}
        for sensor in angles:
            theta = recording.channels.get(sensor.name)
            if theta is not None and rig.only("screw") is not None:
                driven = simulate(rig, u[:-1], step, theta_m_rad=theta - theta[0]).sensors
                result |= {name: y for name, y in driven.items() if np.isfinite(y).all() and y.any()}
    except UserError:  # a rig that cannot be simulated so says nothing about units
        pass
    return {name: y for name, y in result.items() if np.isfinite(y).all()}
