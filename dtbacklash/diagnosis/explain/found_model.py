"""What was found, put back into a simulator's model: ``arm.xml`` with the numbers, ``laws.py`` with what it has not.

MuJoCo has dampings and dry frictions of its own; a law of another form is written out as plain Python, from the very
functions that the diagnosis simulates. Of an FMU the numbers are start values, ``parameters.yaml``, and all laws stand
in ``laws.py``, as what is added to its inputs.
"""

import inspect
import re
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dtbacklash.physics import fmus
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.c_law import c_law_of
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.effects.slots import ROW, arguments, formula_of
from dtbacklash.physics.mjcf import ACTUATOR_PREFIX, mended, model_of, number_of
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

HEAD = '''\
"""What a diagnosis found in {model} and MuJoCo has not. Call ``apply(model, data)`` before each ``mujoco.mj_step``,
after ``data.ctrl`` has been set{said}."""

import math
'''
FMU_HEAD = '''\
"""What a diagnosis found in {model} beside its parameters. ``inputs(time, position, speed, command)`` takes joint ->
its position and speed, and input -> its command, and gives the FMU's inputs with what was found{said}.
Below SLOW, m/s or rad/s, a dry friction grows with the speed."""

import math

SLOW = 1e-4
'''
#: what formulas call, as plain Python
FORMULA_FUNCTIONS = """\
from math import atan, cos, exp, log, sin, sqrt, tan, tanh


def sign(x):
    return (x > 0.0) - (x < 0.0)"""
#: what a joint's law may ask for, in terms of MuJoCo's data
STATES = {
    "position": "float(q)", "velocity": "float(v)", "time": "data.time", "slip_speed": "abs(float(v))",
    "direction": "math.copysign(1.0, v)", "load": "float(data.qfrc_actuator[dof])", "command": "float(data.ctrl[at])",
}  # fmt: skip
#: and in what an FMU's function is given
FMU_STATES = {
    "position": "q", "velocity": "v", "time": "time", "slip_speed": "abs(v)", "direction": "math.copysign(1.0, v)",
    "load": "load", "command": "u",
}  # fmt: skip


def found_model(rig: Rig) -> dict[str, str]:
    """File name -> text: the model with a rig's numbers, dampings and dry frictions, and a script with the other laws.

    Raises
    ------
    UserError : the model's file is not there any more.
    """
    return {"mujoco": _found_mjcf, "fmu": _found_fmu}[rig.config.simulator](rig)


def _found_mjcf(rig: Rig) -> dict[str, str]:
    frictions: dict[str, float] = {}
    dampings: dict[str, float] = {}
    plays: dict[str, float] = {}
    calls: list[str] = []
    levels: dict[str, list[str]] = {}
    sources: dict[str, str] = {}
    beside: list[str] = []
    for name in rig.effects:
        for effect, values in rig.active(name, slots.Slot):
            slot, element = effect.slot, rig.elements.get(name)
            joint = str(element.neighbours.get("drives", name)) if element else ""
            if isinstance(slot, slots.BodyDamping):
                dampings[joint] = dampings.get(joint, 0.0) + values[slot.coefficient]
            elif isinstance(slot, slots.JointPlay):
                plays[joint] = values[slot.width]
            elif isinstance(slot, slots.Contact) and not slots.asked(effect):
                given = [list(values.values())[n] for n in arguments(slot.level, (), effect) if isinstance(n, int)]
                frictions[joint] = frictions.get(joint, 0.0) + float(slot.level(*given))
            elif not _in_c(effect) and isinstance(slot, (slots.BodyEffort, slots.Contact, slots.Command)):
                value = _call(effect, values, sources)
                if isinstance(slot, slots.Contact):
                    frictions.setdefault(joint, 0.0)
                    levels.setdefault(joint, []).append(value)
                elif isinstance(slot, slots.BodyEffort):
                    calls += [*_at(joint), f"data.qfrc_applied[dof] += {value}  # {effect.name}"]
                else:
                    actuator = name.removeprefix(ACTUATOR_PREFIX)
                    calls += [f"at = model.actuator({actuator!r}).id", f"data.ctrl[at] = {value}  # {effect.name}"]
            else:
                beside.append(f"{effect.name} of {name.removeprefix(SENSOR_PREFIX)}")
    for joint, values_of in levels.items():  # what holds at rest is the model's
        title, known = f"joints.{joint}.frictionloss", rig.config.parameters
        own = known[title].value if title in known else number_of(model_of(rig.config), title)
        still = own + frictions[joint]
        calls += [*_at(joint), f"model.dof_frictionloss[dof] = {' + '.join([repr(still), *values_of])}"]
    file = Path(rig.config.model).name
    files = {file: mended(rig.config, frictions, dampings, plays)}
    if calls or beside:
        said = f"; not in it, as it is no force or stands in C: {', '.join(beside)}" if beside else ""
        pushed = [_at(name)[0] for name in rig.elements if _at(name)[0] in calls]
        lines = [*(f"data.qfrc_applied[{line.removeprefix('joint = ')}.dofadr[0]] = 0.0" for line in pushed), *calls]
        body = "".join(f"    {line}\n" for line in lines or ["pass"])
        texts = [HEAD.format(model=file, said=said), *sources.values()]
        files["laws.py"] = "\n\n".join(texts) + f"\n\n\ndef apply(model, data):\n{body}"
    return files


def _found_fmu(rig: Rig) -> dict[str, str]:
    told: list[str] = []
    forces: list[str] = []
    sources: dict[str, str] = {}
    beside: list[str] = []
    model = fmus.model_of(rig.config)
    effects = fmus.effects_of_inputs(model, {n: float(p.value) for n, p in rig.config.parameters.items()})
    for name in rig.effects:
        for effect, values in rig.active(name, slots.Slot):
            slot, element = effect.slot, rig.elements.get(name)
            joint = str(element.neighbours.get("drives", name)) if element else ""
            known = slots.BodyDamping, slots.BodyEffort, slots.Contact, slots.Command
            if _in_c(effect) or not isinstance(slot, known):
                beside.append(f"{effect.name} of {name.removeprefix(SENSOR_PREFIX)}")
                continue
            value = f"-{float(next(iter(values.values())))!r} * v"
            if not isinstance(slot, slots.BodyDamping):
                value = _call(effect, values, sources, FMU_STATES)
            if isinstance(slot, slots.Command):
                u = f"found[{name.removeprefix(ACTUATOR_PREFIX)!r}]"
                told += [f"u = {u}", f"{u} = {value}  # {effect.name}"]
                continue
            spec = rig.config.joints[joint]
            force = spec["force"]
            if isinstance(slot, slots.Contact):
                value = f"-max({value}, 0.0) * math.tanh(v / SLOW)"
                drives = [a for a in rig.elements if rig.elements[a].neighbours.get("drives") == joint]
                loads = {
                    a.removeprefix(ACTUATOR_PREFIX): fmus.passes(spec, effects, a, list(model.states)) for a in drives
                }
                load = " + ".join(f"{by!r} * sent[{i!r}]" for i, by in loads.items() if by)
                forces.append(f"load = {load or '0.0'}")
            forces += [f"q, v = position[{joint!r}], speed[{joint!r}]",
                       f"found[{force!r}] = found.get({force!r}, 0.0) + {value}  # {effect.name}"]  # fmt: skip
    files = {"parameters.yaml": fmus.start_values(rig.config)}
    if told or forces or beside:
        said = f"; not in it, as it is no force or stands in C: {', '.join(beside)}" if beside else ""
        sent = ["sent = dict(found)"] if any(" sent[" in line for line in forces) else []
        lines = ["found = dict(command)", *told, *sent, *forces, "return found"]
        texts = [FMU_HEAD.format(model=Path(rig.config.model).name, said=said), *sources.values()]
        body = "".join(f"    {line}\n" for line in lines)
        files["laws.py"] = "\n\n".join(texts) + f"\n\n\ndef inputs(time, position, speed, command):\n{body}"
    return files


def _at(joint: str) -> list[str]:
    """The lines that find a joint and its state."""
    return [f"joint = model.joint({joint!r})", "dof = joint.dofadr[0]",
            "q, v = data.qpos[joint.qposadr[0]], data.qvel[dof]"]  # fmt: skip


def _in_c(effect: Effect) -> bool:
    """Whether a law of an effect cannot be written out."""
    return any(c_law_of(law) for law in effect.slot.laws().values())


def _call(effect: Effect, values: Values, sources: dict[str, str], states: Mapping[str, str] = STATES) -> str:
    """An effect's law with its values, of a simulator's data; its source is added to ``sources``."""
    law = next(iter(effect.slot.laws().values()))
    numbers = [float(v) for v in values.values()]
    names = arguments(law, effect.slot.states, effect)
    given = [repr(numbers[n]) if isinstance(n, int) else repr(numbers) if n == ROW else states[n] for n in names]
    if formula := formula_of(law):
        sources |= {"": FORMULA_FUNCTIONS, effect.name: formula.source(effect.name)}
    else:
        _gather(law, sources)
    return f"{effect.name if formula else law.__name__}({', '.join(given)})"


def _gather(function: Any, found: dict[str, str]) -> None:
    """The source of a function of numbers and of those that it calls, without their decorators."""
    if function.__name__ in found:
        return
    known = inspect.getclosurevars(function).globals
    for name, value in known.items():
        inner = value
        if isinstance(inner, types.FunctionType):
            _gather(inner, found)
        elif not isinstance(value, types.ModuleType):
            found.setdefault(name, f"{name} = {value!r}")
    found[function.__name__] = re.sub(r"\A(@.*\n)+", "", inspect.getsource(function)).rstrip()
