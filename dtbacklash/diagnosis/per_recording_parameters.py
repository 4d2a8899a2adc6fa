"""What belongs to single recordings: parameters and effects that are free in each, and values that are known there."""

from collections.abc import Callable, Mapping, Sequence

from dtbacklash.config.rig import in_si
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Parameter
from dtbacklash.physics.rig import Rig

#: what is free in each recording; or per recording (name or number), what is free there
Own = Sequence[str] | Mapping[str, Sequence[str]] | Mapping[int, Sequence[str]]
#: recording -> parameter -> its value there, SI or a text with its unit
Given = Mapping[str, Mapping[str, object]] | Mapping[int, Mapping[str, object]]


def with_own(
    rig: Rig, count: int, number: Callable[[str, str | int], int], own: Own | None, given: Given | None
) -> Rig:
    """The rig in which recordings have what is their own, at its nominal values, and what is given for them.

    count : of the recordings. number : key and name of a recording -> its number.

    Raises
    ------
    UserError : a recording, parameter or effect that there is not; a value that it cannot have; one recording alone.
    """
    for key, said in (("own", own), ("given", given)):
        if said and count < 2:
            raise UserError(key, said, "tells recordings apart: give several, recording=[a.csv,b.csv]")
    values: dict[tuple[int, str], float | None] = {}
    for k, names in _each(own, count, number):
        for name in names:
            values |= {(k, title): value for title, value in _titles("own", rig, name).items()}
    if given and not isinstance(given, Mapping):
        raise UserError("given", given, "must be a mapping, as {b: {carriage.mass: 3.2 kg}}")
    for recording, there in (given or {}).items():
        if not isinstance(there, Mapping):
            raise UserError(f"given.{recording}", there, "must be a mapping, as {carriage.mass: 3.2 kg}")
        k = number("given", recording)
        for name, value in there.items():
            title = next(iter(_titles(f"given.{recording}", rig, name)))
            values[k, title] = _checked(f"given.{recording}.{name}", rig, title, value)
    return rig.owning(values)


def _each(own: Own | None, count: int, number: Callable[[str, str | int], int]) -> list[tuple[int, Sequence[str]]]:
    """Number of a recording and what is its own."""
    if not own:
        return []
    if isinstance(own, str) or not isinstance(own, (Sequence, Mapping)):
        raise UserError("own", own, "must be a list, as [carriage.mass], or one for a recording, {b: [carriage.mass]}")
    if not isinstance(own, Mapping):
        return [(k, own) for k in range(count)]
    found = []
    for recording, names in own.items():
        if isinstance(names, str) or not isinstance(names, Sequence):
            raise UserError(f"own.{recording}", names, "must be a list, as [carriage.mass]")
        found.append((number("own", recording), names))
    return found


def _titles(key: str, rig: Rig, name: str) -> dict[str, float]:
    """Title of what a name means -> its value in the rig: a parameter, an element's field, an effect or one of its own.

    Of an effect it is the size.
    """
    parameters = rig.config.parameters
    if isinstance(name, str) and name in parameters:
        return {name: parameters[name].value}
    place, _, rest = str(name).partition(".")
    field = rig.config.elements.get(place, {}).get(rest)
    if isinstance(field, str) and field in parameters:
        return {field: parameters[field].value}
    effect, _, parameter = rest.partition(".")
    if place in rig.places and effect in rig.takes(place):
        entry = find(rig.kind_at(place), effect, place)
        for p in entry.parameters:
            if p.name == (parameter or entry.size.name):
                values = rig.effect(place, effect) or {}
                return {f"{place}.{effect}.{p.name}": values.get(p.name, p.typical)}
    known = f"its parameters are {', '.join(parameters)}, an effect is PLACE.NAME"
    raise UserError(key, name, f"is no parameter or effect of this rig; {known}")


def _checked(key: str, rig: Rig, title: str, value: object) -> float:
    """A value in SI that the rig can have there."""
    place, *rest = rig.path(title)
    if not rest:
        nominal = rig.config.parameters[title]
        size, unit = in_si(key, value)
        if unit not in ("", nominal.unit):
            raise UserError(key, value, f"must be in {nominal.unit}, as {title} is")
        if not size * nominal.value > 0.0:
            raise UserError(key, value, f"must be {'above' if nominal.value > 0.0 else 'below'} 0 {nominal.unit}")
        return size
    p: Parameter = next(q for q in find(rig.kind_at(place), rest[0], place).parameters if q.name == rest[1])
    size, unit = in_si(key, value)
    if unit not in ("", p.unit) or not p.low <= size <= p.high:
        raise UserError(key, value, f"must be from {p.low:g} to {p.high:g} {p.unit}")
    return size
