"""From the catalogue to compiled code: one function a slot, which calls the law that an entry's code stands for.

numba compiles a call of functions that are known when it compiles; the functions here are therefore written out, as
chains of comparisons over the effects that come with the package, when this module is imported. A law that no effect of
the rig uses costs nothing. A law that somebody else has registered has a code below 0, which the core knows what to do
with. The loops that numba compiles take it at an address: :func:`addressed` compiles it by itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from dtbacklash.arrays import Ints
from dtbacklash.compiled import inlined, kept, law
from dtbacklash.physics import catalogue
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect
from dtbacklash.physics.effects.slots import LAW_PARAMETERS, Law, Slot, arguments

if TYPE_CHECKING:
    pass

Call = tuple[Law, tuple[str | int, ...]]
#: kind, name and declaration of an effect, and whether its law stood at an address
Name = tuple[str, str, Any, bool]

#: (kind, effect) -> the code of its laws in the functions of its slot, for what comes with the package
CODES: dict[tuple[str, str], int] = {}
#: what others have registered and a rig has used; the code of the first is -1, that of the second -2
OTHERS: list[Effect] = []
#: address -> the code of the law there, and the compiled function, which is not freed
ADDRESSES: dict[int, tuple[int, Any]] = {}
_adding = Lock()

#: the law of dry friction whose level is its only parameter: that of a kind that is held by friction of itself
PLAIN_FRICTION = 0


@law
def _itself(value):
    return value


@intrinsic
def _at_address(typingctx, address, given):
    """Call the function of floats at an address, with the numbers of a tuple; it gives a float."""

    def generate(context, builder, signature, values):
        double, many = ir.DoubleType(), len(signature.args[1])
        kind = ir.FunctionType(double, [double] * many)
        floats = [
            context.cast(builder, builder.extract_value(values[1], i), kind_given, types.float64)
            for i, kind_given in enumerate(signature.args[1])
        ]
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), floats)

    return types.float64(types.int64, given), generate


def calls_of(effect: Effect) -> dict[str, Call]:
    """The laws of an effect with what each of their arguments is, and the parameters that its slot names."""
    slot, names = effect.slot, [p.name for p in effect.parameters]
    calls: dict[str, Call] = {f: (a, tuple(arguments(a, slot.states, effect))) for f, a in slot.laws().items()}
    return calls | {field: (_itself, (names.index(name),)) for field, name in slot.named().items()}


def listed(slot: type[Slot]) -> list[dict[str, Call]]:
    """The different laws in a slot, by code."""
    found = [calls_of(PLAIN)] if slot is slots.Contact else []
    for effect in catalogue.SHIPPED.values():
        if isinstance(effect.slot, slot):
            calls = calls_of(effect)
            if calls not in found:
                found.append(calls)
            CODES[effect.kind, effect.name] = found.index(calls)
    return found


def _fields(slot: type[Slot]) -> list[str]:
    """The fields of a slot that a step calls, in the order in which a law at an address knows them."""
    return [name for name, kind in slot.__annotations__.items() if kind in ("Law", "str")]


def _space(**functions: Any) -> dict[str, Any]:
    """What a function that is written out sees; compiled code that is kept names the module that it is loaded with."""
    return {"__name__": __name__, **functions}


def _written(name: str, slot: type[Slot], field: str) -> Any:
    """The compiled function of one field of a slot: (code, states, p, e) -> the value of the law of entry e, or 0."""
    states = ", ".join(slot.states)
    lines = [f"def {name}(code, {states}, p, e):"]
    space = _space(_at_address=_at_address)
    for code, calls in enumerate(listed(slot)):
        space[f"law_{code}"], names = calls[field]
        given = ", ".join(f"p[e, {n}]" if isinstance(n, int) else "p[e]" if n == slots.ROW else n for n in names)
        lines += [f"    if code == {code}:", f"        return law_{code}({given})"]
    rest = ", ".join(f"p[e, {n}]" for n in range(LAW_PARAMETERS))
    lines.append(f"    return _at_address(code, ({_fields(slot).index(field)}.0, {states}, {rest}))")
    exec(compile("\n".join(lines), f"<laws of {name}>", "exec"), space)
    return inlined(space[name])


def code_of(effect: Effect) -> int:
    """What stands for the laws of an effect in a plant: below 0 for those of others, in this process."""
    key = effect.kind, effect.name
    if catalogue.SHIPPED.get(key) is effect:
        return CODES[key]
    with _adding:
        for place, other in enumerate(OTHERS):
            if other is effect:
                return -1 - place
        OTHERS.append(effect)
        return -len(OTHERS)


def other_of(code: int) -> Effect:
    """The effect that a code below 0 stands for."""
    return OTHERS[-1 - code]


def addressed(codes: Iterable[int]) -> Ints:
    """Codes as loops that numba compiles take them: of others the addresses of their laws, compiled here."""
    return np.array([_address_of(int(code)) if code < 0 else code for code in codes], dtype=np.int64)


def _address_of(code: int) -> int:
    """The address of the function of all laws of an effect of others."""
    for address, (other, _) in list(ADDRESSES.items()):  # another thread may add one
        if other == code:
            return address
    effect = other_of(code)
    states = effect.slot.states
    lines = [f"def at_address(field, {', '.join([*states, *(f'p{n}' for n in range(LAW_PARAMETERS))])}):"]
    space = _space()
    for field, (function, names) in calls_of(effect).items():
        space[f"law_{field}"] = function
        given = ", ".join(f"p{n}" if isinstance(n, int) else n for n in names)
        lines += [f"    if field == {_fields(type(effect.slot)).index(field)}.0:"]
        lines += [f"        return float(law_{field}({given}))"]
    lines.append("    return 0.0")
    exec(compile("\n".join(lines), f"<law of {effect.name}>", "exec"), space)
    function = kept(_nrt=False)(space["at_address"])
    kinds = (types.float64,) * (1 + len(states) + LAW_PARAMETERS)
    function.compile(kinds)
    made = function.overloads[kinds]
    address = int(made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name))
    ADDRESSES[address] = code, function
    return address


def named(codes: Any) -> dict[int, Name]:
    """Those of some entries' laws that others have registered, by a name that another process understands."""
    found = {}
    for entry, code in enumerate(codes):
        at_address = int(code) in ADDRESSES
        if at_address or code < 0:
            effect = other_of(ADDRESSES[int(code)][0] if at_address else int(code))
            found[entry] = effect.kind, effect.name, effect.declared, at_address
    return found


def code_named(name: Name) -> int:
    """The code (or address) of a law that :func:`named` has named; declared here where it is not known yet."""
    kind, effect, declared, at_address = name
    if declared is not None:
        catalogue.declare({effect: declared}, "rig.laws")
    code = code_of(catalogue.find(kind, effect, "rig.effects"))
    return _address_of(code) if at_address else code


PLAIN = catalogue.SHIPPED["rotor", "coulomb_friction"]
body_effort = _written("body_effort", slots.BodyEffort, "law")
remembered_effort = _written("remembered_effort", slots.BodyMemory, "effort")
memory_rate = _written("memory_rate", slots.BodyMemory, "rate")
friction_level = _written("friction_level", slots.Contact, "level")
spring_force = _written("spring_force", slots.SpringForce, "law")
spring_stretch = _written("spring_stretch", slots.SpringPlay, "law")
memory_after = _written("memory_after", slots.SpringMemory, "after")
memory_force = _written("memory_force", slots.SpringMemory, "force")
amplified = _written("amplified", slots.Command, "law")
winding_rate = _written("winding_rate", slots.WindingMemory, "rate")
winding_voltage = _written("winding_voltage", slots.WindingMemory, "voltage")
motor_torque = _written("motor_torque", slots.MotorTorque, "law")
lead_error = _written("lead_error", slots.Lead, "law")
lead_slope = _written("lead_slope", slots.Lead, "slope")
shown = _written("shown", slots.Reading, "law")
