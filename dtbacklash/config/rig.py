"""The schema of a rig: named parameters, named elements, the effects that act on them, and the sensors.

A rig is described by one YAML file (``conf/rig/*.yaml`` or a file of the user's). This module checks its
form; what an element needs and which effects it takes stand in :mod:`dtbacklash.physics.elements` and
:mod:`dtbacklash.physics.catalogue`, and :mod:`dtbacklash.physics.rig` checks the content.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from dtbacklash.errors import UserError


def finite(key: str, value: float, allowed: str = "a finite number") -> float:
    """Return ``value`` as a float or refuse it in the name of ``key``."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise UserError(key, value, allowed) from None
    if not math.isfinite(number):
        raise UserError(key, value, allowed)
    return number


@dataclass
class ParameterConfig:
    """One physical parameter of a rig: its nominal value, in SI, and how far from it the truth may lie."""

    value: float
    unit: str = ""
    tolerance: float = 0.1  # relative, one standard deviation of the prior
    description: str = ""


@dataclass
class RigConfig:
    """A rig as its YAML file states it.

    Attributes
    ----------
    parameters : name -> value, unit, relative tolerance. Elements refer to parameters by name, so that two
        links may share one stiffness ``k``.
    elements : name -> ``{kind: ..., <field>: <parameter name>, ...}`` in the order of the power flow.
    effects : element -> effect -> parameter -> value; the vocabulary is that of the catalogue.
    sensors : name -> ``{of: <element>, quantity: position|velocity|current}``.
    """

    name: str = "rig"
    description: str = ""
    parameters: dict[str, ParameterConfig] = field(default_factory=dict)
    elements: dict[str, Any] = field(default_factory=dict)
    effects: dict[str, Any] = field(default_factory=dict)
    sensors: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, parameter in self.parameters.items():
            key = f"rig.parameters.{name}"
            finite(f"{key}.value", parameter.value)
            if not 0.0 <= parameter.tolerance < 1.0:
                raise UserError(f"{key}.tolerance", parameter.tolerance, "a relative tolerance from 0 to below 1")
        for name, element in self.elements.items():
            if not isinstance(element, dict) or "kind" not in element:
                raise UserError(f"rig.elements.{name}", element, "a mapping with at least `kind`")
        for name, sensor in self.sensors.items():
            if not isinstance(sensor, dict) or not {"of", "quantity"} <= set(sensor):
                raise UserError(f"rig.sensors.{name}", sensor, "a mapping with `of` and `quantity`")
        self._check_effects()

    def _check_effects(self) -> None:
        for location, effects in self.effects.items():
            if not isinstance(effects, dict):
                raise UserError(f"rig.effects.{location}", effects, "a mapping effect -> {parameter: value}")
            for effect, values in effects.items():
                key = f"rig.effects.{location}.{effect}"
                if not isinstance(values, dict):
                    raise UserError(key, values, "a mapping parameter -> value")
                for parameter, value in values.items():
                    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
                        raise UserError(f"{key}.{parameter}", value, "a number")
