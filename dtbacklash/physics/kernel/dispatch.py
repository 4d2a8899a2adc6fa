"""Codes of laws: what stands for an effect's laws in the arrays of a plant.

The laws that come with the package have codes from 0 on in each slot. Those that somebody else has registered have
codes below 0, in this process.
"""

from __future__ import annotations

from functools import cache
from threading import Lock
from typing import Any

from dtbacklash.physics import catalogue
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect
from dtbacklash.physics.effects.slots import Law, Slot, arguments

Call = tuple[Law, tuple[str | int, ...]]
#: kind, name and declaration of an effect
Name = tuple[str, str, Any]

#: what others have registered and a rig has used; the code of the first is -1, that of the second -2
OTHERS: list[Effect] = []
_adding = Lock()

#: the law of dry friction whose level is its only parameter: that of a kind that is held by friction of itself
PLAIN_FRICTION = 0


def _itself(value):
    return value


def calls_of(effect: Effect) -> dict[str, Call]:
    """The laws of an effect with what each of their arguments is, and the parameters that its slot names."""
    slot, names = effect.slot, [p.name for p in effect.parameters]
    calls: dict[str, Call] = {f: (a, tuple(arguments(a, slot.states, effect))) for f, a in slot.laws().items()}
    return calls | {field: (_itself, (names.index(name),)) for field, name in slot.named().items()}


def listed(slot: type[Slot]) -> list[dict[str, Call]]:
    """The different laws of the package in a slot, by code."""
    found = [calls_of(catalogue.SHIPPED["rotor", "coulomb_friction"])] if slot is slots.Contact else []
    for effect in catalogue.SHIPPED.values():
        if isinstance(effect.slot, slot) and (calls := calls_of(effect)) not in found:
            found.append(calls)
    return found


@cache
def _codes() -> dict[tuple[str, str], int]:
    """(kind, effect) -> the code of its laws in their slot, for what comes with the package."""
    found = {}
    for slot in Slot.__subclasses__():  # kinds of these share their laws
        laws = listed(slot)
        for effect in catalogue.SHIPPED.values():
            if isinstance(effect.slot, slot):
                found[effect.kind, effect.name] = laws.index(calls_of(effect))
    return found


def code_of(effect: Effect) -> int:
    """What stands for the laws of an effect in a plant: below 0 for those of others, in this process."""
    key = effect.kind, effect.name
    if catalogue.SHIPPED.get(key) is effect:
        return _codes()[key]
    with _adding:
        for place, other in enumerate(OTHERS):
            if other is effect:
                return -1 - place
        OTHERS.append(effect)
        return -len(OTHERS)


def other_of(code: int) -> Effect:
    """The effect that a code below 0 stands for."""
    return OTHERS[-1 - code]


def named(codes: Any) -> dict[int, Name]:
    """Those of some entries' laws that others have registered, by a name that another process understands."""
    others = {entry: other_of(int(code)) for entry, code in enumerate(codes) if code < 0}
    return {entry: (effect.kind, effect.name, effect.declared) for entry, effect in others.items()}


def code_named(name: Name) -> int:
    """The code of a law that :func:`named` has named; declared here where it is not known yet."""
    kind, effect, declared = name
    if declared is not None:
        catalogue.declare({effect: declared}, "rig.laws")
    return code_of(catalogue.find(kind, effect, "rig.effects"))
