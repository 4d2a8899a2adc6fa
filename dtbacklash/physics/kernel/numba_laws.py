"""Laws as functions that numba's loops call: one a slot, which calls the law that an entry's code stands for.

numba compiles a call of functions that are known when it compiles; the functions here are therefore written out, as
chains of comparisons over the effects that come with the package, when this module is imported. A law that no effect of
the rig uses costs nothing. A law that somebody else has registered is called at an address: :func:`addressed` compiles
it by itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from dtbacklash.arrays import Ints
from dtbacklash.compiled import inlined, kept, law
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.slots import LAW_PARAMETERS, Slot
from dtbacklash.physics.kernel.dispatch import calls_of, listed, other_of

#: address -> the code of the law there, and the compiled function, which is not freed
ADDRESSES: dict[int, tuple[int, Any]] = {}


@cache
def jitted(function: Any) -> Any:
    """A law of Python as numba calls it, with the functions of its module that it calls."""
    if not isinstance(function, FunctionType):
        return function  # numba's own already
    names = {n: function.__globals__.get(n) for n in function.__code__.co_names}
    space = {**function.__globals__, **{n: jitted(f) for n, f in names.items() if isinstance(f, FunctionType)}}
    return law(FunctionType(function.__code__, space, function.__name__, function.__defaults__, function.__closure__))


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
        function, names = calls[field]
        space[f"law_{code}"] = jitted(function)
        given = ", ".join(f"p[e, {n}]" if isinstance(n, int) else "p[e]" if n == slots.ROW else n for n in names)
        lines += [f"    if code == {code}:", f"        return law_{code}({given})"]
    rest = ", ".join(f"p[e, {n}]" for n in range(LAW_PARAMETERS))
    lines.append(f"    return _at_address(code, ({_fields(slot).index(field)}.0, {states}, {rest}))")
    exec(compile("\n".join(lines), f"<laws of {name}>", "exec"), space)
    return inlined(space[name])


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
        space[f"law_{field}"] = jitted(function)
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
