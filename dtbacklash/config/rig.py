"""The schema of a rig: named parameters, named elements, the effects that act on them, and the sensors.

A rig is described by one YAML file (``conf/rig/*.yaml`` or a file of the user's). This module checks its
form; what an element needs and which effects it takes stand in :mod:`dtbacklash.physics.element_kinds` and
:mod:`dtbacklash.physics.catalogue`, and :mod:`dtbacklash.physics.rig` checks the content.
"""

import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from dtbacklash import units
from dtbacklash.config.setting import setting
from dtbacklash.errors import UserError

#: a relative tolerance, one standard deviation, is at most this: the value may be ten times as large
TOLERANCE_MAX = 10.0
#: fields whose number, where it stands in an element, is known exactly: teeth are counted
KNOWN = {"ratio": 0.0}


#: a number, maybe with its unit, and no name
_NUMBER_FIRST = re.compile(r"[-+]?\.?\d")


def finite(key: str, value: Any, allowed: str = "a finite number") -> float:
    """Return ``value`` as a float or refuse it in the name of ``key``."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise UserError(key, value, allowed) from None
    if not math.isfinite(number):
        raise UserError(key, value, allowed)
    return number


def in_si(key: str, value: object, unit: str = "") -> tuple[float, str]:
    """A value and its unit in SI: of a number with the unit beside it, or of a text such as ``0.5 N/mm``.

    Raises UserError: no finite number, a unit that is unknown or said twice.
    """
    number: Any = value
    written = unit
    if isinstance(value, str):
        number, _, written = value.strip().partition(" ")
        if written and unit:
            raise UserError(key, value, f"gives its unit twice (unit: {unit})")
        written = written or unit
    size = finite(key, number, "must be a finite number, SI, or with its unit as in 0.5 N/mm, with a decimal point")
    found = units.composed(written) if written else units.Unit("", 1.0)
    if found is None:
        raise UserError(key, value, f"the unit {written} is unknown; written as in N/mm, kg cm^2, mm/rev, N m/A")
    return size * found.factor, found.si


class Quantity(float):
    """A number in SI that was written with its unit: whoever knows what it is of asks whether the unit fits.

    unit : its SI unit, empty where none was written. written : as it stands in the file.
    """

    def __new__(cls, value: float, unit: str = "", written: str = "") -> "Quantity":
        """The number, with the unit beside it."""
        made = super().__new__(cls, value)
        made.unit, made.written = unit, written
        return made

    unit: str
    written: str

    def in_unit(self, key: str, unit: str) -> float:
        """The number in ``unit``; refused, in the name of ``key``, where its own is of another kind."""
        own = units.composed(unit) or units.Unit(unit, 1.0)
        if self.unit and self.unit != own.si:
            raise UserError(key, self.written, f"must be in {unit}" if unit != "1" else "has no unit")
        return self / own.factor if self.unit else float(self)


@dataclass
class ParameterConfig:
    """One physical parameter of a rig: its nominal value, and how far from it the truth may lie.

    value : in SI, or a text with a unit such as ``0.5 N/mm``; a rig has it in SI. ``= k1``: it is the parameter ``k1``.
    fixed : it is known exactly, as with a tolerance of 0. min, max : a fit does not leave them; as ``value``.
    """

    value: Any
    unit: str = ""
    tolerance: Any = 0.1  # relative, one standard deviation of the prior; also as 5 %
    description: str = ""
    fixed: bool = False
    min: Any = None
    max: Any = None

    def within(self, low: float, high: float) -> tuple[float, float]:
        """The bounds of a fit, no wider than the parameter's own."""
        least, most = (end if given is None else given for given, end in ((self.min, low), (self.max, high)))
        return max(low, least), min(high, most)


@dataclass
class RigConfig:
    """A rig as its YAML file states it.

    Elements refer to parameters by name, so that two links may share one stiffness ``k``. A number in a parameter's
    place, ``mass: 2.5`` or ``stiffness: 0.5 N/mm``, becomes a parameter of its own (``link_1_stiffness``).
    """

    name: str = setting("rig", "name of the rig, for reports")
    description: str = setting("", "one line, for reports")
    parameters: dict[str, ParameterConfig] = setting(
        dict, "name -> value, unit, tolerance (relative, one standard deviation), description", unit="SI"
    )
    elements: dict[str, Any] = setting(
        dict, "name -> kind, its fields, its neighbours, in the order of the power flow; see below"
    )
    effects: dict[str, Any] = setting(
        dict, "element -> effect -> parameter -> value, or {value, tolerance} as above; see effects.md", unit="SI"
    )
    sensors: dict[str, Any] = setting(
        dict, "name -> of (element), quantity, recorded_in (unit of its column; SI), absolute (false); see below"
    )
    laws: dict[str, Any] = setting(dict, "laws of one's own: name -> acts_on, law, parameters, ...; see own_laws.md")
    model: str = setting("", "path of a simulator's model (MJCF, FMU) whose joints are the elements; see simulators.md")
    commands: dict[str, Any] = setting(dict, "of a model: column of the log -> actuator, or input of an FMU")
    tolerances: dict[str, Any] = setting(
        dict, "of a model: its number (`joints.NAME.damping`; a parameter of an FMU) -> how far it may be off, one "
        "standard deviation (20 %)"
    )  # fmt: skip
    joints: dict[str, Any] = setting(
        dict, "of an FMU: name -> position, speed (states), force (an input), slides (bool)"
    )
    fixed: list[str] = setting(list, "of a model: joints that never move")

    def __post_init__(self) -> None:
        for name, element in self.elements.items():
            if not isinstance(element, dict) or "kind" not in element:
                raise UserError(f"rig.elements.{name}", element, "a mapping with at least `kind`")
            self._name_numbers(name, element)
        self._tie()
        self.parameters = {name: _in_si(f"rig.parameters.{name}", p) for name, p in self.parameters.items()}
        for name, sensor in self.sensors.items():
            if not isinstance(sensor, dict) or not {"of", "quantity"} <= set(sensor):
                raise UserError(f"rig.sensors.{name}", sensor, "a mapping with `of` and `quantity`")
        self.effects = {place: _effects_there(place, there) for place, there in self.effects.items()}

    @property
    def simulator(self) -> str:
        """What simulates it: "mujoco" or "fmu" the model that it names; empty: the package itself."""
        return "" if not self.model else "fmu" if self.model.lower().endswith(".fmu") else "mujoco"

    @property
    def used(self) -> list[str]:
        """The parameters that elements have, in the order of the elements; all of a simulator's model."""
        if self.model:
            return list(self.parameters)
        named = (name for spec in self.elements.values() for name in spec.values() if isinstance(name, str))
        return [name for name in dict.fromkeys(named) if name in self.parameters]

    def with_values(self, values: Mapping[tuple[str, ...], float]) -> "RigConfig":
        """A copy with other values, SI; tolerances stay. values : (parameter,) or (place, effect, parameter) -> its."""
        parameters = dict(self.parameters)
        effects = {p: {n: dict(leaves) for n, leaves in there.items()} for p, there in self.effects.items()}
        for (first, *rest), value in values.items():
            if not rest:
                parameters[first] = replace(parameters[first], value=value)
                continue
            effect, name = rest
            leaves = effects[first][effect]
            leaf = leaves.get(name)
            leaves[name] = {**leaf, "value": value} if isinstance(leaf, dict) else value
        return replace(self, parameters=parameters, effects=effects)

    def _tie(self) -> None:
        """Give elements the parameter itself that another one is said to be: the two are one."""
        tied = {
            name: p.value.strip()[1:].strip() for name, p in self.parameters.items()
            if isinstance(p.value, str) and p.value.strip().startswith("=")
        }  # fmt: skip
        own = {name: p for name, p in self.parameters.items() if name not in tied}
        for name, other in tied.items():
            if other not in own:
                raise UserError(f"rig.parameters.{name}.value", f"= {other}", f"must be one of {', '.join(own)}")
        if tied:
            self.parameters = own
            self.elements = {
                element: {f: tied.get(v, v) if isinstance(v, str) else v for f, v in fields.items()}
                for element, fields in self.elements.items()
            }

    def _name_numbers(self, element: str, fields: dict[str, Any]) -> None:
        """Make parameters of the numbers that stand in an element."""
        for field, value in fields.items():
            if is_number(value) or (isinstance(value, str) and _NUMBER_FIRST.match(value)):
                name = f"{element}_{field}"
                if name in self.parameters:
                    raise UserError(f"rig.elements.{element}.{field}", value, f"there is a parameter {name} already")
                tolerance = KNOWN.get(field, ParameterConfig.tolerance)
                parameter = ParameterConfig(value, tolerance=tolerance, description=f"{field} of {element}")
                self.parameters = {**self.parameters, name: parameter}
                self.elements = {**self.elements, element: {**self.elements[element], field: name}}


def _in_si(key: str, parameter: ParameterConfig) -> ParameterConfig:
    """A parameter with numbers in SI."""
    value, unit = in_si(f"{key}.value", parameter.value, parameter.unit)
    share = 0.0 if parameter.fixed else share_of(f"{key}.tolerance", parameter.tolerance)
    ends: dict[str, Any] = {}
    for end in ("min", "max"):
        if (given := getattr(parameter, end)) is not None:
            ends[end], own = in_si(f"{key}.{end}", given)
            if own not in ("", unit):
                raise UserError(f"{key}.{end}", given, f"must be in {unit or 'SI, as its value is'}")
    low, high = ends.get("min", -math.inf), ends.get("max", math.inf)
    if not low <= value <= high or low == high:
        raise UserError(f"{key}.value", value, f"must lie between its min and max, {low:g} and {high:g}")
    return replace(parameter, value=value, unit=unit, tolerance=share, fixed=False, **ends)


def _effects_there(location: str, effects: object) -> dict[str, Any]:
    """The effects at a place, their values in SI."""
    if not isinstance(effects, dict):
        raise UserError(f"rig.effects.{location}", effects, "a mapping effect -> {parameter: value}")
    for effect, values in effects.items():
        if not isinstance(values, dict):
            raise UserError(f"rig.effects.{location}.{effect}", values, "a mapping parameter -> value")
    return {
        effect: {name: _leaf(f"rig.effects.{location}.{effect}.{name}", value) for name, value in values.items()}
        for effect, values in effects.items()
    }


def share_of(key: str, value: object) -> float:
    """A tolerance, relative: a number, or a text such as ``20 %``."""
    if isinstance(value, str) and value.strip().endswith("%"):
        value = finite(key, value.strip()[:-1], "must be as 20 %, or a number, relative") / 100.0
    _check_tolerance(key, value)
    return float(value)  # type: ignore[arg-type]


def of_the_model(mistake: UserError) -> UserError:
    """The same mistake of a rig's description, where that is what is believed of one."""
    return UserError("model" + mistake.key.removeprefix("rig"), mistake.value, mistake.allowed)


def value_of(leaf: float | dict[str, float]) -> float:
    """The value of an effect's parameter: the number, or the ``value`` beside its ``tolerance``."""
    return leaf["value"] if isinstance(leaf, dict) else leaf


def is_number(value: object, finite: bool = False) -> bool:
    """Whether a value of a YAML file is a number that a float holds, not NaN; ``finite``: and not infinite."""
    if isinstance(value, float):
        return math.isfinite(value) or (math.isinf(value) and not finite)
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _leaf(key: str, value: object) -> float | dict[str, float]:
    """An effect's parameter in SI: a number or one with its unit, or a mapping with that and its ``tolerance``."""
    if isinstance(value, dict) and "value" in value and set(value) <= {"value", "tolerance", "fixed"}:
        number = _leaf(f"{key}.value", value["value"])
        if value.get("fixed") is True and not isinstance(number, dict):
            return {"value": number, "tolerance": 0.0}
        if "tolerance" not in value or isinstance(number, dict):
            return number
        return {"value": number, "tolerance": share_of(f"{key}.tolerance", value["tolerance"])}
    if isinstance(value, str):
        return Quantity(*in_si(key, value), value)
    if not is_number(value):
        allowed = "a number, SI, or with its unit (20 mN m), or {value: 20 mN m, tolerance: 30 %}"
        raise UserError(key, value, allowed)
    return value  # type: ignore[return-value]


def _check_tolerance(key: str, value: object) -> None:
    if not is_number(value) or not 0.0 <= float(value) <= TOLERANCE_MAX:  # type: ignore[arg-type]
        raise UserError(key, value, f"a relative tolerance from 0 to {TOLERANCE_MAX:g}")
