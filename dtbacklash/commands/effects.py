"""``dtb effects``: what physics there is, with law, unit and where it may act; ``dtb effects NAME`` shows one of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dtbacklash.config.near import meant
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.physics.effects.declare import Effect, Parameter
    from dtbacklash.physics.rig import Rig


def main(words: Sequence[str]) -> int:
    """Run ``dtb effects``; returns the exit code.

    Raises UserError: whatever the user got wrong, also in a law of one's own.
    """
    option = next((word for word in words if word.startswith("-")), None)
    if option is not None:
        raise UserError("option", option, "dtb effects takes --help, a name, and rig=RIG")
    settings = dict(word.split("=", 1) for word in words if "=" in word)
    names = [word for word in words if "=" not in word]
    unknown = next((key for key in settings if key != "rig"), None)
    if unknown is not None:
        raise UserError(unknown, settings[unknown], "no such setting; dtb effects takes rig=RIG")
    if len(names) > 1:
        raise UserError("argument", " ".join(names), "write dtb effects [NAME] [rig=RIG]")
    rig = _rig(settings["rig"]) if settings else None
    lines = _one(names[0], rig) if names else _all(rig)
    print("\n".join(lines))
    return 0


def _rig(name: str) -> Rig:
    from dtbacklash.api.rigs import load_rig

    return load_rig(name)


def _places(rig: Rig | None) -> dict[str, list[str]]:
    """The kinds at which something acts, each with its places on the rig; without a rig all kinds, without places."""
    from dtbacklash.physics.catalogue import CATALOGUE
    from dtbacklash.physics.element_kinds import SENSOR
    from dtbacklash.physics.rig import SENSOR_PREFIX

    kinds = list(dict.fromkeys(kind for kind, _ in CATALOGUE))
    if rig is None:
        return {kind: [] for kind in kinds}
    places = {kind: [element.name for element in rig.of_kind(kind)] for kind in kinds}
    places[SENSOR.name] = [SENSOR_PREFIX + name for name in rig.sensors]
    return {kind: there for kind, there in places.items() if there}


def _takers(rig: Rig, effect: Effect, places: list[str]) -> list[str]:
    """Those of the places that take an effect."""
    return [place for place in places if rig.suits(place, effect)]


def _all(rig: Rig | None) -> list[str]:
    from dtbacklash.physics.catalogue import effects_of

    lines = []
    acting = {
        kind: [e for e in effects_of(kind).values() if rig is None or _takers(rig, e, places)]
        for kind, places in _places(rig).items()
    }
    width = max(len(effect.name) for effects in acting.values() for effect in effects)
    for kind, places in _places(rig).items():
        lines += ["", kind + (f" ({', '.join(places)})" if places else "")]
        for effect in acting[kind]:
            mark = "*" if effect.declared is not None else " "
            given = ", ".join(_with_unit(p) for p in effect.listed)
            lines.append(f" {mark} {effect.name:<{width}}  {effect.law}  ({given})")
    lines += ["", "* a law of one's own; dtb effects NAME shows one effect in detail", *_packaged(width)]
    return lines[1:]


def _packaged(width: int) -> list[str]:
    """The laws of the package that a rig has to ask for."""
    from dtbacklash.physics.user_laws import ACTS_ON, LAW, MEMORY, SHIPPED, folder_declarations

    lines = ["", "of the package, where a rig asks for it (rig.laws.NAME=packaged):"]
    for name, said in folder_declarations(SHIPPED):
        kinds = said[ACTS_ON] if isinstance(said[ACTS_ON], list) else [said[ACTS_ON]]
        law = said[LAW] + (f", z' = {said[MEMORY]}" if MEMORY in said else "")
        lines.append(f"   {name:<{width}}  {law}  ({', '.join(kinds)})")
    return lines


def _one(name: str, rig: Rig | None) -> list[str]:
    from dtbacklash.physics.catalogue import CATALOGUE
    from dtbacklash.physics.user_laws import SHIPPED, folder_declarations

    places = _places(rig)
    found = [effect for (kind, other), effect in CATALOGUE.items() if other == name and kind in places]
    if not found:
        if any(name == shipped for shipped, _ in folder_declarations(SHIPPED)):
            raise UserError("effects", name, f"a law that a rig has to ask for: rig.laws.{name}=packaged")
        known = sorted({other for kind, other in CATALOGUE if kind in places})
        hint = meant(name, known)
        raise UserError(
            "effects", name, f"{hint}dtb effects lists all" if hint else f"choose one of {', '.join(known)}"
        )
    lines = []
    for effect in found:
        there = places[effect.kind] if rig is None else _takers(rig, effect, places[effect.kind])
        lines += ["", f"{name} at {effect.kind}" + (f" ({', '.join(there)})" if there else ""), *_detail(effect)]
    return lines[1:]


def _detail(effect: Effect) -> list[str]:
    kind = type(effect.slot).__doc__ or ""
    lines = [f"  law     {effect.law}", f"  acts    {kind.splitlines()[0]}", f"  source  {effect.source}"]
    lines.append("  said    " + _usual_sentence(effect))
    for p in effect.parameters:
        what = "does nothing at {:g}" if p is effect.size else "{:g} if not given"
        neutral = "" if p.neutral is None else ", " + what.format(p.neutral)
        bounds = f"{p.low:g} to {p.high:g}, usually {p.typical:g}{neutral}, {p.role.value}"
        lines.append(f"    {_with_unit(p):<28} {bounds}")
    return lines


def _usual_sentence(effect: Effect) -> str:
    """The sentence of a report with the usual values of its parameters."""
    from dtbacklash.report.components.numbers import quantity

    usual = {p.name: p.typical for p in effect.parameters}
    shown = {p.name: quantity(p.typical, p.unit) for p in effect.parameters}
    return effect.said(effect.idle(usual)).format(location=effect.kind, **shown)


def _with_unit(parameter: Parameter) -> str:
    return f"{parameter.name} [{parameter.unit}]" if parameter.unit else parameter.name
