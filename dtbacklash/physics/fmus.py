"""An FMU for Model Exchange as a rig: pairs of its states are joints, its real inputs are actuators and forces.

A rig's file names the states that are a joint's position and speed, and the input through which a force acts on it;
all else stays in the FMU. FMPy unpacks it, reads its description and loads its library; it is imported where an FMU is
read.
"""

from __future__ import annotations

import functools
import math
import re
import tempfile
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dtbacklash.arrays import Floats
from dtbacklash.config.rig import ParameterConfig, RigConfig, share_of
from dtbacklash.errors import UserError
from dtbacklash.physics.kinds import LINEAR, MODEL_OUTPUT, ROTARY
from dtbacklash.physics.mjcf import ACTUATOR_PREFIX, KIND, check_columns, named

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
LOADING = threading.Lock()


@dataclass(frozen=True, eq=False)
class Model:
    """An FMU, unpacked. states : in its own order -> its derivative. variables : all numbers by name."""

    path: str
    folder: tempfile.TemporaryDirectory[str]
    description: Any
    states: dict[str, Any]
    variables: dict[str, Any]
    own: threading.local

    def of(self, *causalities: str) -> dict[str, Any]:
        """Its real variables of these causalities."""
        return {name: v for name, v in self.variables.items() if v.causality in causalities}

    @property
    def inputs(self) -> dict[str, Any]:
        """Its real inputs that may change at any time."""
        return {name: v for name, v in self.of("input").items() if v.variability in (None, "continuous")}

    @property
    def parameters(self) -> dict[str, Any]:
        """Its real parameters that may be set."""
        known = {**self.of("parameter"), **{n: v for n, v in self.variables.items() if v.variability == "tunable"}}
        return {n: v for n, v in known.items() if v.start is not None and v.causality != "calculatedParameter"}

    @property
    def signs(self) -> int:
        """Event indicators."""
        return int(self.description.numberOfEventIndicators or 0)

    @property
    def switches(self) -> bool:
        """Whether something in it may switch, or it has to be told of each step."""
        told = bool(self.description.modelExchange.needsCompletedIntegratorStep)
        return self.signs > 0 or told or self.instance().next_s < math.inf

    @property
    def threes(self) -> bool:
        """Whether it is of FMI 3.0."""
        return str(self.description.fmiVersion).startswith("3")

    def instance(self) -> Instance:
        """An instance of this thread: a library may keep nothing apart that two threads change."""
        if not hasattr(self.own, "instance"):
            self.own.instance = Instance(self)
        found: Instance = self.own.instance
        return found


def model_of(config: RigConfig) -> Model:
    """A rig's FMU.

    Raises
    ------
    UserError : no such file, no FMU, none for Model Exchange, for another platform, without states; FMPy is missing.
    """
    file = Path(config.model)
    if not file.is_file():
        raise UserError("rig.model", config.model, "no such file; a path from the rig's file on")
    return _read(config.model, file.stat().st_mtime_ns)


@functools.lru_cache(maxsize=16)
def _read(path: str, stamp: int) -> Model:
    try:
        import fmpy
    except ImportError:
        raise UserError("rig.model", path, "needs FMPy: pip install dtbacklash[fmu]") from None
    folder = tempfile.TemporaryDirectory()
    try:
        described = fmpy.read_model_description(path, validate=False)
        fmpy.extract(path, folder.name)
    except Exception as error:  # FMPy has no class of its own for what is wrong in a file
        raise UserError("rig.model", path, f"is no FMU: {' '.join(str(error).split())}") from error
    if described.fmiVersion not in ("2.0", "3.0"):
        raise UserError("rig.model", path, f"is FMI {described.fmiVersion}; FMI 2.0 and 3.0 are read")
    if described.modelExchange is None:
        allowed = "is for Co-Simulation only: it hides its states, and a diagnosis has to set them; export it for Model"
        raise UserError("rig.model", path, f"{allowed} Exchange")
    there = fmpy.supported_platforms(path)
    if fmpy.platform not in there:
        raise UserError("rig.model", path, f"is for {', '.join(there) or 'no platform'}; this one is {fmpy.platform}")
    real = {v.name: v for v in described.modelVariables if v.type in ("Real", "Float64") and not v.dimensions}
    states = {u.variable.derivative.name: u.variable for u in described.derivatives if u.variable.derivative}
    if not states or len(states) != len(described.derivatives) or not states.keys() <= real.keys():
        raise UserError("rig.model", path, "has no continuous states, each a number, that could be set")
    return Model(path, folder, described, states, real, threading.local())


class Instance:
    """An FMU that runs. fmu : FMPy's. said : what its library said last. next_s : when its clock strikes first."""

    def __init__(self, model: Model) -> None:
        from fmpy.simulation import instantiate_fmu

        self.model, self.said, self.next_s, self._begun = model, "", math.inf, False
        self.threes = model.threes
        try:
            with LOADING:  # FMPy goes to the library's folder and back
                self.fmu = instantiate_fmu(model.folder.name, model.description, "ModelExchange", logger=self._log)
        except Exception as error:
            raise UserError("rig.model", model.path, f"does not load: {' '.join(str(error).split())}") from error

    def _log(self, *arguments: Any) -> None:
        text = arguments[-1]
        self.said = text.decode(errors="replace") if isinstance(text, bytes) else str(text)

    def begin(self, values: Mapping[str, float]) -> Floats:
        """(states,) its first state with these parameters, ready for continuous time.

        Raises
        ------
        UserError : it does not take a value, or does not begin.
        """
        fmu, title = self.fmu, ""
        try:
            if self._begun:
                fmu.reset()
            self._begun = True
            for title, value in values.items():
                self._set([self.model.variables[title].valueReference], [value])
            title = ""
            if self.threes:
                fmu.enterInitializationMode()
            else:
                fmu.setupExperiment()
                fmu.enterInitializationMode()
            fmu.exitInitializationMode()
            said: Any = (True,)
            while said[0]:
                said = fmu.updateDiscreteStates() if self.threes else fmu.newDiscreteStates()
            self.next_s = float(said[-1]) if said[-2] else math.inf
            fmu.enterContinuousTimeMode()
            x = (self._doubles * len(self.model.states))()
            fmu.getContinuousStates(x, len(x))
        except Exception as error:
            key, given = (f"rig.tolerances.{title}", f"{values[title]:g}") if title else ("rig.model", self.model.path)
            said = " ".join((self.said or str(error)).split())
            raise UserError(key, given, f"the FMU does not begin with it: {said}") from error
        return np.array(x)

    @property
    def _doubles(self) -> Any:
        from ctypes import c_double

        return c_double

    def _set(self, references: Sequence[int], values: Sequence[float]) -> None:
        (self.fmu.setFloat64 if self.threes else self.fmu.setReal)(references, values)

    def address(self, name: str) -> int:
        """Of a function of its library; ``name`` without fmi2 or fmi3."""
        import ctypes

        function = getattr(self.fmu.dll, f"fmi{3 if self.threes else 2}{name}")
        return int(ctypes.cast(function, ctypes.c_void_p).value or 0)

    def rates(self, x: Floats, inputs: Mapping[str, float]) -> Floats:
        """(states,) derivatives at states and inputs, at the time 0."""
        self._set([self.model.variables[name].valueReference for name in inputs], list(inputs.values()))
        given, found = (self._doubles * len(x))(*x), (self._doubles * len(x))()
        self.fmu.setTime(0.0)
        self.fmu.setContinuousStates(given, len(x))
        (self.fmu.getContinuousStateDerivatives if self.threes else self.fmu.getDerivatives)(found, len(x))
        return np.array(found)


def first_inputs(model: Model) -> dict[str, float]:
    """Input -> what it is where nobody sets it."""
    return {name: float(v.start or 0.0) for name, v in model.inputs.items()}


def pairs(model: Model) -> dict[str, str]:
    """Position -> speed: states of which one is the derivative of the other, wherever they are."""
    instance, rng = model.instance(), np.random.default_rng(0)
    x, names = instance.begin({}), list(model.states)
    inputs, found = first_inputs(model), []
    for _ in range(3):
        z = x + MOVED * np.maximum(np.abs(x), 1.0) * rng.uniform(0.5, 1.0, len(x))
        rate = instance.rates(z, inputs)
        found.append(np.abs(rate[:, None] - z) <= ALIKE * MOVED)
    whose = np.all(found, axis=0)
    return {names[i]: names[int(np.argmax(row))] for i, row in enumerate(whose) if row.sum() == 1}


def effects_of_inputs(model: Model, values: Mapping[str, float]) -> dict[str, Floats]:
    """Input -> (states,) by how much a unit of it changes the derivatives at once, at the first state."""
    instance, inputs = model.instance(), first_inputs(model)
    x = instance.begin(values)
    rest = instance.rates(x, inputs)
    return {name: instance.rates(x, {**inputs, name: inputs[name] + 1.0}) - rest for name in inputs}


def rates_by_states(model: Model, values: Mapping[str, float]) -> Floats:
    """(states, states) derivatives of the derivatives by the states, at the first state."""
    instance, inputs = model.instance(), first_inputs(model)
    x = instance.begin(values)
    moves = MOVED * np.diag(np.maximum(np.abs(x), 1.0))
    slopes = [(instance.rates(x + z, inputs) - instance.rates(x - z, inputs)) / (2.0 * z.sum()) for z in moves]
    return np.array(slopes).T


def completed(config: RigConfig) -> RigConfig:
    """The description of a rig whose file names an FMU, with its joints, actuators, outputs and uncertain parameters.

    Raises
    ------
    UserError : a name that the FMU has not; states that are no pair; an input that is none, or moves nothing.
    """
    model = model_of(config)
    found, inputs = pairs(model), model.inputs
    at_once = effects_of_inputs(model, {})
    order = list(model.states)
    elements: dict[str, Any] = {}
    joints = {name: _joint(model, found, at_once, name, spec) for name, spec in config.joints.items()}
    if not joints:
        usual = ", ".join(f"{_short(q)}: {{position: {q}}}" for q in found)
        raise UserError("rig.joints", "(none)", f"name at least one, as {{{usual or 'NAME: {position: STATE}'}}}")
    for name, joint in joints.items():
        elements[name] = {"kind": KIND[LINEAR if joint["slides"] else ROTARY]}
        if "." in name:
            raise UserError(f"rig.joints.{name}", name, "a name without dots; it is yours, and not the FMU's")
    if config.fixed:
        raise UserError("rig.fixed", config.fixed[0], "an FMU's joints cannot be taken out; leave it out of `joints`")
    speeds, slopes = [order.index(joint["speed"]) for joint in joints.values()], rates_by_states(model, {})
    check_columns(config)
    if not config.commands:
        raise UserError(
            "rig.commands", "(none)", f"an input of the FMU has a column: {{COLUMN: {next(iter(inputs), 'INPUT')}}}"
        )
    for column, name in config.commands.items():
        named(f"rig.commands.{column}", name, inputs)
        own = [j for j, joint in joints.items() if joint["force"] == name]
        way = [at_once[name]]  # through a winding, say, to what it drives
        while not way[-1][speeds].any() and len(way) < len(order):
            way.append(slopes @ way[-1])
        driven = own[0] if own else list(joints)[int(np.argmax(np.abs(way[-1][speeds])))]
        elements[ACTUATOR_PREFIX + str(name)] = {"kind": "joint_drive", "drives": driven}
    for column, sensor in config.sensors.items():
        of = sensor["of"]
        if of not in elements and of in model.variables:
            elements[of] = {"kind": MODEL_OUTPUT}
        elif (driven := elements.get(of, {}).get("drives")) and not passes(joints[driven], at_once, of, order):
            allowed = "how this input acts on its joint is the FMU's; name a variable of it, with the quantity value"
            raise UserError(f"rig.sensors.{column}.of", of, allowed)
    parameters = {}
    for written, share in config.tolerances.items():
        title = written if written in model.variables else written.removeprefix(PREFIX)
        variable = named(f"rig.tolerances.{written}", title, model.parameters)
        parameters[title] = ParameterConfig(
            float(variable.start),
            _unit(variable),
            share_of(f"rig.tolerances.{written}", share),
            variable.description or "",
        )
    name = config.name if config.name != RigConfig.name else Path(config.model).stem
    return replace(config, name=name, elements=elements, joints=joints, parameters=parameters)


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
    if not isinstance(spec, Mapping) or "position" not in spec or not set(spec) <= set(FIELDS):
        raise UserError(key, spec, "a mapping with position and, where wanted, speed, force (an input), slides (true)")
    position = spec["position"]
    named(f"{key}.position", position, model.states)
    speed = spec.get("speed", found.get(position))
    if speed is None:
        raise UserError(f"{key}.position", position, "no state is its derivative; name the state that is its speed")
    named(f"{key}.speed", speed, model.states)
    if found.get(position) != speed:
        raise UserError(
            f"{key}.speed", speed, f"is not the derivative of {position}, which is {found.get(position, 'no state')}"
        )
    unit = _unit(model.variables[position])
    if unit and unit not in AXIS:
        raise UserError(f"{key}.position", position, f"is in {unit}; a joint's state must be in m or rad")
    slides = spec.get("slides", AXIS.get(unit) == LINEAR)
    if force := spec.get("force", ""):
        named(f"{key}.force", force, model.inputs)
        if not at_once[force][list(model.states).index(speed)] > 0.0:
            raise UserError(f"{key}.force", force, f"does not push {speed} forward at once: no force on this joint")
    return {"position": position, "speed": speed, "force": force or "", "slides": bool(slides)}


def _unit(variable: Any) -> str:
    """The unit of a variable, its own or its type's."""
    return str(variable.unit or (variable.declaredType.unit if variable.declaredType else "") or "")


def _short(state: str) -> str:
    """A joint's name from that of its position: ``arm.elbow.phi`` is arm_elbow."""
    return re.sub(r"\W+", "_", re.sub(r"\.(q|s|phi|x|position|angle)$", "", state)).strip("_")


def new_rig(path: str) -> str:
    """The text of a rig's file for an FMU: its pairs of states as joints, its inputs, usual tolerances."""
    model = model_of(replace(RigConfig(), model=path))
    found, at_once, order = pairs(model), effects_of_inputs(model, {}), list(model.states)
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
    lines = [f"model: {Path(path).name}", "", "# the column of the log: the input of the FMU that it is", "commands:"]
    lines += [f"  u_{_short(name)}: {name}" for name in told] or ["  # the FMU has no real input"]
    lines += ["", "# position and speed: states, of which one is the other's derivative; force: the input through",
              "# which a force acts on it, positive along its motion; without one no friction is looked for there",
              "joints:"]  # fmt: skip
    for position, speed in found.items():
        force = f", force: {forces[position]}" if forces[position] else ""
        lines.append(f"  {_short(position)}: {{position: {position}, speed: {speed}{force}}}")
    lines += ["", "# the column of the log: what it shows. quantity: position, velocity, acceleration of a joint;",
              "# value of any variable of the FMU; recorded_in: deg, say; absolute: it is 0 where the FMU's state is",
              "sensors:"]  # fmt: skip
    for position in found:
        unit = _unit(model.variables[position]) or "rad"
        lines.append(
            f"  q_{_short(position)}: {{of: {_short(position)}, quantity: position, absolute: true}}  # {unit}"
        )
    lines += ["", "# how far parameters of the FMU may be off, one standard deviation", "tolerances:"]
    known = {n: v for n, v in model.parameters.items() if float(v.start) and math.isfinite(float(v.start))}
    lines += [f"  {name}: {USUAL}" for name in list(known)[:LISTED]]
    return "\n".join([*lines, ""])


def start_values(config: RigConfig) -> str:
    """The parameters of a rig's FMU as they were found, a YAML text: name -> start value."""
    return yaml.safe_dump({name: float(p.value) for name, p in config.parameters.items()}, sort_keys=False)
