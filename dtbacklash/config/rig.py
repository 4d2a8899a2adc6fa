"""The schema of a rig: named parameters, named elements, the effects that act on them, and the sensors.

A rig is described by one YAML file (``conf/rig/*.yaml`` or a file of the user's). This module checks its
form; what an element needs and which effects it takes stand in :mod:`dtbacklash.physics.kinds` and
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


@dataclass
class ParameterConfig:
    """One physical parameter of a rig: its nominal value, and how far from it the truth may lie.

    value : in SI, or a text with a unit such as ``0.5 N/mm``; a rig has it in SI.
    """

    value: Any
    unit: str = ""
    tolerance: float = 0.1  # relative, one standard deviation of the prior
    description: str = ""


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
        dict,
        "name -> of (element), quantity, recorded_in (unit of its column; SI), absolute (false); see below",
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
        for name, parameter in self.parameters.items():
            key = f"rig.parameters.{name}"
            value, unit = in_si(f"{key}.value", parameter.value, parameter.unit)
            _check_tolerance(f"{key}.tolerance", parameter.tolerance)
            self.parameters = {**self.parameters, name: replace(parameter, value=value, unit=unit)}
        for name, sensor in self.sensors.items():
            if not isinstance(sensor, dict) or not {"of", "quantity"} <= set(sensor):
                raise UserError(f"rig.sensors.{name}", sensor, "a mapping with `of` and `quantity`")
        self._check_effects()

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

    def _check_effects(self) -> None:
        for location, effects in self.effects.items():
            if not isinstance(effects, dict):
                raise UserError(f"rig.effects.{location}", effects, "a mapping effect -> {parameter: value}")
            for effect, values in effects.items():
                key = f"rig.effects.{location}.{effect}"
                if not isinstance(values, dict):
                    raise UserError(key, values, "a mapping parameter -> value")
                for parameter, value in values.items():
                    _check_value(f"{key}.{parameter}", value)


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


def _check_value(key: str, value: object) -> None:
    """An effect's parameter is a number, or a mapping with its ``value`` and its ``tolerance``."""
    if isinstance(value, dict) and set(value) == {"value", "tolerance"}:
        _check_value(f"{key}.value", value["value"])
        _check_tolerance(f"{key}.tolerance", value["tolerance"])
    elif not is_number(value):
        raise UserError(key, value, "a number, or {value: number, tolerance: relative, one standard deviation}")


def _check_tolerance(key: str, value: object) -> None:
    if not is_number(value) or not 0.0 <= float(value) <= TOLERANCE_MAX:  # type: ignore[arg-type]
        raise UserError(key, value, f"a relative tolerance from 0 to {TOLERANCE_MAX:g}")
