"""An FMU for Model Exchange as a rig: pairs of its states are joints, its real inputs are actuators and forces.

A rig's file names the states that are a joint's position and speed, and the input through which a force acts on it;
all else stays in the FMU.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.config.rig import ParameterConfig, RigConfig, share_of
from dtbacklash.errors import UserError
from dtbacklash.physics.element_kinds import LINEAR, MODEL_OUTPUT, ROTARY
from dtbacklash.physics.fmu_file import Model, alone, model_of
from dtbacklash.physics.mjcf import ACTUATOR_PREFIX, KIND, check_columns, named

__all__ = ["completed", "effects_of_inputs", "first_inputs", "model_of", "new_rig", "pairs", "passes",
           "rates_by_states", "start_values", "unit_of"]  # fmt: skip

#: units of positions that turn, and that slide
AXIS = {"rad": ROTARY, "m": LINEAR}
#: units of forces, as FMUs write them
EFFORTS = {ROTARY: ("N.m", "N m", "Nm", "N*m"), LINEAR: ("N",)}
#: fields of a joint; before a parameter's name, where somebody writes it
FIELDS, PREFIX = ("position", "speed", "force", "slides"), "parameters."
#: what ``dtb rig new fmu`` writes for a parameter; it lists so many at most
USUAL, LISTED = "10 %", 40
#: states and inputs are moved by so much to see what is whose derivative (relative)
MOVED, ALIKE = 1e-3, 1e-6


def first_inputs(model: Model) -> dict[str, float]:
    """Input -> what it is where nobody sets it."""
    return {name: float(v.start or 0.0) for name, v in model.inputs.items()}


@alone
def pairs(model: Model) -> dict[str, str]:
    """Position -> speed: states of which one is the derivative of the other, wherever they are."""
    instance, rng = model.instance(), np.random.default_rng(0)
    x, names = instance.begin({}), model.states
    inputs, found = first_inputs(model), []
    for _ in range(3):
        z = x + MOVED * np.maximum(np.abs(x), 1.0) * rng.uniform(0.5, 1.0, len(x))
        rate = instance.rates(z, inputs)
        found.append(np.abs(rate[:, None] - z) <= ALIKE * MOVED)
    whose = np.all(found, axis=0)
    return {names[i]: names[int(np.argmax(row))] for i, row in enumerate(whose) if row.sum() == 1}


@alone
def effects_of_inputs(model: Model, values: Mapping[str, float]) -> dict[str, Floats]:
    """Input -> (states,) by how much a unit of it changes the derivatives at once, at the first state."""
    instance, inputs = model.instance(), first_inputs(model)
    x = instance.begin(values)
    rest = instance.rates(x, inputs)
    return {name: instance.rates(x, {**inputs, name: inputs[name] + 1.0}) - rest for name in inputs}


@alone
def rates_by_states(model: Model, values: Mapping[str, float], at: Mapping[int, float] | None = None) -> Floats:
    """(states, states) derivatives of the derivatives by the states, at the first state, or with some states moved.

    Raises
    ------
    UserError : the FMU refuses that state.
    """
    instance, inputs = model.instance(), first_inputs(model)
    x = instance.begin(values)
    if at:
        x[list(at)] = list(at.values())
        instance.visit(x)
    moves = MOVED * np.diag(np.maximum(np.abs(x), 1.0))
    slopes = [(instance.rates(x + z, inputs) - instance.rates(x - z, inputs)) / (2.0 * z.sum()) for z in moves]
    return np.array(slopes).T


def completed(config: RigConfig) -> RigConfig:
    """The description of a rig whose file names an FMU, with its joints, actuators, outputs and uncertain parameters.

    Raises
    ------
    UserError : a name that the FMU has not; states that are no pair; an input that is none, or moves
        nothing; what is named twice.
    """
    model = model_of(config)
    at_once = effects_of_inputs(model, {})
    joints = _joints(model, config, at_once)
    elements: dict[str, Any] = {n: {"kind": KIND[LINEAR if j["slides"] else ROTARY]} for n, j in joints.items()}
    if config.fixed:
        raise UserError("rig.fixed", config.fixed[0], "an FMU's joints cannot be taken out; leave it out of `joints`")
    check_columns(config)
    elements |= {
        ACTUATOR_PREFIX + name: {"kind": "joint_drive", "drives": driven}
        for name, driven in _drives(model, config, joints, at_once).items()
    }
    for column, sensor in config.sensors.items():
        of = sensor["of"]
        if not isinstance(of, str):
            raise UserError(f"rig.sensors.{column}.of", of, "one name: of a joint, or of a variable of the FMU")
        driven = elements.get(of, {}).get("drives")
        if of not in elements and of in model.variables:
            elements[of] = {"kind": MODEL_OUTPUT}
            if sensor.get("recorded_in"):
                allowed = f"leave it out: a column of {of} is in what the FMU gives"
                raise UserError(f"rig.sensors.{column}.recorded_in", sensor["recorded_in"], allowed)
        elif driven and not passes(joints[driven], at_once, of, model.states):
            allowed = "how this input acts on its joint is the FMU's; name a variable of it, with the quantity value"
            raise UserError(f"rig.sensors.{column}.of", of, allowed)
    name = config.name if config.name != RigConfig.name else Path(config.model).stem
    return replace(config, name=name, elements=elements, joints=joints, parameters=_parameters(model, config))


def _joints(model: Model, config: RigConfig, at_once: Mapping[str, Floats]) -> dict[str, dict[str, Any]]:
    """The joints that a rig's file names, each with states and a force of its own."""
    found = pairs(model)
    joints = {name: _joint(model, found, at_once, name, spec) for name, spec in config.joints.items()}
    if not joints:
        usual = ", ".join(f"{_plain(_short(q))}: {{position: {_plain(q)}}}" for q in found)
        raise UserError("rig.joints", "(none)", f"name at least one, as {{{usual or 'NAME: {position: STATE}'}}}")
    for field in ("position", "speed", "force"):
        theirs = [joint[field] for joint in joints.values()]
        for name, joint in joints.items():
            if joint[field] and theirs.count(joint[field]) > 1:
                raise UserError(f"rig.joints.{name}.{field}", joint[field], "is of two joints; each has its own")
    return joints


def _drives(
    model: Model, config: RigConfig, joints: Mapping[str, Mapping[str, Any]], at_once: Mapping[str, Floats]
) -> dict[str, str]:
    """Input that has a column -> the joint that it drives."""
    if not config.commands:
        usual = _plain(next(iter(model.inputs), "INPUT"))
        raise UserError("rig.commands", "(none)", f"an input of the FMU has a column: {{COLUMN: {usual}}}")
    order, slopes = model.states, rates_by_states(model, {})
    speeds, drives = [order.index(joint["speed"]) for joint in joints.values()], {}
    for column, name in config.commands.items():
        named(f"rig.commands.{column}", name, model.inputs)
        own = [j for j, joint in joints.items() if joint["force"] == name]
        way = at_once[name]  # through a winding, say, to what it drives
        for _ in order[1:]:
            way = way if way[speeds].any() else slopes @ way
        if not own and not way[speeds].any():
            allowed = "moves none of the joints from the FMU's first state on; leave it out, or name the joint it moves"
            raise UserError(f"rig.commands.{column}", name, allowed)
        drives[str(name)] = own[0] if own else list(joints)[int(np.argmax(np.abs(way[speeds])))]
    return drives


def _parameters(model: Model, config: RigConfig) -> dict[str, ParameterConfig]:
    """Those of the FMU that may be off, by its names."""
    parameters: dict[str, ParameterConfig] = {}
    for written, share in config.tolerances.items():
        key = f"rig.tolerances.{written}"
        title = written if written in model.variables else written.removeprefix(PREFIX)
        variable = named(key, title, model.parameters)
        if title in parameters:
            raise UserError(key, share, f"{title} is named twice; once is enough")
        about = variable.description or ""
        parameters[title] = ParameterConfig(float(variable.start), _in_si(variable), share_of(key, share), about)
    return parameters


def passes(joint: Mapping[str, Any], at_once: Mapping[str, Floats], actuator: str, order: list[str]) -> float:
    """The force on a joint by a unit of an actuator's input, N or N m; 0 where that acts through other states."""
    at = order.index(joint["speed"])
    return (
        float(at_once[actuator.removeprefix(ACTUATOR_PREFIX)][at] / at_once[force][at])
        if (force := joint["force"])
        else 0.0
    )


def _joint(
    model: Model, found: Mapping[str, str], at_once: Mapping[str, Floats], name: str, spec: Any
) -> dict[str, Any]:
    """A joint with all its fields, checked."""
    key = f"rig.joints.{name}"
    if "." in name:
        raise UserError(key, name, "a name without dots; it is yours, and not the FMU's")
    if not isinstance(spec, Mapping) or "position" not in spec or not set(spec) <= set(FIELDS):
        raise UserError(key, spec, "a mapping with position and, where wanted, speed, force (an input), slides (true)")
    position = spec["position"]
    named(f"{key}.position", position, dict.fromkeys(model.states))
    speed = spec.get("speed") or found.get(position)
    if speed is None:
        raise UserError(f"{key}.position", position, "no state is its derivative; name the state that is its speed")
    named(f"{key}.speed", speed, dict.fromkeys(model.states))
    if found.get(position) != speed:
        raise UserError(
            f"{key}.speed", speed, f"is not the derivative of {position}, which is {found.get(position, 'no state')}"
        )
    unit = _unit(model.variables[position])
    if unit and unit not in AXIS:
        raise UserError(f"{key}.position", position, f"is in {unit}; a joint's state must be in m or rad")
    slides = spec.get("slides", AXIS.get(unit) == LINEAR)
    if not isinstance(slides, bool):
        raise UserError(f"{key}.slides", slides, "true or false")
    if unit and slides != (AXIS[unit] == LINEAR):
        raise UserError(f"{key}.slides", slides, f"{position} is in {unit}; leave it out")
    if (force := spec.get("force")) not in (None, ""):
        named(f"{key}.force", force, model.inputs)
        if not at_once[force][model.states.index(speed)] > 0.0:
            raise UserError(f"{key}.force", force, f"does not push {speed} forward at once: no force on this joint")
    return {"position": position, "speed": speed, "force": force or "", "slides": slides}


def _unit(variable: Any) -> str:
    """The unit of a variable, its own or its type's."""
    return str(variable.unit or (variable.declaredType.unit if variable.declaredType else "") or "")


def unit_of(config: RigConfig, name: str) -> str:
    """The unit of a variable of a rig's FMU as that writes it, or empty."""
    return _unit(model_of(config).variables[name])


def _in_si(variable: Any) -> str:
    """The unit of a variable, written as ours (``kg.m2``: kg m^2); empty where it is another than SI, or unknown."""
    found = units.composed(re.sub(r"(?<=[A-Za-z])-?[2-9]", r"^\g<0>", re.sub("[.*]", " ", _unit(variable))))
    return found.si if found and found.factor == 1.0 else ""


def _short(state: str) -> str:
    """A joint's name from that of its position: ``arm.elbow.phi`` is arm_elbow."""
    return re.sub(r"\W+", "_", re.sub(r"\.(q|s|phi|x|position|angle)$", "", state)).strip("_")


def _plain(name: str) -> str:
    """A name as YAML has it, also between brackets: ``rail.r[1]`` and ``no`` stand in quotes."""
    bare = re.fullmatch(r"[A-Za-z_][\w.]*", name) and yaml.safe_load(name) == name
    return name if bare else json.dumps(name, ensure_ascii=False)


def new_rig(path: str) -> str:
    """The text of a rig's file for an FMU: its pairs of states as joints, its inputs, usual tolerances."""
    model = model_of(replace(RigConfig(), model=path))
    found, at_once, order = pairs(model), effects_of_inputs(model, {}), model.states
    forces: dict[str, str] = {}
    for position, speed in found.items():
        axis = AXIS.get(_unit(model.variables[position]), ROTARY)
        pushes = {
            name: float(effect[order.index(speed)] / np.linalg.norm(effect))
            for name, effect in at_once.items()
            if name not in forces.values() and effect[order.index(speed)] > 0.0
            and (not (unit := _unit(model.variables[name])) or unit in EFFORTS[axis])
        }  # fmt: skip
        # commands come first in most descriptions, and ports for forces behind
        forces[position] = max(reversed(pushes), key=lambda n: pushes[n], default="")
    told = [name for name in model.inputs if name not in forces.values()] or list(model.inputs)
    lines = [
        f"model: {_plain(Path(path).name)}",
        "",
        "# the column of the log: the input of the FMU that it is",
        "commands:",
    ]
    lines += [f"  u_{_short(name)}: {_plain(name)}" for name in told] or ["  # the FMU has no real input"]
    lines += ["", "# position and speed: states, of which one is the other's derivative; force: the input through",
              "# which a force acts on it, positive along its motion; without one no friction is looked for there",
              "joints:" if found else "joints: {}  # no state of the FMU is another's derivative"]  # fmt: skip
    for position, speed in found.items():
        force = f", force: {_plain(forces[position])}" if forces[position] else ""
        states = f"position: {_plain(position)}, speed: {_plain(speed)}"
        lines.append(f"  {_plain(_short(position))}: {{{states}{force}}}")
    lines += ["", "# the column of the log: what it shows. quantity: position, velocity, acceleration of a joint;",
              "# value of any variable of the FMU; recorded_in: deg, say; absolute: it is 0 where the FMU's state is",
              "sensors:" if found else "sensors: {}"]  # fmt: skip
    for position in found:
        unit, joint = _unit(model.variables[position]) or "rad; m if its joint has slides: true", _short(position)
        lines.append(f"  q_{joint}: {{of: {_plain(joint)}, quantity: position, absolute: true}}  # {unit}")
    lines += ["", "# how far parameters of the FMU may be off, one standard deviation", "tolerances:"]
    known = {n: v for n, v in model.parameters.items() if float(v.start) and math.isfinite(float(v.start))}
    lines += [f"  {_plain(name)}: {USUAL}" for name in list(known)[:LISTED]]
    return "\n".join([*lines, ""])


def start_values(config: RigConfig) -> str:
    """The parameters of a rig's FMU as they were found, a YAML text: name -> start value."""
    return yaml.safe_dump({name: float(p.value) for name, p in config.parameters.items()}, sort_keys=False)
