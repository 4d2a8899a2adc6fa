"""Laws of a user's own: from a declaration in words and numbers to effects like those that come with the package.

A declaration is a mapping, as YAML gives it: in a rig's file under ``laws``, in ``conf/effect/NAME.yaml``, or from an
installed package. Which slot it acts in follows from the kinds of element that it names and from the states in its
formula.
"""

from __future__ import annotations

import itertools
import keyword
import re
from collections.abc import Callable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np

from dtbacklash import units, yaml_files
from dtbacklash.config.groups import SUFFIXES
from dtbacklash.config.rig import is_number
from dtbacklash.errors import UserError
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect, Parameter, Place, Role, Values, name_in_words
from dtbacklash.physics.effects.formula import FUNCTIONS, SHORT, Formula
from dtbacklash.physics.element_kinds import AXES, KINDS, LINEAR, Kind

#: where an installed package names its laws
GROUP = "dtbacklash.effects"
#: what a declaration holds; the first two must be there
ACTS_ON, LAW, MEMORY, PARAMETERS = "acts_on", "law", "z'", "parameters"
COVERS = "covers"
#: states whose range may be said: a run looks whether it leaves it
MEASURED: Final = ("position", "velocity", "slip_speed", "stretch", "stretch_rate", "command", "current")
KEYS: Final = (ACTS_ON, LAW, PARAMETERS, MEMORY, "source", "sentence", COVERS)
PARAMETER_KEYS: Final = ("unit", "low", "high", "start", "neutral", "role")
#: instead of a declaration: that of the package with this name
PACKAGED_LAW = "packaged"
#: the folder of the laws that come with the package
SHIPPED = Path(__file__).parent / "laws"
#: what a parameter may not be called
RESERVED: Final = ("size", "pi", *FUNCTIONS)
UNKNOWN_SOURCE = "declared by the user"
ROLES: Final = tuple(role.value for role in Role if role not in (Role.TIME, Role.KNOT, Role.GIVEN))
#: no parameter of a machine is larger, SI
HIGH = 1e9
#: start values of all parameters together
STARTS_MAX = 12

_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
_BRACES = re.compile(r"\{([^{}]*)\}")
#: signs of a sentence and of a source
TEXT_MAX = 500

#: dimension of a state, by the axis of a body or spring, or of all others
_STATES: Final[dict[str, str | int]] = {
    "time": "s", "slip_speed": 1, "velocity": 1, "position": 0, "stretch": 0, "stretch_rate": 1, "direction": "1",
    "load": 2, "command": "V", "current": "A",
}  # fmt: skip
#: as far as a law is tried, SI: what a state of a machine may be
_RANGE: Final = {
    LINEAR: {"position": 10.0, "velocity": 10.0, "stretch": 0.1, "stretch_rate": 10.0, "slip_speed": 10.0},
    "": {"position": 1e3, "velocity": 1e3, "stretch": 10.0, "stretch_rate": 1e3, "slip_speed": 1e3, "time": 1e4,
         "load": 1e3, "command": 1e3, "current": 1e3, "memory": 1.0, "direction": 1.0, "torque_constant": 1.0,
         "spring_stiffness": 1e4, "spring_damping": 10.0},
}  # fmt: skip
_NEVER_NEGATIVE: Final = ("time", "slip_speed", "torque_constant", "spring_stiffness", "spring_damping")


def effects_of_declaration(name: str, said: object, key: str) -> list[Effect]:
    """The effects that a declaration stands for, one for each kind of element on which it acts.

    Parameters
    ----------
    name : of the effect. said : the declaration, see ``docs/own_laws.md``. key : the dotted name for errors.

    Raises
    ------
    UserError : whatever it holds, if it is not a law: it names the key, the value and what is allowed.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise UserError(key, name, "a name of at most 40 small letters, digits and _, beginning with a letter")
    if not isinstance(said, Mapping):
        raise UserError(key, said, f"a mapping with {ACTS_ON}, {LAW} and {PARAMETERS}, or {PACKAGED_LAW}")
    for word in said:
        if word not in KEYS:
            raise UserError(f"{key}.{word}", said[word], f"unknown; a law has {', '.join(KEYS)}")
    texts = {word: _text(said.get(word, ""), f"{key}.{word}") for word in ("source", "sentence")}
    made = []
    for kind in _kinds(said.get(ACTS_ON), f"{key}.{ACTS_ON}"):
        parameters, starts = _parameters(said.get(PARAMETERS), kind, f"{key}.{PARAMETERS}")
        made.append(_Declared(name, kind, said, key, parameters).effect(starts, texts))
    return made


def packaged(name: str, key: str) -> Any:
    """The declaration of a law that comes with the package, but is no candidate until a rig asks for it.

    Raises
    ------
    UserError : there is none of that name.
    """
    known = dict(folder_declarations(SHIPPED))
    if name not in known:
        raise UserError(key, PACKAGED_LAW, f"no law of the package has that name; choose one of {', '.join(known)}")
    return known[name]


def folder_declarations(folder: Path) -> Iterator[tuple[str, Any]]:
    """(name, declaration) of each file in a folder of effects, in the order of their names.

    Raises
    ------
    UserError : a file that is no YAML.
    """
    files = sorted(file for file in folder.glob("*") if file.suffix in SUFFIXES) if folder.is_dir() else []
    for file in files:
        try:
            yield file.stem, yaml_files.read(file.read_bytes())
        except yaml_files.Mistake as mistake:
            raise UserError("effect", file, str(mistake)) from mistake
        except OSError as error:
            raise UserError("effect", file, f"cannot be read: {(error.strerror or str(error)).lower()}") from error


def installed() -> Iterator[Effect]:
    """The effects of installed packages: each entry point is an effect, several, or a mapping name -> declaration.

    Raises
    ------
    UserError : an entry point that cannot be loaded, or is nothing of these.
    """
    for point in sorted(metadata.entry_points(group=GROUP), key=lambda one: one.name):
        key = f"{GROUP}.{point.name}"
        try:
            given = point.load()
        except Exception as error:  # what somebody else's module raises
            raise UserError(key, point.value, f"cannot be loaded: {error}") from error
        if isinstance(given, Mapping):
            for name, said in given.items():
                yield from effects_of_declaration(name, said, f"{key}.{name}")
            continue
        several = given if isinstance(given, (list, tuple)) else [given]
        if not all(isinstance(one, Effect) for one in several):
            raise UserError(key, point.value, "an Effect, a list of them, or a mapping name -> declaration")
        yield from several


def _text(said: object, key: str) -> str:
    if not isinstance(said, str) or len(said) > TEXT_MAX:
        raise UserError(key, str(said)[:40], f"a text of at most {TEXT_MAX} signs")
    return said


def _kinds(said: object, key: str) -> list[Kind]:
    """The kinds of element that a declaration names."""
    takes = [kind.name for kind in KINDS.values() if _slot_names(kind)]
    several = said if isinstance(said, list) else [said]
    if not several or any(not isinstance(one, str) or one not in takes for one in several):
        raise UserError(key, said if said is not None else "(missing)", f"one or several of {', '.join(takes)}")
    return [KINDS[one] for one in dict.fromkeys(several)]


def _parameters(said: object, kind: Kind, key: str) -> tuple[tuple[Parameter, ...], list[Values]]:
    """The parameters of a declaration, and the sets of values at which a search starts."""
    if not isinstance(said, Mapping) or not 0 < len(said) <= slots.LAW_PARAMETERS:
        allowed = (
            f"a mapping name -> {{unit, low, high, start, neutral, role}} of 1 to {slots.LAW_PARAMETERS} parameters"
        )
        raise UserError(key, said if said is not None else "(missing)", allowed)
    made: list[Parameter] = []
    starts: list[list[tuple[str, float]]] = []
    for name, leaf in said.items():
        parameter, values = _parameter(name, leaf, kind, f"{key}.{name}", first=not made)
        made.append(parameter)
        starts.append([(name, value) for value in values])
    sets = [dict(one) for one in itertools.product(*starts)]
    if len(sets) > STARTS_MAX:
        raise UserError(key, f"{len(sets)} sets of start values", f"at most {STARTS_MAX} sets of all together")
    return tuple(made), sets


def _unit(said: object, kind: Kind, key: str) -> str:
    """A unit, in which ``position``, ``speed`` and ``effort`` stand for those of the kind's axis."""
    unit = said
    for word, mine in zip(("position", "speed", "effort"), AXES.get(kind.axis, ()), strict=False):
        unit = unit.replace(word, mine) if isinstance(unit, str) else unit
    if not isinstance(unit, str) or (unit and units.dimension_of(unit) is None):
        known = ", ".join(units.SI_DIMENSIONS)
        raise UserError(key, said, f"a unit of {known} with powers and one bar, e.g. N s^2/m^2")
    return unit


def _parameter(name: object, leaf: object, kind: Kind, key: str, first: bool) -> tuple[Parameter, list[float]]:
    if not isinstance(name, str) or not _NAME.fullmatch(name) or keyword.iskeyword(name) or name in RESERVED:
        raise UserError(key, name, "a name of at most 40 small letters, digits, _; neither size nor pi nor a function")
    if not isinstance(leaf, Mapping) or "start" not in leaf:
        raise UserError(key, leaf, "a mapping with at least start, e.g. {unit: N, low: 0, high: 100, start: 1}")
    for word in leaf:
        if word not in PARAMETER_KEYS:
            raise UserError(f"{key}.{word}", leaf[word], f"unknown; a parameter has {', '.join(PARAMETER_KEYS)}")
    unit = _unit(leaf.get("unit", ""), kind, f"{key}.unit")
    role = leaf.get("role", Role.SIZE.value if first else Role.SHAPE.value)
    if role not in ROLES or (first and role != Role.SIZE.value):
        allowed = "size, as it is the first" if first else ", ".join(ROLES[1:])
        raise UserError(f"{key}.role", role, allowed)
    several = leaf["start"] if isinstance(leaf["start"], list) else [leaf["start"]]
    numbers = {
        "low": leaf.get("low", -HIGH), "high": leaf.get("high", HIGH),
        **({"neutral": leaf["neutral"]} if leaf.get("neutral") is not None else {"neutral": 0.0} if first else {}),
        **{f"start.{n}": value for n, value in enumerate(several)},
    }  # fmt: skip
    for word, value in numbers.items():
        if not is_number(value, finite=True):
            raise UserError(f"{key}.{word.partition('.')[0]}", value, "a finite number")
    low, high = float(numbers["low"]), float(numbers["high"])
    if not low < high:
        raise UserError(f"{key}.high", high, f"above low, which is {low:g}")
    for word, value in numbers.items():
        if not low <= value <= high:
            raise UserError(f"{key}.{word.partition('.')[0]}", value, f"from {low:g} to {high:g}")
    if not several or (first and float(several[0]) == numbers["neutral"]):
        raise UserError(f"{key}.start", leaf["start"], "a number other than neutral, where the law does nothing")
    neutral = float(numbers["neutral"]) if "neutral" in numbers else None
    typical = float(several[0])
    return Parameter(name, unit, low, high, typical, neutral, Role(role)), [float(value) for value in several]


#: trait -> the slots for formulas: with a memory, of a friction's states, of all others
_SLOTS: Final[dict[str, tuple[type[slots.Slot] | None, type[slots.Slot] | None, type[slots.Slot]]]] = {
    slots.BODY: (slots.BodyMemory, slots.Contact, slots.BodyEffort),
    slots.SPRING: (None, slots.Contact, slots.SpringForce),
    slots.AMPLIFIER: (None, None, slots.Command),
    slots.WINDING: (None, None, slots.MotorTorque),
}


def _slots_of(kind: Kind) -> tuple[type[slots.Slot] | None, ...]:
    """The slots of a kind: with a memory, of a friction, of all others; no friction between unlike motions."""
    with_memory, of_friction, other = _SLOTS.get(kind.trait, (None, None, None))
    return with_memory, None if kind.first else of_friction, other


def _slot_names(kind: Kind) -> list[type[slots.Slot]]:
    """The slots of a kind that a formula may stand in."""
    return [slot for slot in _slots_of(kind) if slot is not None]


def states_of(kind: Kind) -> list[str]:
    """The states that a formula may ask for at an element of a kind, by their long names."""
    return list(dict.fromkeys(state for slot in _slot_names(kind) for state in slot.states))


class _Declared:
    """A declaration at one kind of element."""

    def __init__(
        self, name: str, kind: Kind, said: Mapping[str, Any], key: str, parameters: tuple[Parameter, ...]
    ) -> None:
        self.name, self.kind, self.said, self.key, self.parameters = name, kind, said, key, parameters
        names = [p.name for p in parameters]
        for one in names:
            if SHORT.get(one, one) in states_of(kind):
                raise UserError(f"{key}.{PARAMETERS}.{one}", one, f"a name that is no state of a {kind.name}")
        with_memory, of_friction, other = _slots_of(kind)
        if MEMORY in said and with_memory is None:
            raise UserError(f"{key}.{MEMORY}", said[MEMORY], f"a {kind.name} has no memory; a body has")
        self.law_key = f"{key}.{LAW}"
        if LAW not in said:
            raise UserError(self.law_key, "(missing)", "a formula, e.g. -drag*abs(v)*v")
        allowed = list(with_memory.states) if MEMORY in said and with_memory else states_of(kind)
        if MEMORY not in said:
            allowed = [one for one in allowed if one != "memory"]
        self.law = Formula(said[LAW], allowed, names, self.law_key)
        self.rate = Formula(said[MEMORY], allowed, names, f"{key}.{MEMORY}") if MEMORY in said else None
        slot = with_memory if self.rate else other
        if of_friction and not self.rate and {"slip_speed", "direction", "load"} & set(self.law.names):
            slot = of_friction
        assert slot is not None
        self.slot_kind = slot
        for formula in self._formulas():
            for one in formula.names:
                if one not in slot.states and one not in names:
                    raise UserError(formula.key, one, f"beside the others there: {', '.join(slot.states)}")
        for one in names:
            if not any(one in formula.names for formula in self._formulas()):
                raise UserError(f"{key}.{PARAMETERS}.{one}", one, "does not stand in the law")
        self._check_units()

    def _formulas(self) -> list[Formula]:
        return [self.law, self.rate] if self.rate else [self.law]

    def _check_units(self) -> None:
        known = {p.name: units.dimension_of(p.unit) if p.unit else None for p in self.parameters}
        axis = AXES.get(self.kind.axis, ("", "", ""))
        for state, unit in _STATES.items():
            written = axis[unit] if isinstance(unit, int) else unit
            if state in self.slot_kind.states and written:
                known[state] = units.dimension_of(written)
        wanted = "V" if self.slot_kind is slots.Command else axis[2]
        if self.rate:
            self.rate.dimension(known)
        found = self.law.dimension(known)
        if wanted and found is not None and found != units.dimension_of(wanted):
            raise UserError(self.law_key, self.law.text, f"gives {units.of_dimension(found)}, must give {wanted}")

    def effect(self, starts: list[Values], texts: Mapping[str, str]) -> Effect:
        """The effect, with its laws; refused where it is not finite or does not vanish."""
        made = [formula.function() for formula in self._formulas()]
        slot: slots.Slot = self.slot_kind(*made)
        self._try(slot)
        size = self.parameters[0].name
        named = name_in_words(self.name)
        sentence = texts["sentence"] or f"{named[0].upper()}{named[1:]} of {{{size}}} acts at the {{location}}."
        _check_sentence(sentence, [p.name for p in self.parameters], f"{self.key}.sentence")
        text = self.law.text + (f", z' = {self.rate.text}" if self.rate else "")
        return Effect(
            self.name, self.kind.name, self.parameters, text, slot, texts["source"] or UNKNOWN_SOURCE, sentence,
            conceal=_not_concealed, starts=_starting_at(starts), declared=dict(self.said), covered=self._covered(),
        )  # fmt: skip

    def _covered(self) -> Callable[[Values], dict[str, tuple[float, float]]]:
        """The states between which it holds, where the declaration says them."""
        said, key = self.said.get(COVERS, {}), f"{self.key}.{COVERS}"
        if not isinstance(said, Mapping):
            raise UserError(key, said, "a mapping, e.g. {v: [-3, 3]}")
        known = [state for state in self.slot_kind.states if state in MEASURED]
        found: dict[str, tuple[float, float]] = {}
        for name, ends in said.items():
            if SHORT.get(name, name) not in known:
                raise UserError(f"{key}.{name}", ends, f"one of {', '.join(known)}")
            numbers = isinstance(ends, list | tuple) and all(isinstance(e, int | float) for e in ends)
            if not numbers or len(ends) != 2 or not ends[0] < ends[1]:
                raise UserError(f"{key}.{name}", ends, "its lowest and its highest value, e.g. [-3, 3]")
            found[str(SHORT.get(name, name))] = float(ends[0]), float(ends[1])
        return lambda values: found

    def _try(self, slot: slots.Slot) -> None:
        """Refuse a law that is not finite at its start values, or that does something at the size's neutral value."""
        states = _tried_states(slot.states, self.kind.axis)
        typical = {p.name: p.typical for p in self.parameters}
        neutral = typical | {p.name: p.neutral for p in self.parameters if p.neutral is not None}
        for formula, law in zip(self._formulas(), slot.laws().values(), strict=True):
            function = law
            for values, idle in ((typical, False), (neutral, True)):
                tried: dict[str, Any] = {name: np.float64(value) for name, value in values.items()}
                given = {name: (states | tried)[name] for name in formula.names}
                with np.errstate(all="ignore"):
                    gave = np.broadcast_to(function(*given.values()), len(states["_"]))
                wrong = ~np.isfinite(gave)
                allowed = "a finite number wherever the element may be"
                if idle and formula is self.law:
                    at_rest = states["command"] if self.slot_kind is slots.Command else 0.0
                    wrong, allowed = wrong | (gave != at_rest), f"nothing where {self._neutral()}"
                elif self.slot_kind is slots.Contact:
                    wrong, allowed = wrong | (gave < 0.0), "a level, finite and never below 0"
                if wrong.any():
                    at = int(np.argmax(wrong))
                    where = ", ".join(f"{name} = {given[name][at]:g}" for name in formula.names if name in states)
                    gives = f"gives {gave[at]:g} at {where or 'all times'}"
                    raise UserError(formula.key, formula.text, f"{gives}; must give {allowed}")

    def _neutral(self) -> str:
        return " and ".join(f"{p.name} = {p.neutral:g}" for p in self.parameters if p.neutral is not None)


def _tried_states(names: tuple[str, ...], axis: str) -> dict[str, np.ndarray[Any, Any]]:
    """States at which a law is tried: all at rest, each alone at values of all scales, all together; ``_`` counts."""
    ranges = _RANGE[""] | (_RANGE[LINEAR] if axis == LINEAR else {})
    scales = np.array([1.0, 0.3, 1e-2, 1e-4, 1e-9])
    rows = [dict.fromkeys(names, 0.0)]
    for moving in (*((name,) for name in names), names):
        for scale in (*scales, *-scales):
            rows.append({n: float(scale) * ranges[n] if n in moving else 0.0 for n in names})
    rng = np.random.default_rng(0)
    rows += [{n: float(rng.uniform(-1.0, 1.0)) * ranges[n] for n in names} for _ in range(200)]
    found = {n: np.array([abs(row[n]) if n in _NEVER_NEGATIVE else row[n] for row in rows]) for n in names}
    if "direction" in found:
        found["direction"] = np.where(found["direction"] < 0.0, -1.0, 1.0)
    return found | {"_": np.zeros(len(rows))}


def _check_sentence(sentence: str, names: list[str], key: str) -> None:
    """Braces hold nothing but names: what else Python's formatting takes reaches objects, or fills the memory."""
    known = ["location", *names]
    if any(name not in known for name in _BRACES.findall(sentence)) or set("{}") & set(_BRACES.sub("", sentence)):
        allowed = ", ".join(f"{{{name}}}" for name in known)
        raise UserError(key, sentence, f"a sentence, in whose braces stand {allowed}")


def _starting_at(starts: list[Values]) -> Callable[[Place], list[Values]]:
    return lambda place: [dict(one) for one in starts]


def _not_concealed(place: Place, sign: float) -> tuple[float, float]:
    """The concealing simulator has no law that a user wrote."""
    raise UserError("effect", "a law of one's own", "is never hidden: choose one that comes with the package")
