"""Errors of sensors."""

from dtbacklash.compiled import law
from dtbacklash.physics.effects.declare import SENSOR_UNIT, Effect, Parameter, Role
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


EFFECTS = [
    late("sensor", "{location} reports {time} late.", "y(t - time)"),
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
