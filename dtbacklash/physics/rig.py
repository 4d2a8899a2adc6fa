"""A rig whose description has been checked: elements in order, values resolved, effects complete."""

from dataclasses import dataclass, field, replace
from typing import Any

from dtbacklash.config.rig import ParameterConfig, RigConfig, finite
from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue
from dtbacklash.physics.elements import BODY_KINDS, GROUND, KINDS, LINK_KINDS, QUANTITIES, SLIDING_KINDS

SENSOR_PREFIX = "sensor_"
Effects = dict[str, dict[str, dict[str, float]]]


@dataclass(frozen=True)
class Element:
    """One element with the values of its parameters (SI) and the names of its neighbours."""

    name: str
    kind: str
    values: dict[str, float] = field(default_factory=dict)
    neighbours: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Sensor:
    """What one sensor measures: ``quantity`` of the element ``of``, in ``unit``."""

    name: str
    of: str
    quantity: str
    unit: str


@dataclass(frozen=True)
class Rig:
    """A checked rig. Build it with :func:`build_rig`; it never changes, ``with_*`` give changed copies."""

    config: RigConfig
    elements: dict[str, Element]
    effects: Effects
    sensors: dict[str, Sensor]

    def of_kind(self, kind: str) -> list[Element]:
        """All elements of a kind, in order."""
        return [e for e in self.elements.values() if e.kind == kind]

    def links(self) -> list[Element]:
        """All links and couplings, in order."""
        return [e for e in self.elements.values() if e.kind in LINK_KINDS]

    def only(self, kind: str) -> Element | None:
        """The single element of a kind, or None."""
        found = self.of_kind(kind)
        return found[0] if found else None

    def kind_at(self, location: str) -> str:
        """The kind at a location of the vocabulary: an element's name or ``sensor_<name>``."""
        if location in self.elements:
            return self.elements[location].kind
        if location.removeprefix(SENSOR_PREFIX) in self.sensors and location.startswith(SENSOR_PREFIX):
            return "sensor"
        places = [*self.elements, *(SENSOR_PREFIX + s for s in self.sensors)]
        raise UserError(f"rig.effects.{location}", location, f"unknown location; known: {', '.join(places)}")

    def effect(self, location: str, name: str) -> dict[str, float] | None:
        """The parameters of an effect that is switched on, else None."""
        return self.effects.get(location, {}).get(name)

    def with_effect(self, location: str, name: str, values: dict[str, float] | None) -> "Rig":
        """A copy with one effect set (or, with None, taken out). Raises UserError if it does not fit."""
        effects = {place: dict(there) for place, there in self.config.effects.items()}
        effects.setdefault(location, {}).pop(name, None)
        if values is not None:
            effects[location][name] = dict(values)
        return build_rig(replace(self.config, effects={p: e for p, e in effects.items() if e}))

    def with_parameters(self, values: dict[str, float]) -> "Rig":
        """A copy with some nominal parameters changed (SI)."""
        parameters = dict(self.config.parameters)
        for name, value in values.items():
            if name not in parameters:
                allowed = f"unknown parameter; known: {', '.join(parameters)}"
                raise UserError(f"rig.parameters.{name}", value, allowed)
            parameters[name] = replace(parameters[name], value=float(value))
        return build_rig(replace(self.config, parameters=parameters))


def build_rig(config: RigConfig) -> Rig:
    """Check a rig's description and resolve it.

    Raises
    ------
    UserError : an unknown kind, field, parameter, neighbour, effect or sensor; a value out of bounds.
    """
    elements = {name: _element(name, spec, config.parameters) for name, spec in config.elements.items()}
    _check_neighbours(elements)
    sensors = {name: _sensor(name, spec, elements) for name, spec in config.sensors.items()}
    rig = Rig(config, elements, {}, sensors)
    effects: Effects = {}
    for location, there in config.effects.items():
        kind = rig.kind_at(location)
        for name, values in there.items():
            key = f"rig.effects.{location}.{name}"
            effect = catalogue.find(kind, name, key)
            filled = effect.complete(values, key)
            if not effect.is_neutral(filled):
                effects.setdefault(location, {})[name] = filled
    return replace(rig, effects=effects)


def _element(name: str, spec: dict[str, Any], parameters: dict[str, ParameterConfig]) -> Element:
    key = f"rig.elements.{name}"
    kind = KINDS.get(spec["kind"]) if isinstance(spec["kind"], str) else None
    if kind is None:
        raise UserError(f"{key}.kind", spec["kind"], f"choose one of {', '.join(KINDS)}")
    if name == GROUND or name.startswith(SENSOR_PREFIX):
        raise UserError(key, name, f"a name other than `{GROUND}` and not beginning with `{SENSOR_PREFIX}`")
    units = {**kind.required, **kind.optional}
    unknown = set(spec) - {"kind", *units, *kind.neighbours}
    if unknown:
        allowed = f"unknown field; a {kind.name} has {', '.join([*units, *kind.neighbours])}"
        raise UserError(f"{key}.{min(unknown)}", spec[min(unknown)], allowed)
    values = {}
    for field_name, unit in units.items():
        if field_name in spec:
            values[field_name] = _value(f"{key}.{field_name}", spec[field_name], unit, parameters)
        elif field_name in kind.required:
            raise UserError(f"{key}.{field_name}", "(missing)", f"the name of a parameter in {unit}")
    for neighbour in kind.neighbours:
        if neighbour not in spec and neighbour != "carries":
            raise UserError(f"{key}.{neighbour}", "(missing)", "the name of another element")
    return Element(name, kind.name, values, {n: spec[n] for n in kind.neighbours if n in spec})


def _value(key: str, name: object, unit: str, parameters: dict[str, ParameterConfig]) -> float:
    if not isinstance(name, str) or name not in parameters:
        raise UserError(key, name, f"the name of one of the rig's parameters: {', '.join(parameters)}")
    parameter = parameters[name]
    if parameter.unit and parameter.unit != unit:
        raise UserError(f"rig.parameters.{name}.unit", parameter.unit, f"{unit}, as {key} needs it")
    value = finite(f"rig.parameters.{name}.value", parameter.value)
    damping_like = key.endswith(("damping", "stiffness"))
    if value < 0.0 or (value == 0.0 and not damping_like):
        raise UserError(f"rig.parameters.{name}.value", value, f"above 0 {unit}")
    return value


#: role -> kinds of element that may stand there; `between` also takes the ground
_PARTNERS = {
    ("amplifier", "drives"): ("motor_circuit", "actuator"),
    ("motor_circuit", "drives"): ("rotor", "carriage", "mass"),
    ("actuator", "drives"): SLIDING_KINDS,
    ("gear", "driven_by"): ("rotor",),
    ("screw", "driven_by"): ("gear",),
    ("screw", "carries"): ("mass", "carriage"),
    ("link", "between"): SLIDING_KINDS,
    ("coupling", "between"): (*SLIDING_KINDS, "positioner"),
}


def _check_neighbours(elements: dict[str, Element]) -> None:
    if not any(e.kind in BODY_KINDS for e in elements.values()):
        raise UserError("rig.elements", ", ".join(elements) or "(none)", f"at least one {', '.join(BODY_KINDS)}")
    singles: tuple[tuple[str, ...], ...] = (
        ("amplifier",),
        ("motor_circuit", "actuator", "positioner"),
        ("rotor",),
        ("gear",),
        ("screw", "positioner"),
    )
    for kinds in singles:
        names = [e.name for e in elements.values() if e.kind in kinds]
        if len(names) > 1:
            raise UserError("rig.elements", ", ".join(names), f"at most one element of kind {' or '.join(kinds)}")
    for element in elements.values():
        for role, target in element.neighbours.items():
            key = f"rig.elements.{element.name}.{role}"
            names = target if role == "between" else [target]
            if role == "between" and (not isinstance(names, list) or len(names) != 2 or names[0] == names[1]):
                raise UserError(key, target, "two different bodies, e.g. [mass_1, mass_2] or [ground, mass_1]")
            for name in names:
                if role == "between" and name == GROUND:
                    continue
                kinds = _PARTNERS[element.kind, role]
                fitting = [e.name for e in elements.values() if e.kind in kinds]
                if not isinstance(name, str) or name not in fitting:
                    allowed = f"an element of kind {' or '.join(kinds)}: {', '.join(fitting) or 'the rig has none'}"
                    raise UserError(key, name, allowed)


def _sensor(name: str, spec: dict[str, Any], elements: dict[str, Element]) -> Sensor:
    of, quantity = spec["of"], spec["quantity"]
    unknown = sorted(str(key) for key in set(spec) - {"of", "quantity"})
    if unknown:
        key = f"rig.sensors.{name}.{unknown[0]}"
        raise UserError(key, spec[unknown[0]], "unknown; a sensor has `of` and `quantity`")
    measurable = [e.name for e in elements.values() if e.kind in QUANTITIES]
    if of not in measurable:
        raise UserError(f"rig.sensors.{name}.of", of, f"choose one of {', '.join(measurable)}")
    units = QUANTITIES[elements[of].kind]
    if not isinstance(quantity, str) or quantity not in units:
        raise UserError(f"rig.sensors.{name}.quantity", quantity, f"at {of}: {', '.join(units)}")
    return Sensor(name, of, quantity, units[quantity])
