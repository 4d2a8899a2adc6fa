"""A rig whose description has been checked: elements in order, values resolved, effects complete."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from dtbacklash import units
from dtbacklash.config.rig import ParameterConfig, Quantity, RigConfig, finite, value_of
from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue, fmus, mjcf
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import SENSOR_UNIT, Effect, Values
from dtbacklash.physics.element_kinds import AXES, GROUND, KINDS, LINEAR, OPTIONAL_NEIGHBOURS, SENSOR, Kind

SENSOR_PREFIX = "sensor_"
#: what a sensor's zero is called at its place
ZERO = "zero"
#: fields of elements whose names end so may be 0; all others are above
MAY_BE_ZERO = ("damping", "stiffness")
Effects = dict[str, dict[str, dict[str, float]]]
#: per recording, by its number: title -> value, SI
Own = tuple[dict[str, float], ...]
T = TypeVar("T")


@dataclass(frozen=True)
class Element:
    """One element with the values of its parameters (SI) and the names of its neighbours."""

    name: str
    kind: str
    values: dict[str, float] = field(default_factory=dict)
    neighbours: dict[str, Any] = field(default_factory=dict)

    @property
    def trait(self) -> Kind:
        """What its kind says of it."""
        return KINDS[self.kind]

    @property
    def lever(self) -> float:
        """How far a spring's first end goes per unit of the body there: 1, or m/rad of a pulley, or 1/ratio."""
        return self.trait.lever(self.values)


@dataclass(frozen=True)
class Sensor:
    """What one sensor measures: ``quantity`` of the element ``of``, in the SI unit ``unit``.

    ``recorded_in`` is the unit of its column in a recording that says nothing of units; empty: SI. ``absolute`` is a
    sensor of position whose zero is the rig's. Any other begins anywhere: ``zero``, in SI, is what it reads where the
    rig's position is 0; in a diagnosis each recording has its own (:meth:`Rig.of`), a simulation's is 0.
    """

    name: str
    of: str
    quantity: str
    unit: str
    recorded_in: str = ""
    absolute: bool = False
    zero: float = 0.0

    @property
    def relative(self) -> bool:
        """Whether its zero is not known."""
        return self.quantity == "position" and not self.absolute

    @property
    def per_si(self) -> float:
        """The factor from SI to the unit in which it is recorded."""
        return units.per_si(self.recorded_in) if self.recorded_in else 1.0


@dataclass(frozen=True)
class Rig:
    """A checked rig. Build it with :func:`build_rig`; it never changes, ``with_*`` give changed copies.

    effects : their values. tolerances : of those of their parameters that have one, relative, one standard deviation;
    an effect with a tolerance is known, and diagnosed as the elements' parameters are. own : per recording of a
    diagnosis, what is its own, by title: ``parameter``, ``place.effect.parameter`` or ``sensor_x.zero`` -> value, SI.
    number : dtype of the arrays that its values go into: object for numbers that record their arithmetic.
    """

    config: RigConfig
    elements: dict[str, Element]
    effects: Effects
    sensors: dict[str, Sensor]
    tolerances: Effects = field(default_factory=dict)
    own: Own = ()
    number: Any = field(default=float, repr=False)
    _made: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __repr__(self) -> str:
        effects = [f"{name} at {place}" for place, there in self.effects.items() for name in there]
        return f"<Rig: {', '.join([self.config.name, f'{len(self.elements)} elements', *effects])}>"

    def _repr_html_(self) -> str:
        """A row a parameter, for a notebook."""
        import pandas as pd

        rows = {n: (p.value, p.unit, p.tolerance, p.description) for n, p in self.config.parameters.items()}
        table = pd.DataFrame.from_dict(rows, orient="index", columns=["value", "unit", "tolerance", "description"])
        return str(table.rename_axis(columns=repr(self)[1:-1]).to_html())

    def __setstate__(self, state: dict[str, Any]) -> None:
        """In another process: its own laws have to be known there as well."""
        self.__dict__.update(state)
        catalogue.declare(self.laws(), "rig.laws")

    def __getstate__(self) -> dict[str, Any]:
        """With the laws that a user wrote, wherever they stand."""
        return self.__dict__ | {"config": replace(self.config, laws=self.laws()), "_made": {}}

    def of(self, recording: int) -> "Rig":
        """The rig as it is in one recording of a diagnosis, by its number from 0."""
        there = self.own[recording] if recording < len(self.own) else {}
        if not there:
            return self
        return self.once(recording, lambda: _as_in(self, there))

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What follows from the rig alone: made where it is first asked for by this key, and kept with the rig."""
        if key not in self._made:
            self._made[key] = make()
        found: T = self._made[key]
        return found

    def owning(self, values: Mapping[tuple[int, str], float | None]) -> "Rig":
        """A copy in which recordings have values of their own. values : (recording, title) -> value, SI; None: none."""
        own = [dict(there) for there in self.own]
        for (recording, title), value in values.items():
            own += [{} for _ in range(recording + 1 - len(own))]
            own[recording].pop(title, None)
            if value is not None:
                own[recording][title] = value
        return replace(self, own=tuple(own))

    def path(self, title: str) -> tuple[str, ...]:
        """What a title names: (parameter,), whose name may have dots in a simulator's model, or (place, more, ...)."""
        return (title,) if title in self.config.parameters else tuple(title.split("."))

    def laws(self) -> dict[str, Any]:
        """The declarations of the laws that a user wrote: those of its file, and those that it has as effects."""
        used = {name for there in self.effects.values() for name in there}
        return {**self.config.laws, **catalogue.declarations(used)}

    def of_kind(self, kind: str) -> list[Element]:
        """All elements of a kind, in order."""
        return [e for e in self.elements.values() if e.kind == kind]

    def links(self) -> list[Element]:
        """All links, couplings and shafts, in order."""
        return [e for e in self.elements.values() if e.trait.trait == slots.SPRING]

    def bodies(self) -> list[Element]:
        """All rotors and masses, in order."""
        return [e for e in self.elements.values() if e.trait.trait == slots.BODY]

    def motor_rotor(self) -> Element | None:
        """The rotor that turns the gear, or else the one that the motor drives; None if the rig has neither."""
        gear, drive = self.only("gear"), self.drive
        name = gear.neighbours["driven_by"] if gear else drive.neighbours["drives"] if drive else None
        element = self.elements.get(name) if name else None
        return element if element is not None and element.kind == "rotor" else None

    def only(self, kind: str) -> Element | None:
        """The single element of a kind, or None."""
        found = self.of_kind(kind)
        return found[0] if found else None

    @property
    def servo(self) -> Element | None:
        """The drive with a position loop, or None."""
        return self.only("servo") or self.only("linear_servo")

    @property
    def drive(self) -> Element | None:
        """What makes an effort: a motor's winding, an actuator or a servo; None where a positioner moves the rig."""
        return self.only("motor_circuit") or self.only("actuator") or self.servo

    @property
    def command_unit(self) -> str:
        """The SI unit of the command: V, or that of the position that a servo is told."""
        return AXES[self.servo.trait.axis][0] if self.servo else "V"

    def output_sensor(self) -> Sensor | None:
        """The sensor whose target is the reference: the position of the last body that slides, else of the last one."""
        places = {e.name: e for e in self.bodies()}
        order = list(places)
        shown = [s for s in self.sensors.values() if s.quantity == "position" and s.of in places]
        return max(shown, key=lambda s: (places[s.of].trait.axis == LINEAR, order.index(s.of)), default=None)

    def reference_per_si(self) -> float:
        """The factor from the reference in SI to the unit of its column in recordings: that of the output's sensor."""
        output = self.output_sensor()
        return output.per_si if output else 1.0

    def kind_at(self, location: str) -> str:
        """The kind at a location of the vocabulary: an element's name or ``sensor_<name>``."""
        if location in self.elements:
            return self.elements[location].kind
        if location.removeprefix(SENSOR_PREFIX) in self.sensors and location.startswith(SENSOR_PREFIX):
            return SENSOR.name
        raise UserError(f"rig.effects.{location}", location, f"unknown location; known: {', '.join(self.places)}")

    @property
    def places(self) -> list[str]:
        """All locations of the vocabulary: the elements, then ``sensor_<name>``."""
        return [*self.elements, *(SENSOR_PREFIX + name for name in self.sensors)]

    @property
    def forceless(self) -> list[str]:
        """Joints of an FMU that has no input through which a force acts on them, and what drives these."""
        still = [name for name, joint in self.config.joints.items() if not joint.get("force")]
        return [e.name for e in self.elements.values() if e.neighbours.get("drives", e.name) in still]

    @property
    def geared(self) -> list[str]:
        """Joints of a MuJoCo model behind whose actuator there may be a gap."""
        return mjcf.geared(self.config) if self.config.simulator == "mujoco" else []

    def takes(self, location: str) -> dict[str, Effect]:
        """The effects that a location takes, by name."""
        known = catalogue.effects_of(self.kind_at(location))
        return {name: effect for name, effect in known.items() if self.suits(location, effect)}

    def suits(self, location: str, effect: Effect) -> bool:
        """Whether an effect of the kind at a location can act there: some need a sensor of one unit, or states."""
        if self.config.model and isinstance(effect.slot, (slots.BodyMemory, slots.Filter, slots.ShownPlay)):
            return False
        if isinstance(effect.slot, slots.JointPlay):
            return location in self.geared
        if _asks_for_command(effect):
            drive = self.drive
            return drive is not None and drive is not self.servo and drive.neighbours["drives"] == location
        if location in self.forceless and isinstance(effect.slot, (slots.BodyEffort, slots.BodyDamping, slots.Contact)):
            return False
        return not effect.of_units or self.sensors[location.removeprefix(SENSOR_PREFIX)].unit in effect.of_units

    def effect(self, location: str, name: str) -> dict[str, float] | None:
        """The parameters of an effect that is switched on, else None."""
        return self.effects.get(location, {}).get(name)

    def active(self, location: str, slot: type[slots.Slot]) -> list[tuple[Effect, Values]]:
        """The effects that act in a slot of a location, with their parameters, in the catalogue's order."""
        there = self.effects.get(location)
        if not there:
            return []
        known = catalogue.effects_of(self.kind_at(location), there)
        return [(e, there[name]) for name, e in known.items() if isinstance(e.slot, slot)]

    def amount(self, location: str, slot: type[slots.Slot], parameter: str) -> float:
        """The sum of what the effects in a slot say of one of the slot's parameters; 0 if there are none."""
        return sum((values[getattr(e.slot, parameter)] for e, values in self.active(location, slot)), 0.0)

    def with_effect(self, location: str, name: str, values: Mapping[str, Any] | None) -> "Rig":
        """A copy with one effect set (or, with None, taken out). Raises UserError if it does not fit.

        values : numbers, SI, or mappings with ``value`` and ``tolerance``.
        """
        effects = {place: dict(there) for place, there in self.config.effects.items()}
        effects.setdefault(location, {}).pop(name, None)
        if values is not None:
            effects[location][name] = dict(values)
        return build_rig(replace(self.config, effects={p: e for p, e in effects.items() if e}), self.own)

    def with_parameters(self, values: dict[str, float]) -> "Rig":
        """A copy with some nominal parameters changed (SI).

        Raises
        ------
        UserError : no such parameter, or a value that is no number.
        """
        if not isinstance(values, Mapping):
            raise UserError("rig.parameters", values, "must be a mapping, name: value in SI")
        parameters = dict(self.config.parameters)
        for name, value in values.items():
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise UserError(f"rig.parameters.{name}", value, "must be a number, in SI")
            if name not in parameters:
                allowed = f"unknown parameter; known: {', '.join(parameters)}"
                raise UserError(f"rig.parameters.{name}", value, allowed)
            parameters[name] = replace(parameters[name], value=float(value))
        return build_rig(replace(self.config, parameters=parameters), self.own)


def build_rig(config: RigConfig, own: Own = ()) -> Rig:
    """Check a rig's description and resolve it. own : what is of single recordings, see :class:`Rig`.

    Raises
    ------
    UserError : an unknown kind, field, parameter, neighbour, effect or sensor; a value out of bounds.
    """
    if config.model and not config.elements:
        config = {"mujoco": mjcf, "fmu": fmus}[config.simulator].completed(config)
    catalogue.declare(config.laws, "rig.laws")
    elements = {name: _element(name, spec, config.parameters) for name, spec in config.elements.items()}
    _check_neighbours(elements)
    _check_gain(elements, config)
    gear_down(elements)
    sensors = {name: _sensor(name, spec, elements) for name, spec in config.sensors.items()}
    rig = Rig(config, elements, {}, sensors, own=own)
    effects: Effects = {}
    tolerances: Effects = {}
    for location, there in config.effects.items():
        kind = rig.kind_at(location)
        for name, leaves in there.items():
            key = f"rig.effects.{location}.{name}"
            effect = catalogue.find(kind, name, key)
            if not rig.suits(location, effect):
                raise UserError(key, name, f"needs {_needs(effect)}")
            filled = effect.complete({**leaves, **_with_units(rig, location, effect, leaves, key)}, key)
            if effect.is_neutral(filled):
                continue
            effects.setdefault(location, {})[name] = filled
            known = {p: float(leaf["tolerance"]) for p, leaf in leaves.items() if isinstance(leaf, dict)}
            if known:
                tolerances.setdefault(location, {})[name] = known
    return replace(rig, effects=effects, tolerances=tolerances)


def _asks_for_command(effect: Effect) -> bool:
    """Whether an effect of a body depends on what its drive is given."""
    return isinstance(effect.slot, slots.BodyEffort) and "command" in slots.asked(effect)


def _needs(effect: Effect) -> str:
    """What an effect needs that a place has not."""
    if effect.of_units:
        return f"a sensor whose unit is {' or '.join(effect.of_units)}"
    return "a body that an actuator or a motor's winding drives" if _asks_for_command(effect) else "another place"


def _with_units(rig: Rig, location: str, effect: Effect, leaves: Mapping[str, Any], key: str) -> dict[str, float]:
    """Those values of an effect that were written with a unit, in the units of its parameters."""
    written = {name: value for name, leaf in leaves.items() if isinstance(value := value_of(leaf), Quantity)}
    sensor = rig.sensors.get(location.removeprefix(SENSOR_PREFIX)) if written else None
    units_of = {p.name: sensor.unit if sensor and p.unit == SENSOR_UNIT else p.unit for p in effect.parameters}
    return {name: value.in_unit(f"{key}.{name}", units_of[name]) for name, value in written.items() if name in units_of}


def _as_in(rig: Rig, own: Mapping[str, float]) -> Rig:
    """A rig with the values that one recording has; those of effects that it does not have do nothing."""
    values: dict[tuple[str, ...], float] = {}
    zeros: dict[str, float] = {}
    for title, value in own.items():
        place, *rest = path = rig.path(title)
        if rest == [ZERO]:
            zeros[place.removeprefix(SENSOR_PREFIX)] = value
        elif not rest or rig.effect(place, rest[0]) is not None:
            values[path] = value
    if len(zeros) < len(own):
        rig = build_rig(rig.config.with_values(values))
    sensors = {n: replace(s, zero=zeros[n]) if n in zeros else s for n, s in rig.sensors.items()}
    return replace(rig, sensors=sensors, own=())


def _element(name: str, spec: dict[str, Any], parameters: dict[str, ParameterConfig]) -> Element:
    key = f"rig.elements.{name}"
    kind = KINDS.get(spec["kind"]) if isinstance(spec["kind"], str) else None
    if kind is None:
        raise UserError(f"{key}.kind", spec["kind"], f"choose one of {', '.join(KINDS)}")
    if name == GROUND or name.startswith(SENSOR_PREFIX):
        raise UserError(key, name, f"a name other than `{GROUND}` and not beginning with `{SENSOR_PREFIX}`")
    fields = {**kind.required, **kind.optional}
    unknown = set(spec) - {"kind", *fields, *kind.neighbours}
    if unknown:
        article = "an" if kind.name[0] in "aeiou" else "a"
        allowed = f"unknown field; {article} {kind.name} has {', '.join([*fields, *kind.neighbours])}"
        raise UserError(f"{key}.{min(unknown)}", spec[min(unknown)], allowed)
    values = {}
    for field_name, unit in fields.items():
        if field_name in spec:
            values[field_name] = _value(f"{key}.{field_name}", spec[field_name], unit, parameters)
        elif field_name in kind.required:
            raise UserError(f"{key}.{field_name}", "(missing)", f"the name of a parameter in {_either(unit)}")
    for neighbour in kind.neighbours:
        if neighbour not in spec and neighbour not in OPTIONAL_NEIGHBOURS:
            raise UserError(f"{key}.{neighbour}", "(missing)", "the name of another element")
    return Element(name, kind.name, values, {n: spec[n] for n in kind.neighbours if n in spec})


def _either(unit: str | tuple[str, ...]) -> str:
    return unit if isinstance(unit, str) else " or ".join(unit)


def _value(key: str, name: object, unit: str | tuple[str, ...], parameters: dict[str, ParameterConfig]) -> float:
    if not isinstance(name, str) or name not in parameters:
        raise UserError(key, name, f"the name of one of the rig's parameters: {', '.join(parameters)}")
    parameter = parameters[name]
    if parameter.unit and parameter.unit not in ((unit,) if isinstance(unit, str) else unit):
        raise UserError(f"rig.parameters.{name}.unit", parameter.unit, f"{_either(unit)}, as {key} needs it")
    value = finite(f"rig.parameters.{name}.value", parameter.value)
    if value < 0.0 or (value == 0.0 and not key.endswith(MAY_BE_ZERO)):
        raise UserError(f"rig.parameters.{name}.value", value, f"above 0 {_either(unit)}, as {key} needs it")
    return value


def _check_neighbours(elements: dict[str, Element]) -> None:
    if not any(e.trait.trait == slots.BODY for e in elements.values()):
        bodies = [kind.name for kind in KINDS.values() if kind.trait == slots.BODY]
        raise UserError("rig.elements", ", ".join(elements) or "(none)", f"at least one {', '.join(bodies)}")
    for group in dict.fromkeys(group for kind in KINDS.values() for group in kind.one_of):
        names = [e.name for e in elements.values() if group in e.trait.one_of]
        if len(names) > 1:
            kinds = [kind.name for kind in KINDS.values() if group in kind.one_of]
            raise UserError("rig.elements", ", ".join(names), f"at most one element of kind {' or '.join(kinds)}")
    for element in elements.values():
        for role, target in element.neighbours.items():
            _check_neighbour(elements, element, role, target)
    _check_drive(elements)
    _check_rotors(elements)


def _check_neighbour(elements: dict[str, Element], element: Element, role: str, target: Any) -> None:
    key = f"rig.elements.{element.name}.{role}"
    names = target if role == "between" else [target]
    if role == "between" and (not isinstance(names, list) or len(names) != 2 or names[0] == names[1]):
        raise UserError(key, target, "two different bodies, e.g. [mass_1, mass_2] or [ground, mass_1]")
    kinds = element.trait.neighbours[role]
    for place, name in enumerate(names):
        if role == "between" and name == GROUND and not element.trait.first:
            continue
        kinds = element.trait.at_end(place) if role == "between" else kinds
        fitting = [e.name for e in elements.values() if e.kind in kinds]
        if not isinstance(name, str) or name not in fitting:
            allowed = f"an element of kind {' or '.join(kinds)}: {', '.join(fitting) or 'the rig has none'}"
            raise UserError(key, name, allowed)


def _check_drive(elements: dict[str, Element]) -> None:
    """The motor turns the rotor that the gear is driven by; the angle that is measured there moves the structure."""
    drive = next((e for e in elements.values() if "drives" in e.neighbours and e.kind != "amplifier"), None)
    gear = next((e for e in elements.values() if e.kind == "gear"), None)
    if drive is None or gear is None or elements[drive.neighbours["drives"]].kind == "rotor":
        return
    allowed = f"a rotor, as {gear.name} is driven by one"
    raise UserError(f"rig.elements.{drive.name}.drives", drive.neighbours["drives"], allowed)


def _check_rotors(elements: dict[str, Element]) -> None:
    """Several rotors are a drive train: each is driven, drives the gear or hangs on a shaft."""
    rotors = [e.name for e in elements.values() if e.kind == "rotor"]
    reached = [
        name
        for e in elements.values() for target in e.neighbours.values()
        for name in (target if isinstance(target, list) else [target])
    ]  # fmt: skip
    for name in rotors if len(rotors) > 1 else []:
        if name not in reached:
            raise UserError(f"rig.elements.{name}", name, "a rotor that a motor, a gear or a shaft reaches")


def _check_gain(elements: dict[str, Element], config: RigConfig) -> None:
    """What an actuator gives per volt is the effort of what it drives."""
    for element in elements.values():
        if element.kind == "actuator":
            name, driven = config.elements[element.name]["gain"], element.neighbours["drives"]
            unit, needed = config.parameters[name].unit, AXES[elements[driven].trait.axis][2] + "/V"
            if unit and unit != needed:
                raise UserError(f"rig.parameters.{name}.unit", unit, f"{needed}, as {element.name} drives {driven}")


def gear_down(elements: dict[str, Element]) -> None:
    """Put the gear's ratio into the screw's lead: how far its base goes per radian of the motor."""
    for element in elements.values():
        if element.kind == "screw":
            ratio = elements[element.neighbours["driven_by"]].values.get("ratio", 1.0)
            values = {**element.values, "lead": element.values["lead"] / ratio}
            elements[element.name] = replace(element, values=values)


def _sensor(name: str, spec: dict[str, Any], elements: dict[str, Element]) -> Sensor:
    of, quantity = spec["of"], spec["quantity"]
    unknown = sorted(str(key) for key in set(spec) - {"of", "quantity", "recorded_in", "absolute"})
    if unknown:
        key = f"rig.sensors.{name}.{unknown[0]}"
        allowed = "unknown; a sensor has `of`, `quantity`, `recorded_in`, `absolute`"
        if unknown[0] in catalogue.effects_of(SENSOR.name):
            allowed = f"is an effect: write it as rig.effects.{SENSOR_PREFIX}{name}.{unknown[0]}"
        raise UserError(key, spec[unknown[0]], allowed)
    measurable = [e.name for e in elements.values() if e.trait.quantities]
    if of not in measurable:
        raise UserError(f"rig.sensors.{name}.of", of, f"choose one of {', '.join(measurable)}")
    known = elements[of].trait.quantities
    if not isinstance(quantity, str) or quantity not in known:
        raise UserError(f"rig.sensors.{name}.quantity", quantity, f"at {of}: {', '.join(known)}")
    recorded_in = units.in_words(spec.get("recorded_in"))
    unit = units.find(recorded_in)
    if recorded_in and (unit is None or unit.si != known[quantity]):
        allowed = f"a unit of {known[quantity]}: {', '.join(units.of_kind(known[quantity]))}"
        allowed += f"; or counts, as {{counts: 4096, per: {units.whole(known[quantity])}}}"
        raise UserError(f"rig.sensors.{name}.recorded_in", recorded_in, allowed)
    absolute = spec.get("absolute", False)
    if not isinstance(absolute, bool):
        raise UserError(f"rig.sensors.{name}.absolute", absolute, "true or false")
    if absolute and quantity != "position":
        allowed = f"only a position has a zero, and this sensor reads {quantity}; leave it out"
        raise UserError(f"rig.sensors.{name}.absolute", absolute, allowed)
    return Sensor(name, of, quantity, known[quantity], recorded_in, absolute)
