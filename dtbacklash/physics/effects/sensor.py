"""Errors of sensors."""

import math

import numpy as np
from numpy.random import Generator

from dtbacklash.compiled import law
from dtbacklash.physics.effects.declare import SENSOR_UNIT, Effect, Parameter, Place, Role, Values
from dtbacklash.physics.effects.drive import GAIN_ENDS, GAIN_MAX, late
from dtbacklash.physics.effects.slots import Reading


@law
def scaled(reading, relative):
    """What a sensor shows whose gain errs by ``relative``."""
    return (1.0 + relative) * reading


def unscaled(reading, relative):
    """Inverse of :func:`scaled`."""
    return reading / (1.0 + relative)


@law
def shifted(reading, offset):
    """What a sensor shows that is off by ``offset``."""
    return reading + offset


def unshifted(reading, offset):
    """Inverse of :func:`shifted`."""
    return reading - offset


@law
def eccentric(reading, amplitude, phase):
    """What an encoder shows whose disk is off centre: an error once a turn, right at zero. rad -> rad."""
    return reading + amplitude * (math.sin(reading + phase) - math.sin(phase))


def centred(reading, amplitude, phase):
    """Inverse of :func:`eccentric`, to the fifth order of the amplitude."""
    angle = reading
    for _ in range(4):
        angle = reading - amplitude * (np.sin(angle + phase) - np.sin(phase))
    return angle


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
        conceal=lambda place, sign: (0.2, 0.002), draws=_any_phase, of_unit="rad",
        starts=lambda place: [{"phase": turn * math.pi / 2.0} for turn in (-1, 0, 1, 2)],
    ),
    Effect(
        "gain_error", "sensor", (Parameter("relative", "1", *GAIN_ENDS, 0.02, 0.0, role=Role.SIZE),),
        "(1 + relative) y", Reading(scaled, unscaled), "linear", "The gain of {location} is off by {relative}.",
        conceal=lambda place, sign: (GAIN_MAX, 0.02), visible=lambda place: {"relative": GAIN_ENDS},
    ),
    Effect(
        "offset", "sensor", (Parameter("offset", SENSOR_UNIT, -1e3, 1e3, 1e-5, 0.0, role=Role.SIZE),),
        "y + offset", Reading(shifted, unshifted, stage=1), "constant", "{location} is off by {offset}.",
        conceal=lambda place, sign: (1e3, 0.003 * place.travel),
    ),
]  # fmt: skip
