"""Effects of a single body: friction in its bearing, cogging, loads, gravity, a hidden mass on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from dtbacklash.physics.effects.declare import (
    REST_ERROR,
    Alias,
    Draws,
    Effect,
    Parameter,
    Place,
    Role,
    Values,
    within_a_line,
)
from dtbacklash.physics.effects.periodic import periodic
from dtbacklash.physics.effects.slots import BodyDamping, BodyEffort, Contact, HiddenBody

#: no machine's effort, damping or mass is larger, SI: what bounds a search is the recording, and a machine may be large
HIGH = 1e9
#: frequencies at which a search for a hidden mass begins, and how far they reach beyond the structure's own
ABSORBERS, BELOW, ABOVE = 25, 3.0, 5.0
SAME_AS_LOAD = "a load and a difference of the friction's levels are the same to any recording"
_FRICTION = "friction at the {location} is higher by"
_HIGHER = "in the positive direction and lower by as much in the other."
FRICTION_SOURCE = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083"


def coulomb(level):
    """Dry friction's magnitude."""
    return level


def stribeck(slip_speed, level, speed):
    """What dry friction has more at rest: ``level exp(-(slip_speed/speed)^2)``; Gaussian form of the Stribeck curve."""
    ratio = slip_speed / speed
    return level * math.exp(-ratio * ratio)


def asymmetric_friction(velocity, viscous_difference, coulomb_difference):
    """What friction that differs between directions has beside its mean: ``-(coulomb_difference + d |v|)``.

    Levels of F+ and F- are one level of (F+ + F-)/2 and a constant effort of -(F+ - F-)/2, sliding and at rest alike.
    So the difference of the levels is meant beside Coulomb friction that is larger: where there is none, it pushes at
    rest, as a load does.
    """
    return -(coulomb_difference + viscous_difference * abs(velocity))


def quadratic_drag(velocity, coefficient):
    """What a body in a fluid loses that is faster than it can creep: ``-c v |v|``."""
    return -coefficient * velocity * abs(velocity)


def coasting(velocity, command, coefficient, driven_from):
    """Braking that a drive gives up as it lets a body coast: all of it without a command, none from one on.

    A bridge that opens between its pulses lets no current brake then, by the motor's back EMF or by a short circuit: it
    brakes for the share of the time in which it is closed, which grows with the command. One that opens at rest alone
    has a ``driven_from`` of 0, which is the same as any up to the smallest command that is given.
    """
    if command == 0.0:
        return coefficient * velocity
    return coefficient * velocity * (1.0 - abs(command) / driven_from) if abs(command) < driven_from else 0.0


def constant(effort):
    """A load that never changes."""
    return effort


def gravity(position, torque, phase):
    """Torque of an off-centre mass, ``m g l sin(angle + phase)``. rad -> N m."""
    return torque * math.sin(position + phase)


@dataclass(frozen=True)
class _Axis:
    """What differs between a body that turns and one that slides."""

    kind: str
    effort: str
    effort_unit: str
    speed_unit: str
    viscous_unit: str
    drag_unit: str
    wave: Parameter
    load: str
    high: float
    typical: float
    slow: float


_ROTARY = _Axis(
    "rotor", "torque", "N m", "rad/s", "N m s/rad", "N m s^2/rad^2",
    Parameter("periods", "1/rev", 1.0, 500.0, 24.0, role=Role.WAVE), "constant_load", HIGH, 0.02, 1.0,
)  # fmt: skip
_LINEAR = _Axis(
    "carriage", "force", "N", "m/s", "N s/m", "N s^2/m^2",
    Parameter("wave_number", "rad/m", 1.0, 1e5, 2513.0, role=Role.WAVE), "constant_force", HIGH, 20.0, 0.02,
)  # fmt: skip


def _effort_range(place: Place, sign: float) -> tuple[float, float]:
    return place.force_most, 0.1 * place.force


def _viscous_range(place: Place, sign: float) -> tuple[float, float]:
    return place.force_most / place.speed, 0.05 * place.force / place.speed


def _difference_range(place: Place, sign: float) -> tuple[float, float]:
    return 0.5 * place.force_most / place.speed, 0.05 * place.force / place.speed


def _coasting(kind: str, unit: str, typical: float) -> Effect:
    without = "The drive lets the {location} coast: without a command it brakes it by {coefficient} less"
    return Effect(
        "coasting", kind,
        (
            Parameter("coefficient", unit, 0.0, HIGH, typical, 0.0, role=Role.SIZE),
            Parameter("driven_from", "V", 0.0, 1e5, 0.0, 0.0),
        ),
        "coefficient v (1 - |u|/driven_from) where |u| < driven_from; coefficient v at u = 0; else 0",
        BodyEffort(coasting), "mean back-EMF braking of an H-bridge that opens between its pulses (fast decay)",
        without + ", from {driven_from} on as it always does.", sentence_without=(("driven_from", without + "."),),
        conceal=_viscous_range, draws=_coasting_draws, starts=_coasting_starts,
        visible=lambda place: {"driven_from": (0.0, 2.0 * _largest(place))},
    )  # fmt: skip


def _drag(kind: str, unit: str, typical: float) -> Effect:
    return Effect(
        "quadratic_drag", kind, (Parameter("coefficient", unit, 0.0, HIGH, typical, 0.0, role=Role.SIZE),),
        "-coefficient v |v|", BodyEffort(quadratic_drag), "drag at high Reynolds number",
        "A drag of {coefficient} that grows with the square of the speed acts at the {location}.",
        conceal=_drag_range, starts=_share_of_drag,
    )  # fmt: skip


def _drag_range(place: Place, sign: float) -> tuple[float, float]:
    return place.force_most / place.speed**2, 0.05 * place.force / place.speed**2


def _cogging_draws(axis: _Axis) -> Draws:
    """A whole number of periods a turn, or over the travel of what slides."""

    def draws(rng: Generator, place: Place) -> Values:
        waves, phase = float(rng.integers(3, 25)), float(rng.uniform(-3.1, 3.1))
        turn = 1.0 if axis is _ROTARY else math.pi / place.reach
        return {axis.wave.name: min(waves * turn, axis.wave.high), "phase": phase}

    return draws


def _share_of_force(place: Place) -> list[Values]:
    """A twentieth of what drives the body."""
    return [{"size": 0.05 * place.force}] if place.force > 0.0 else [{}]


def _share_of_damping(place: Place) -> list[Values]:
    """A friction that takes a twentieth of what drives the body at its speed."""
    return [{"size": 0.05 * place.force / place.speed}] if place.force > 0.0 and place.speed > 0.0 else [{}]


def _share_of_drag(place: Place) -> list[Values]:
    """The same of a drag."""
    return [{"size": 0.05 * place.force / place.speed**2}] if place.force > 0.0 and place.speed > 0.0 else [{}]


def _largest(place: Place) -> float:
    """The largest command, V."""
    return float(np.abs(place.command).max(initial=0.0))


def _coasting_draws(rng: Generator, place: Place) -> Values:
    return {"driven_from": _largest(place) * float(rng.uniform(0.1, 1.0))}


def _coasting_starts(place: Place) -> list[Values]:
    """Drives that brake from a part of the largest command on; none where the command is always there."""
    largest, base = _largest(place), _share_of_damping(place)[0]
    return [{**base, "driven_from": share * largest} for share in (0.0, 0.1, 0.4, 1.0)] if largest > 0.0 else []


def _stribeck_starts(place: Place) -> list[Values]:
    base = _share_of_force(place)[0]
    return [{**base, "speed": share * place.speed} for share in (0.02, 0.1, 0.4)] if place.speed > 0.0 else [base]


def _bearing(axis: _Axis) -> list[Effect]:
    kind, effort, unit, top, size = axis.kind, axis.effort, axis.effort_unit, axis.high, axis.typical
    level = Parameter(effort, unit, 0.0, top, size, 0.0, role=Role.SIZE)
    return [
        Effect(
            "coulomb_friction", kind, (level,), f"-{effort} sign(v), |.| <= {effort} at v = 0", Contact(coulomb),
            FRICTION_SOURCE, f"Dry (Coulomb) friction of {{{effort}}} acts at the {{location}}.",
            conceal=_effort_range, starts=_share_of_force, formulation_error=REST_ERROR,
        ),
        Effect(
            "stribeck_friction", kind,
            (replace(level, typical=size / 2), Parameter("speed", axis.speed_unit, 1e-9, 1e5, axis.slow)),
            f"-{effort} exp(-(v/speed)^2) sign(v)", Contact(stribeck), FRICTION_SOURCE,
            f"Friction at the {{location}} is higher by {{{effort}}} at rest and falls off within {{speed}}.",
            conceal=_effort_range, draws=lambda rng, place: {"speed": place.speed * float(rng.uniform(0.05, 0.4))},
            starts=_stribeck_starts, visible=lambda place: {"speed": (0.0, place.speed)},
            becomes=("speed", "coulomb_friction"),
            # the end of the fall, at which it is below a fiftieth, is not seen
            simpler_at=lambda values, place: "coulomb_friction" if 2.0 * values["speed"] > place.speed > 0.0 else "",
            formulation_error=0.05,  # how far it rises before it falls off depends on how a body is held at rest
        ),
        Effect(
            "viscous_friction", kind,
            (Parameter("coefficient", axis.viscous_unit, 0.0, HIGH, size / 20, 0.0, role=Role.SIZE),),
            "-coefficient v", BodyDamping("coefficient"), "linear",
            "Viscous friction of {coefficient} acts at the {location}.",
            conceal=_viscous_range, starts=_share_of_damping,
        ),
        _drag(kind, axis.drag_unit, size / 20),
        _coasting(kind, axis.viscous_unit, size / 20),
        Effect(
            "asymmetric_friction", kind,
            (
                Parameter("viscous_difference", axis.viscous_unit, -HIGH, HIGH, size / 40, 0.0, role=Role.SIZE),
                Parameter("coulomb_difference", unit, -top, top, 0.0, 0.0),
            ),
            "-(coulomb_difference + viscous_difference |v|)", BodyEffort(asymmetric_friction),
            "direction-dependent Coulomb and viscous friction",
            f"F{_FRICTION[1:]} {{coulomb_difference}} and {{viscous_difference}} {_HIGHER}",
            sentence_without=(
                ("coulomb_difference", f"Viscous {_FRICTION} {{viscous_difference}} {_HIGHER}"),
                ("viscous_difference", f"Dry (Coulomb) {_FRICTION} {{coulomb_difference}} {_HIGHER}"),
            ),
            conceal=_difference_range, starts=_share_of_damping, of_both_signs="speed",
        ),
        Effect(
            "cogging", kind, (level, axis.wave, Parameter("phase", "rad", -3.2, 3.2, 0.0, role=Role.ANGLE)),
            f"{effort} sin({axis.wave.name} q + phase)", BodyEffort(periodic),
            "position-periodic force of magnets or of a screw",
            f"A ripple of {{{effort}}} that depends on the position ({{{axis.wave.name}}}) acts at the {{location}}.",
            conceal=_effort_range, draws=_cogging_draws(axis), starts=_share_of_force,
        ),
        Effect(
            axis.load, kind, (Parameter(effort, unit, -top, top, size / 2, 0.0, role=Role.SIZE),),
            effort, BodyEffort(constant), "constant",
            f"A constant {effort} of {{{effort}}} acts at the {{location}}.",
            conceal=_effort_range, starts=_share_of_force,
            alias=Alias("coulomb_friction", "asymmetric_friction", "coulomb_difference", SAME_AS_LOAD),
        ),
    ]  # fmt: skip


def _absorber_starts(place: Place) -> list[Values]:
    low, high = place.modes[0] / BELOW, min(ABOVE * place.modes[1], 0.25 / place.sample_time_s)
    if not 0.0 < low < high:
        low, high = 10.0 / place.duration_s, 0.1 / place.sample_time_s
    return [{"size": 0.05 * place.values["mass"], "frequency": float(f)} for f in np.geomspace(low, high, ABSORBERS)]


def _absorber_draws(rng: Generator, place: Place) -> Values:
    low, high = place.modes
    return {
        "frequency": float(rng.uniform(0.7 * low, 2.2 * high)), "damping_ratio": float(rng.uniform(0.01, 0.12)),
    }  # fmt: skip


def _gravity_draws(rng: Generator, place: Place) -> Values:
    return {"phase": float(rng.uniform(-3.1, 3.1))}


def lowest(phase: float) -> float:
    """The angle at which an off-centre mass hangs down, rad, -pi to pi."""
    return math.remainder(math.pi - phase, 2.0 * math.pi)


def _hangs(values: Values) -> str:
    return f" It hangs down at {math.degrees(lowest(values['phase'])) + 0.0:.0f}°."


GRAVITY = Effect(
    "gravity", "rotor",
    (
        Parameter("torque", "N m", 0.0, HIGH, 0.02, 0.0, role=Role.SIZE),
        Parameter("phase", "rad", -3.2, 3.2, 0.0, role=Role.ANGLE),
    ),
    "torque sin(theta + phase)", BodyEffort(gravity), "off-centre mass, torque = m g l",
    "Gravity pulls an off-centre mass at the {location} with {torque}.", remark=_hangs,
    turned="a mass that hangs down at the angle 0 has", conceal=_effort_range, draws=_gravity_draws,
    starts=_share_of_force, simpler_at=within_a_line("constant_load"),
)  # fmt: skip

ABSORBER = Effect(
    "absorber", "mass",
    (
        Parameter("mass", "kg", 0.0, HIGH, 0.3, 0.0, role=Role.SIZE),
        Parameter("frequency", "Hz", 1e-4, 1e6, 12.0, role=Role.FREQUENCY),
        Parameter("damping_ratio", "1", 0.0, 2.0, 0.05),
    ),
    "a hidden mass on a spring of (2 pi frequency)^2 mass", HiddenBody("mass", "frequency", "damping_ratio"),
    "den Hartog's absorber", "A hidden mass of {mass} swings on {location} at {frequency}.",
    conceal=lambda place, sign: (place.values["mass"], 0.03 * place.values["mass"]), draws=_absorber_draws,
    starts=_absorber_starts,
)  # fmt: skip

_MASS = [
    Effect(
        "ground_friction", "mass", (Parameter("force", "N", 0.0, HIGH, 0.2, 0.0, role=Role.SIZE),),
        "-force sign(v), |.| <= force at v = 0", Contact(coulomb), "Coulomb friction against the ground",
        "Dry friction of {force} holds {location} against the ground.",
        conceal=_effort_range, starts=_share_of_force, formulation_error=REST_ERROR,
    ),
    Effect(
        "constant_force", "mass", (Parameter("force", "N", -HIGH, HIGH, 0.5, 0.0, role=Role.SIZE),),
        "force", BodyEffort(constant), "constant", "A constant force of {force} acts on {location}.",
        conceal=_effort_range, starts=_share_of_force,
    ),
    Effect(
        "viscous_friction", "mass", (Parameter("coefficient", "N s/m", 0.0, HIGH, 1.0, 0.0, role=Role.SIZE),),
        "-coefficient v", BodyDamping("coefficient"), "linear",
        "Viscous friction of {coefficient} acts between {location} and the ground.",
        conceal=_viscous_range, starts=_share_of_damping,
    ),
    _drag("mass", "N s^2/m^2", 100.0),
    _coasting("mass", "N s/m", 1.0),
    ABSORBER,
]  # fmt: skip

_CARRIAGE = _bearing(_LINEAR)
_JOINTS = [replace(e, kind="turning_joint") for e in (*_bearing(_ROTARY), GRAVITY)]
_JOINTS += [replace(e, kind="sliding_joint") for e in _CARRIAGE]
_JOINTS = [e for e in _JOINTS if e.name != "coasting"]  # a simulator's model says what each of its drives exerts

EFFECTS = [
    *_bearing(_ROTARY), GRAVITY, *_CARRIAGE, replace(ABSORBER, kind="carriage"), *_MASS,
    # a brake's dry friction is one of its parameters
    *(replace(e, kind="brake") for e in _CARRIAGE if e.name not in ("coulomb_friction", "cogging", "coasting")),
    *_JOINTS,
]  # fmt: skip
