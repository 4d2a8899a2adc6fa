"""From the catalogue to compiled code: one function a slot, which calls the law that an entry's code stands for.

numba compiles a call of functions that are known when it compiles; the functions here are therefore written out, as
chains of comparisons, when this module is imported. A law that no effect of the rig uses costs nothing.
"""

from __future__ import annotations

from typing import Any

from dtbacklash.compiled import inlined, law
from dtbacklash.physics import catalogue
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect
from dtbacklash.physics.effects.slots import Law, Slot, arguments

Call = tuple[Law, tuple[str | int, ...]]

#: (kind, effect) -> the code of its laws in the functions of its slot
CODES: dict[tuple[str, str], int] = {}

#: the law of dry friction whose level is its only parameter: that of a kind that is held by friction of itself
PLAIN_FRICTION = 0


@law
def _itself(value):
    return value


def _calls(effect: Effect) -> dict[str, Call]:
    """The laws of an effect with what each of their arguments is, and the parameters that its slot names."""
    slot, names = effect.slot, [p.name for p in effect.parameters]
    calls: dict[str, Call] = {f: (a, tuple(arguments(a, slot.states, effect))) for f, a in slot.laws().items()}
    return calls | {field: (_itself, (names.index(name),)) for field, name in slot.named().items()}


def _listed(slot: type[Slot]) -> list[dict[str, Call]]:
    """The different laws in a slot, by code."""
    listed = [_calls(PLAIN)] if slot is slots.Contact else []
    for key, effect in catalogue.CATALOGUE.items():
        if isinstance(effect.slot, slot):
            calls = _calls(effect)
            if calls not in listed:
                listed.append(calls)
            CODES[key] = listed.index(calls)
    return listed


def _written(name: str, slot: type[Slot], field: str) -> Any:
    """The compiled function of one field of a slot: (code, states, p, e) -> the value of the law of entry e, or 0."""
    lines = [f"def {name}(code, {', '.join(slot.states)}, p, e):"]
    space: dict[str, Any] = {"__name__": __name__}  # by which kept code finds its module again
    for code, calls in enumerate(_listed(slot)):
        space[f"law_{code}"], names = calls[field]
        given = ", ".join(f"p[e, {n}]" if isinstance(n, int) else "p[e]" if n == slots.ROW else n for n in names)
        lines += [f"    if code == {code}:", f"        return law_{code}({given})"]
    lines.append("    return 0.0")
    exec(compile("\n".join(lines), f"<laws of {name}>", "exec"), space)
    return inlined(space[name])


PLAIN = catalogue.CATALOGUE["rotor", "coulomb_friction"]
catalogue.close()
body_effort = _written("body_effort", slots.BodyEffort, "law")
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
