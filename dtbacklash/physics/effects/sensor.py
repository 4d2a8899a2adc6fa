"""Errors of sensors."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from dtbacklash.physics.effects.declare import (
    INF,
    REST_ERROR,
    SENSOR_UNIT,
    Effect,
    Parameter,
    Place,
    Role,
    Values,
    within_a_line,
)
from dtbacklash.physics.effects.drive import GAIN_ENDS, GAIN_MAX, late
from dtbacklash.physics.effects.slots import Filter, Reading, ShownPlay


def scaled(reading, relative):
    """What a sensor shows whose gain errs by ``relative``."""
    return (1.0 + relative) * reading


def unscaled(reading, relative):
    """Inverse of :func:`scaled`."""
    return reading / (1.0 + relative)


def shifted(reading, offset):
    """What a sensor shows that is off by ``offset``."""
    return reading + offset


def unshifted(reading, offset):
    """Inverse of :func:`shifted`."""
    return reading - offset


def eccentric(reading, amplitude, phase):
    """What an encoder shows whose disk is off centre: an error once a turn, right at zero. rad -> rad."""
    return reading + amplitude * (math.sin(reading + phase) - math.sin(phase))


def centred(reading, amplitude, phase):
    """Inverse of :func:`eccentric`, to the fifth order of the amplitude."""
    angle = reading
    for _ in range(4):
        angle = reading - amplitude * (np.sin(angle + phase) - np.sin(phase))
    return angle


def _first_order(values: Values) -> tuple[Sequence[float], Sequence[float]]:
    w = 2.0 * math.pi * values["cutoff"]
    return [w], [1.0, w]


def _second_order(values: Values) -> tuple[Sequence[float], Sequence[float]]:
    w = 2.0 * math.pi * values["cutoff"]
    return [w * w], [1.0, 2.0 * values["damping_ratio"] * w, w * w]


def _mean(values: Values) -> tuple[Sequence[float], Sequence[float]]:
    """The Pade approximant [4/5] of ``(1 - e^(-s window)) step / (window (1 - e^(-s step)))``.

    step = window (1 - 2 middle): that of the samples that are averaged; 0 where all instants are. It is stable, and
    within 0.4 % up to the first null (Baker and Graves-Morris, Pade Approximants, 1996).
    """
    window, share = values["window"], 1.0 - 2.0 * values["middle"]
    of_window = np.array([(-1) ** k / math.factorial(k + 1) for k in range(10)])
    of_step, mean = of_window * share ** np.arange(10), np.zeros(10)
    for k in range(10):
        mean[k] = of_window[k] - of_step[1 : k + 1] @ mean[:k][::-1]
    at = np.arange(5)
    q = np.append(1.0, np.linalg.solve(mean[4 + at[:, None] - at], -mean[5:]))
    p = np.convolve(q, mean)[:5]
    return (p * window**at)[::-1].tolist(), (q * window ** np.arange(6))[::-1].tolist()


def _late_first_order(time: float) -> Values:
    return {"cutoff": 0.5 / (math.pi * time)}


def _late_second_order(time: float) -> Values:
    return {"cutoff": math.sqrt(0.5) / (math.pi * time), "damping_ratio": math.sqrt(0.5)}


def _late_mean(time: float) -> Values:
    return {"window": 2.0 * time, "middle": 0.5}


#: of a filter; a sensor without one has an infinite cut-off
CUTOFF = Parameter("cutoff", "Hz", 1e-3, INF, 50.0, INF, role=Role.SIZE)
#: where the search for a cut-off starts, shares of the rate of the readings
CUTOFFS = (0.4, 0.15, 0.05, 0.015, 0.005)


def _miscounted(values: Values) -> str:
    """What a gain comes from that is off by a factor: by a whole number, or one over it, or by any."""
    times = 1.0 + values["relative"]
    large = max(times, 1.0 / times)
    if large < FAR:
        return ""
    whole = round(large) if abs(large / round(large) - 1.0) < ROUND else 0
    said = (f"{whole} times" if times > 1.0 else f"1/{whole} of") if whole else f"{times:.3g} times"
    return f" It reads {said} what is there, as with a wrong number of lines a turn, counts a line, or unit."


def _within_the_way(place: Place) -> dict[str, tuple[float, float]]:
    """A play as wide as the way of what is sensed never lets it turn the sensor."""
    return {"width": (0.0, place.way)}


def _not_concealed(place: Place, sign: float) -> tuple[float, float]:
    """The second simulator has no filter and no play of a sensor."""
    return 1.0, 0.1


#: a gain this near to a whole number is one; one that is off by such a factor is no tolerance
ROUND, FAR = 0.01, 1.4
#: where the search for a play starts, shares of the way
WIDTHS = (0.002, 0.01, 0.05, 0.2)


def _cutoffs(place: Place) -> list[Values]:
    return [{"cutoff": share / place.sample_time_s} for share in CUTOFFS]


def _windows(place: Place) -> list[Values]:
    """As late as the filters of these cut-offs."""
    return [_late_mean(0.5 * place.sample_time_s / (math.pi * share)) for share in CUTOFFS[1:]]


def _any_phase(rng: Generator, place: Place) -> Values:
    return {"phase": float(rng.uniform(-3.1, 3.1))}


EFFECTS = [
    late("sensor", "{location} reports {time} late.", "y(t - time)"),
    Effect(
        "eccentricity", "sensor",
        (
            Parameter("amplitude", "rad", 0.0, 0.3, 0.005, 0.0, role=Role.SIZE),
            Parameter("phase", "rad", -3.2, 3.2, 0.0, role=Role.ANGLE),
        ),
        "y + amplitude (sin(y + phase) - sin(phase))", Reading(eccentric, centred),
        "an encoder's disk off centre: first harmonic of its error over a turn",
        "The encoder of {location} is off centre: it errs by {amplitude} once a turn (phase {phase}).",
        conceal=lambda place, sign: (0.2, 0.002), draws=_any_phase, of_units=("rad",),
        starts=lambda place: [{"phase": turn * math.pi / 2.0} for turn in (-1, 0, 1, 2)],
        simpler_at=within_a_line("gain_error"),
    ),
    Effect(
        "lost_motion", "sensor", (Parameter("width", SENSOR_UNIT, 0.0, 1e3, 1e-3, 0.0, role=Role.SIZE),),
        "a play operator of this width", ShownPlay("width"), "play operator",
        "{location} sits behind a play of {width}.", conceal=_not_concealed, of_units=("m", "rad"),
        starts=lambda place: [{"width": share * place.way} for share in WIDTHS], visible=_within_the_way,
        formulation_error=REST_ERROR,
    ),
    Effect(
        "gain_error", "sensor", (Parameter("relative", "1", *GAIN_ENDS, 0.02, 0.0, role=Role.SIZE),),
        "(1 + relative) y", Reading(scaled, unscaled), "linear", "The gain of {location} is off by {relative}.",
        remark=_miscounted, conceal=lambda place, sign: (GAIN_MAX, 0.02), visible=lambda place: {"relative": GAIN_ENDS},
    ),
    Effect(
        "low_pass", "sensor", (CUTOFF,), "y', y' = 2 pi cutoff (q - y)", Filter(_first_order, _late_first_order),
        "first-order low-pass",
        "{location} is filtered: first order, {cutoff}.", conceal=_not_concealed, starts=_cutoffs,
    ),
    Effect(
        "second_order_low_pass", "sensor", (CUTOFF, Parameter("damping_ratio", "1", 0.2, 5.0, 0.707)),
        "y, y'' = w^2 (q - y) - 2 damping_ratio w y', w = 2 pi cutoff", Filter(_second_order, _late_second_order),
        "second-order low-pass", "{location} is filtered: second order, {cutoff}, damping ratio {damping_ratio}.",
        conceal=_not_concealed, starts=_cutoffs,
    ),
    Effect(
        "moving_average", "sensor",
        (
            Parameter("window", "s", 0.0, 1e3, 0.02, 0.0, role=Role.SIZE),
            Parameter("middle", "1", 0.275, 0.725, 0.5),
        ),
        "mean of y over window, middle * window late: 1/2, or (n - 1) / 2n of n samples, n > 2",
        Filter(_mean, _late_mean),
        "moving average; in the simulation its Pade approximant [4/5]",
        "{location} shows a moving average over {window}, whose middle is {middle} of it ago.",
        conceal=_not_concealed, starts=_windows,
    ),
    Effect(
        "offset", "sensor", (Parameter("offset", SENSOR_UNIT, -1e3, 1e3, 1e-5, 0.0, role=Role.SIZE),),
        "y + offset", Reading(shifted, unshifted, stage=1), "constant", "{location} is off by {offset}.",
        conceal=lambda place, sign: (1e3, 0.003 * place.travel),
    ),
]  # fmt: skip
