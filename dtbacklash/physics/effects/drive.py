"""Effects of the drive: the amplifier and the motor's winding."""

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from dtbacklash.physics.effects.declare import CORNER_ERROR, INF, Effect, Parameter, Place, Role, Values, hardly_reached
from dtbacklash.physics.effects.periodic import periodic
from dtbacklash.physics.effects.slots import Clipping, Command, Lag, Late, MotorTorque, WindingMemory

#: a delay is concealed up to this, s, and a gain error up to this share
DELAY_MAX_S, GAIN_MAX = 6e-3, 0.4
#: a lag is concealed up to this, s, and its search starts at these, samples
LAG_MAX_S, LAGS_SAMPLES = 2e-2, (1.0, 5.0, 20.0)
#: a gain that is off by a factor of twenty is a wrong unit, a wrong sensor or none: at these ends it is not believed
GAIN_ENDS = -0.95, 19.0
#: where the search for a delay starts, samples: its fit has a valley for every turn of the signal
DELAYS_SAMPLES = (0.3, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)


def amplified(command, relative):
    """Voltage of an amplifier whose gain errs by ``relative``. V -> V."""
    return (1.0 + relative) * command


def dead_zone(command, half_width):
    """Voltage behind a dead zone: 0 while ``|u| <= half_width``, shifted towards zero outside. V -> V."""
    if command > half_width:
        return command - half_width
    if command < -half_width:
        return command + half_width
    return 0.0


def saturation(command, limit):
    """Voltage clipped to ``[-limit, limit]``. V -> V."""
    return min(max(command, -limit), limit)


def heating_rate(memory, current, resistance, gain, time_constant):
    """Rate of the relative rise of a winding's resistance beside its decay ``-memory/time_constant``. A -> 1/s."""
    return gain * resistance * current * current / time_constant


def voltage_of_heat(memory, current, resistance):
    """Voltage that the risen part of a winding's resistance eats. A -> V."""
    return resistance * memory * current


def ripple_torque(current, position, torque_constant, relative, periods, phase):
    """Torque beside ``torque_constant current`` of a motor whose constant ripples with its angle. A, rad -> N m."""
    return torque_constant * current * periodic(position, relative, periods, phase)


def _delays(place: Place) -> list[Values]:
    return [{"time": n * place.sample_time_s} for n in DELAYS_SAMPLES]


def _lags(place: Place) -> list[Values]:
    return [{"time": n * place.sample_time_s} for n in LAGS_SAMPLES]


def _limits(place: Place) -> list[Values]:
    size = np.abs(place.command[place.command != 0.0])
    limits = [0.97 * size.max(), *np.quantile(size, (0.5, 0.8, 0.95, 0.99))] if len(size) else []
    return [{"limit": float(v)} for v in limits]


def _widths(place: Place) -> list[Values]:
    """Dead zones that swallow from little to most of the commands."""
    size = np.abs(place.command)
    size = size[size > 1e-3 * size.max(initial=0.0)]
    if not len(size):
        return []
    return [{"size": float(v)} for v in np.unique(np.quantile(size, (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65)))]


def _hardly_clipped(values: Values, place: Place) -> str:
    """A limit that clips twice at most is little else than a gain."""
    return "gain_error" if hardly_reached(np.abs(place.command) > values["limit"]) else ""


def _largest(place: Place) -> float:
    """The largest command but for a thousandth, V."""
    return float(np.quantile(np.abs(place.command), 0.999))


#: a dead zone that is wider than this share of the commands would switch the drive off
PASSING = 0.98


def _heat(place: Place, sign: float) -> tuple[float, float]:
    watt = place.values["resistance"] * place.current**2
    return 1.0 / watt, 0.1 / watt


def _ripple_draws(rng: Generator, place: Place) -> Values:
    return {"periods": float(rng.integers(3, 13)), "phase": float(rng.uniform(-3.1, 3.1))}


def late(kind: str, sentence: str, law_text: str) -> Effect:
    """A pure delay of an amplifier or a sensor."""
    return Effect(
        "delay", kind, (Parameter("time", "s", 0.0, 10.0, 1.3e-3, 0.0, role=Role.TIME),), law_text, Late("time"),
        "pure delay", sentence, conceal=lambda place, sign: (DELAY_MAX_S, 5e-4), starts=_delays,
    )  # fmt: skip


def _limits_seen(place: Place) -> dict[str, tuple[float, float]]:
    """A limit that clips nearly all of the command is none: it switches the drive off, or is its gain."""
    size = np.abs(place.command)
    largest = float(size.max(initial=0.0))
    if largest == 0.0:
        return {"limit": (0.0, 0.0)}
    return {"limit": (min(float(np.quantile(size[size > 0.0], 1.0 - PASSING)), 0.5 * largest), largest)}


EFFECTS = [
    Effect(
        "saturation", "amplifier", (Parameter("limit", "V", 1e-3, INF, 3.0, INF, role=Role.SIZE),),
        "v = min(max(u, -limit), limit)", Clipping(saturation, stage=2), "ideal limiter",
        "The {location} clips the voltage at {limit}.",
        conceal=lambda place, sign: (0.9, 0.3), starts=_limits,
        strength=lambda place, strength: _largest(place) * (1.0 - strength),
        visible=_limits_seen, simpler_at=_hardly_clipped,
        formulation_error=CORNER_ERROR,
    ),
    Effect(
        "dead_zone", "amplifier", (Parameter("half_width", "V", 0.0, 1e3, 0.2, 0.0, role=Role.SIZE),),
        "v = u - half_width sign(u) where |u| > half_width, else 0", Clipping(dead_zone, stage=1), "ideal dead zone",
        "The {location} passes nothing while the voltage is within {half_width} of zero.",
        conceal=lambda place, sign: (0.8 * _largest(place), 0.05), starts=_widths,
        visible=lambda place: {"half_width": (0.0, float(np.quantile(np.abs(place.command), PASSING)))},
        formulation_error=CORNER_ERROR, of_both_signs="command",
    ),
    late("amplifier", "The {location} acts {time} late.", "v(t) = u(t - time)"),
    Effect(
        "gain_error", "amplifier", (Parameter("relative", "1", *GAIN_ENDS, 0.05, 0.0, role=Role.SIZE),),
        "v = (1 + relative) u", Command(amplified), "linear",
        "The {location}'s gain is off by {relative}.",
        conceal=lambda place, sign: (GAIN_MAX, 0.02), visible=lambda place: {"relative": GAIN_ENDS},
    ),
    Effect(
        "lag", "actuator", (Parameter("time", "s", 0.0, 10.0, 5e-3, 0.0, role=Role.SIZE),),
        "effort gain y, time y' = v - y", Lag("time"), "closed current loop as a first-order lag",
        "The effort of the {location} follows its command with a lag of {time}.",
        conceal=lambda place, sign: (LAG_MAX_S, 1e-3), starts=_lags,
    ),
    Effect(
        "resistance_heating", "motor_circuit",
        (
            Parameter("gain", "1/W", 0.0, 100.0, 0.5, 0.0, role=Role.SIZE),
            Parameter("time_constant", "s", 0.1, 1e4, 5.0),
        ),
        "R(1 + y), time_constant y' = gain R i^2 - y", WindingMemory(heating_rate, voltage_of_heat, "time_constant"),
        "first-order thermal model of the winding",
        "The winding of the {location} heats up: {gain} of relative resistance per watt, within {time_constant}.",
        conceal=_heat,
        draws=lambda rng, place: {"time_constant": place.duration_s * float(rng.uniform(0.05, 0.4))},
        starts=lambda place: [{"time_constant": share * place.duration_s} for share in (0.04, 0.2, 0.8)],
    ),
    Effect(
        "torque_ripple", "motor_circuit",
        (
            Parameter("relative", "1", 0.0, 1.0, 0.1, 0.0, role=Role.SIZE),
            Parameter("periods", "1/rev", 1.0, 200.0, 6.0, role=Role.WAVE),
            Parameter("phase", "rad", -3.2, 3.2, 0.0, role=Role.ANGLE),
        ),
        "T = k_T i (1 + relative sin(periods theta + phase))", MotorTorque(ripple_torque),
        "torque ripple of a commutated motor",
        "The torque constant of the {location} ripples by {relative}, {periods}.",
        conceal=lambda place, sign: (0.8, 0.1), draws=_ripple_draws, formulation_error=CORNER_ERROR,
    ),
]  # fmt: skip
#: what an amplifier does to the command, an actuator of a simulator's model may do to its own
EFFECTS += [replace(e, kind="joint_drive") for e in EFFECTS if e.kind == "amplifier"]
