"""A law as a table: values over one state, smooth between knots, constant beyond, and perhaps times another state.

What no law of the catalogue explains can be modelled so. Between two knots the law is the cubic that has their values
and, at each, the slope of the parabola through it and the knots beside it (Catmull and Rom, Computer Aided Geometric
Design (1974) 317); at the ends the slope is that of the last interval. So it is linear in its values, and one knot acts
over four intervals. Times another state it is a coefficient that varies: a damping that depends on the position.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.physics.effects.body import HIGH
from dtbacklash.physics.effects.declare import Effect, Parameter, Role, Values
from dtbacklash.physics.effects.formula import SHORT
from dtbacklash.physics.effects.slots import BodyEffort, Command, Law, Slot, SpringForce

#: values of a table
KNOTS = 16
VALUES = tuple(f"f{k + 1}" for k in range(KNOTS))
STATES = tuple(f"x{k + 1}" for k in range(KNOTS))
#: no state of a machine is larger, SI
FAR = 1e12
SOURCE = "Catmull and Rom, Computer Aided Geometric Design (1974) 317"


def interpolated(state, row):
    """The table ``row`` (its values, then the states of its knots) at a state."""
    if not state > row[KNOTS]:
        return row[0]
    if not state < row[2 * KNOTS - 1]:
        return row[KNOTS - 1]
    k, end = 0, KNOTS - 1
    while end - k > 1:
        middle = (k + end) // 2
        if state < row[KNOTS + middle]:
            end = middle
        else:
            k = middle
    wide, rise = row[KNOTS + k + 1] - row[KNOTS + k], row[k + 1] - row[k]
    first = last = rise
    if k > 0:
        before = row[KNOTS + k] - row[KNOTS + k - 1]
        first = wide * (wide * (row[k] - row[k - 1]) / before + before * rise / wide) / (before + wide)
    if k < KNOTS - 2:
        after = row[KNOTS + k + 2] - row[KNOTS + k + 1]
        last = wide * (after * rise / wide + wide * (row[k + 2] - row[k + 1]) / after) / (wide + after)
    w = (state - row[KNOTS + k]) / wide
    return row[k] + w * (first + w * (3.0 * rise - 2.0 * first - last + w * (first + last - 2.0 * rise)))


def over_speed(velocity, row):
    """An effort over the speed of a body."""
    return interpolated(velocity, row)


def over_position(position, row):
    """An effort over the position of a body."""
    return interpolated(position, row)


def damping_over_position(position, velocity, row):
    """A damping that depends on the position of a body, times its speed."""
    return interpolated(position, row) * velocity


def over_stretch(stretch, row):
    """A spring's effort over its stretch."""
    return interpolated(stretch, row)


def over_stretch_rate(stretch_rate, row):
    """A spring's effort over the rate of its stretch."""
    return interpolated(stretch_rate, row)


def damping_over_stretch(stretch, stretch_rate, row):
    """A damping that depends on the stretch of a spring, times its rate."""
    return interpolated(stretch, row) * stretch_rate


def stiffness_over_rate(stretch, stretch_rate, row):
    """A stiffness that depends on the rate of a spring's stretch, times the stretch."""
    return interpolated(stretch_rate, row) * stretch


def beside_command(command, row):
    """The command with a voltage over it added. V -> V."""
    return command + interpolated(command, row)


@dataclass(frozen=True)
class Shape:
    """What a table is over, as reports name states; ``times`` : the state that it is multiplied by, or empty."""

    over: str
    times: str = ""


#: the name of a table -> what it is over
SHAPES = {
    "speed_table": Shape("speed"), "position_table": Shape("position"),
    "position_damping_table": Shape("position", "speed"),
    "stretch_table": Shape("stretch"), "stretch_rate_table": Shape("stretch rate"),
    "stretch_damping_table": Shape("stretch", "stretch rate"),
    "rate_stiffness_table": Shape("stretch rate", "stretch"),
    "command_table": Shape("command"),
}  # fmt: skip

#: what a table is over -> the short name of this state in formulas
STATE = {"speed": "v", "position": "q", "stretch": "s", "stretch rate": "ds", "command": "u"}


def weights(states: Floats, knots: Floats) -> Floats:
    """(N, KNOTS) what each value of a table over these knots adds at these states: the law is linear in them."""
    function = interpolated
    return np.array([[function(float(s), [*unit, *knots]) for unit in np.eye(KNOTS)] for s in states])


def table_values(knots: Floats, efforts: Floats, bend: float) -> Values:
    """The parameters of a table: (KNOTS,) efforts at (KNOTS,) states, and how far it may bend."""
    pairs = [*zip(VALUES, efforts, strict=True), *zip(STATES, knots, strict=True)]
    return {**{name: float(value) for name, value in pairs}, "bend": bend}


def table_of(values: Values) -> tuple[Floats, Floats]:
    """(KNOTS,) states and (KNOTS,) efforts of a table."""
    return np.array([values[name] for name in STATES]), np.array([values[name] for name in VALUES])


def bends(knots: Floats) -> Floats:
    """(KNOTS - 2, KNOTS) by which the values of a table give how it bends at each inner knot, in their unit.

    Its squares add up to the integral of the squared second derivative, as of a smoothing spline (Green and Silverman,
    Nonparametric Regression (1994), section 2.1), times the cubed range of the states.
    """
    slopes = np.diff(np.eye(KNOTS), axis=0) / np.diff(knots)[:, None]
    apart = 0.5 * (knots[2:] - knots[:-2])
    turned: Floats = np.diff(slopes, axis=0) * np.sqrt(np.ptp(knots) ** 3 / apart)[:, None]
    return turned


def _backwards(values: Values) -> tuple[str, str] | None:
    for first, second in pairwise(STATES):
        if not values[first] < values[second]:
            return second, f"above {first}, {values[first]:g}: a table runs upwards"
    return None


def _table(name: str, kind: str, units: tuple[str, str], slot: Slot) -> Effect:
    """The table of one kind of element; ``units`` : of the state and of the values."""
    shape, unit = SHAPES[name], units[1]
    times = f" {shape.times}" if shape.times else ""
    return Effect(
        name, kind,
        (
            *(Parameter(value, unit, -HIGH, HIGH, 1e-2, 0.0, role=Role.KNOT) for value in VALUES),
            *(
                Parameter(at, units[0], -FAR, FAR, -1.0 + 2.0 * k / (KNOTS - 1), role=Role.GIVEN)
                for k, at in enumerate(STATES)
            ),
            Parameter("bend", unit, 0.0, FAR, 1.0, role=Role.GIVEN),
        ),
        f"table(f1..f{KNOTS} at x1..x{KNOTS}; {shape.over}){times}", slot, SOURCE,
        f"What no law explains at the {{location}} is a table over its {shape.over}.",
        conceal=lambda place, sign: (0.0, 0.0), refuse=_backwards,
        covered=lambda values: {SHORT[STATE[shape.over]]: (values[STATES[0]], values[STATES[-1]])},
    )  # fmt: skip


def _tables(
    kinds: tuple[str, ...], laws: dict[str, Law], units: dict[str, tuple[str, str]], slot: type
) -> list[Effect]:
    return [_table(name, kind, units[name], slot(function)) for kind in kinds for name, function in laws.items()]


_BODY: dict[str, Law] = {
    "speed_table": over_speed, "position_table": over_position, "position_damping_table": damping_over_position,
}  # fmt: skip
_SPRING: dict[str, Law] = {
    "stretch_table": over_stretch, "stretch_rate_table": over_stretch_rate,
    "stretch_damping_table": damping_over_stretch, "rate_stiffness_table": stiffness_over_rate,
}  # fmt: skip


def _units(at: str, rate: str, effort: str, damping: str, stiffness: str) -> dict[str, tuple[str, str]]:
    """The name of a table -> the units of its state and its values, on one axis."""
    return {
        "speed_table": (rate, effort), "position_table": (at, effort), "position_damping_table": (at, damping),
        "stretch_table": (at, effort), "stretch_rate_table": (rate, effort), "stretch_damping_table": (at, damping),
        "rate_stiffness_table": (rate, stiffness),
    }  # fmt: skip


_TURNING = _units("rad", "rad/s", "N m", "N m s/rad", "N m/rad")
_SLIDING = _units("m", "m/s", "N", "N s/m", "N/m")

EFFECTS = [
    *_tables(("rotor",), _BODY, _TURNING, BodyEffort),
    *_tables(("carriage", "brake", "mass"), _BODY, _SLIDING, BodyEffort),
    *_tables(("link", "coupling", "belt", "rack"), _SPRING, _SLIDING, SpringForce),
    *_tables(("shaft", "gearbox"), _SPRING, _TURNING, SpringForce),
    _table("command_table", "amplifier", ("V", "V"), Command(beside_command)),
    *_tables(("turning_joint",), _BODY, _TURNING, BodyEffort),
    *_tables(("sliding_joint",), _BODY, _SLIDING, BodyEffort),
]
