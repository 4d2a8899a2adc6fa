"""A law as a table: an effort at evenly spaced values of one state, smooth between them, constant beyond the ends.

What no law of the catalogue explains can be modelled so. Between two knots the law is the cubic that has their values
and the slopes that the knots beside them give (Catmull and Rom, Computer Aided Geometric Design (1974) 317); at the
ends the slope is that of the last interval. So it is linear in its values, and one knot acts over four intervals.
"""

from __future__ import annotations

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.compiled import inlined, law
from dtbacklash.physics.effects.body import HIGH
from dtbacklash.physics.effects.declare import Effect, Parameter, Role, Values
from dtbacklash.physics.effects.slots import BodyEffort, Command, Slot, SpringForce

#: values of a table
KNOTS = 16
VALUES = tuple(f"f{k + 1}" for k in range(KNOTS))
#: no state of a machine is larger, SI
FAR = 1e12
SOURCE = "Catmull and Rom, Computer Aided Geometric Design (1974) 317"


@inlined
def interpolated(state, row):
    """The table ``row`` (its values, then the first and the last state) at a state."""
    at = (state - row[KNOTS]) / (row[KNOTS + 1] - row[KNOTS]) * (KNOTS - 1)
    if not at > 0.0:
        return row[0]
    if not at < KNOTS - 1.0:
        return row[KNOTS - 1]
    k = int(at)
    w, a, b = at - k, row[k], row[k + 1]
    first = 0.5 * (b - row[k - 1]) if k > 0 else b - a
    last = 0.5 * (row[k + 2] - a) if k < KNOTS - 2 else b - a
    rise = b - a
    return a + w * (first + w * (3.0 * rise - 2.0 * first - last + w * (first + last - 2.0 * rise)))


@law
def over_speed(velocity, row):
    """An effort over the speed of a body."""
    return interpolated(velocity, row)


@law
def over_position(position, row):
    """An effort over the position of a body."""
    return interpolated(position, row)


@law
def over_stretch(stretch, row):
    """A spring's effort over its stretch."""
    return interpolated(stretch, row)


@law
def over_stretch_rate(stretch_rate, row):
    """A spring's effort over the rate of its stretch."""
    return interpolated(stretch_rate, row)


@law
def beside_command(command, row):
    """The command with a voltage over it added. V -> V."""
    return command + interpolated(command, row)


def weights(states: Floats, low: float, high: float) -> Floats:
    """(N, KNOTS) what each knot of a table from ``low`` to ``high`` adds at these states: the law is linear in them."""
    function, ends = interpolated.py_func, [low, high]
    return np.array([[function(float(s), [*unit, *ends]) for unit in np.eye(KNOTS)] for s in states])


def table_values(efforts: Floats, low: float, high: float, bend: float) -> Values:
    """The parameters of a table: (KNOTS,) efforts at evenly spaced states from ``low`` to ``high``."""
    return {**dict(zip(VALUES, map(float, efforts), strict=True)), "low": low, "high": high, "bend": bend}


def efforts_of(values: Values) -> tuple[Floats, Floats]:
    """(KNOTS,) states and (KNOTS,) efforts of a table."""
    return np.linspace(values["low"], values["high"], KNOTS), np.array([values[name] for name in VALUES])


def _backwards(values: Values) -> tuple[str, str] | None:
    if values["low"] < values["high"]:
        return None
    return "high", f"above low, {values['low']:g}: a table runs upwards"


def _table(kind: str, state: str, units: tuple[str, str], slot: Slot) -> Effect:
    """The table of one kind of element over one state; ``units`` : of the state and of the effort."""
    words, unit = state.replace("_", " "), units[1]
    return Effect(
        f"{state}_table", kind,
        (
            *(Parameter(name, unit, -HIGH, HIGH, 1e-2, 0.0, role=Role.KNOT) for name in VALUES),
            Parameter("low", units[0], -FAR, FAR, -1.0, role=Role.GIVEN),
            Parameter("high", units[0], -FAR, FAR, 1.0, role=Role.GIVEN),
            Parameter("bend", unit, 0.0, HIGH, 1e-2, role=Role.GIVEN),
        ),
        f"f1 to f{KNOTS}, evenly from low to high over the {words}, smooth between, constant beyond", slot, SOURCE,
        f"What no law explains at the {{location}} is a table over its {words}, from {{low}} to {{high}}.",
        conceal=lambda place, sign: (0.0, 0.0), refuse=_backwards,
    )  # fmt: skip


EFFECTS = [
    *(
        _table(kind, state, (unit, effort), BodyEffort(over))
        for kinds, position, speed, effort in (
            (("rotor",), "rad", "rad/s", "N m"), (("carriage", "brake", "mass"), "m", "m/s", "N"),
        )
        for kind in kinds
        for state, unit, over in (("speed", speed, over_speed), ("position", position, over_position))
    ),
    *(
        _table(kind, state, (unit, effort), SpringForce(over))
        for kinds, stretch, rate, effort in (
            (("link", "coupling"), "m", "m/s", "N"), (("shaft",), "rad", "rad/s", "N m"),
        )
        for kind in kinds
        for state, unit, over in (("stretch", stretch, over_stretch), ("stretch_rate", rate, over_stretch_rate))
    ),
    _table("amplifier", "command", ("V", "V"), Command(beside_command)),
]  # fmt: skip
