"""From an effect to what the core calls: a function of ``laws.c``, a formula's program, or an address."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.core.library import LAWS, buffer, ffi, lib
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.c_law import c_law_of
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.effects.slots import ROW_PARAMETERS, Law, Slot, formula_of
from dtbacklash.physics.kernel import dispatch
from dtbacklash.physics.kernel import plant as pl

#: slot of a plant -> the slots of the laws at its places; a link has three places that follow one another
SLOTS: dict[int, tuple[type[Slot], ...]] = {
    pl.BODY_EFFORT: (slots.BodyEffort,), pl.BODY_MEMORY: (slots.BodyMemory,),
    pl.LINK: (slots.SpringPlay, slots.SpringForce, slots.SpringMemory), pl.FRICTION: (slots.Contact,),
    pl.READING: (slots.Reading,), pl.COMMAND: (slots.Command,), pl.WINDING: (slots.WindingMemory,),
    pl.MOTOR_TORQUE: (slots.MotorTorque,), pl.LEAD: (slots.Lead,),
}  # fmt: skip
_FUNCTION = ffi.typeof("void (*)(void)")
#: structs of laws -> their parameters, which have to be there as long
_parameters: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()


class Called:
    """What the core calls for one field of a slot: ``function``, or ``formula`` where that is not NULL.

    name : of the function in ``laws.c``; empty for one that is compiled in this process.
    """

    def __init__(self, function: Any = ffi.NULL, formula: Any = ffi.NULL, *kept: Any, name: str = "") -> None:
        self.function, self.formula, self.name = function, formula, name
        self._kept = kept  # what they point to


def fields_of(slot: type[Slot]) -> list[str]:
    """The fields of a slot that are laws, in the order in which the core knows them."""
    return [name for name, kind in slot.__annotations__.items() if kind == "Law" and name != "inverse"]


def core_law(law: Law, slot: type[Slot]) -> Called:
    """The law of ``laws.c`` that has the name of a declared one.

    Raises
    ------
    KeyError : there is none of that name in the slot.
    """
    name = law.__name__
    if name not in LAWS or LAWS[name][0] != slot.__name__:
        raise KeyError(f"laws.c has no law `{name}` of {slot.__name__}")
    return Called(ffi.cast(_FUNCTION, getattr(lib, name)), name=name)


@cache
def of_package(slot: type[Slot], code: int) -> list[Called]:
    """What is called for the laws of the package that have a code in a slot, field by field."""
    calls = dispatch.listed(slot)[code]
    return [core_law(calls[field][0], slot) for field in fields_of(slot)]


@cache
def of_others(code: int) -> list[Called]:
    """The same for a code below 0."""
    effect = dispatch.other_of(code)
    slot = _base(type(effect.slot))
    calls = dispatch.calls_of(effect)
    return [_of_other(*calls[field], slot) for field in fields_of(slot)]


def called(slot: type[Slot], code: int) -> list[Called]:
    """What is called for the laws of a code, field by field."""
    # a class is hashable, whatever mypy reads off its instances
    return of_others(code) if code < 0 else of_package(slot, code)  # type: ignore[arg-type]


def _base(slot: type[Slot]) -> type[Slot]:
    """The slot whose laws the core calls: that of the states."""
    return next(one for kinds in SLOTS.values() for one in kinds if issubclass(slot, one))


def _of_other(law: Law, names: tuple[str | int, ...], slot: type[Slot]) -> Called:
    """A law that others have registered, or that the package has under another name."""
    if formula := formula_of(law):
        places = dict(zip(formula.names, names, strict=True))
        return program(formula.program(), places, slot)
    c_law = c_law_of(law)
    return Called(ffi.cast(_FUNCTION, c_law.address), ffi.NULL, c_law) if c_law else core_law(law, slot)


def program(steps: list[tuple[str, Any]], places: dict[str, str | int], slot: type[Slot]) -> Called:
    """A formula as the core evaluates it.

    Parameters
    ----------
    steps : operations with the name or number that each puts on the stack. places : name -> the state or the
        parameter's place that it is. slot : of the law.
    """
    operations = np.zeros(len(steps), dtype=np.int64)
    numbers, constants = np.zeros(len(steps), dtype=np.int64), np.zeros(len(steps))
    for k, (operation, operand) in enumerate(steps):
        name, place = operation, places.get(operand, k)
        if operation == "NAME":
            name = "PARAMETER" if isinstance(place, int) else "STATE"
        elif operation == "CONSTANT":
            constants[k] = operand
        operations[k] = getattr(lib, f"OP_{name}")
        numbers[k] = place if isinstance(place, int) else slot.states.index(place)
    kept = buffer(operations), buffer(numbers), buffer(constants)
    formula = ffi.new("Formula *", dict(zip(("operation", "number", "constant"), kept, strict=True)))
    formula.length = len(steps)
    return Called(ffi.NULL, formula, kept)


def fill(law: Any, found: list[Called]) -> None:
    """Write what is called into a struct ``Law``."""
    for k, one in enumerate(found):
        law.call[k], law.formula[k] = one.function, one.formula


def acting(slot: type[Slot], found: Sequence[tuple[int, Effect, Values]]) -> Any:
    """The structs of laws of one slot, with their parameters.

    found : what each acts on (``at`` of the struct), its effect, its values.
    """
    rows, entries = np.zeros((len(found), ROW_PARAMETERS)), ffi.new("Law[]", max(len(found), 1))
    parameters = buffer(rows)
    for k, (at, effect, values) in enumerate(found):
        rows[k, : len(values)] = list(values.values())
        fill(entries[k], called(slot, dispatch.code_of(effect)))
        entries[k].at, entries[k].p = at, parameters + k * ROW_PARAMETERS
    _parameters[entries] = parameters
    return entries


def values_of(effect: Effect, values: Values, **states: Floats | float) -> Floats:
    """(N,) the first law of an effect, with these values of its parameters, at states (N,) or numbers; others are 0."""
    slot = _base(type(effect.slot))
    given = np.broadcast_arrays(*states.values())
    at, out = np.zeros((given[0].size, len(slot.states))), np.empty(given[0].size)
    for name, one in zip(states, given, strict=True):
        at[:, slot.states.index(name)] = one
    lib.dtb_law_values(acting(slot, [(0, effect, values)]), len(at), at.shape[1], buffer(at), buffer(out))
    return out
