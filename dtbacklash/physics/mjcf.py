"""A MuJoCo model as a rig: its joints and actuators are elements, and what is uncertain in it are parameters.

A rig's file that names a model says which columns are commands of which actuators, what its sensors show, and which of
the model's numbers may be off by how much; all else stays in the model. MuJoCo is imported where a model is read.
"""

from __future__ import annotations

import difflib
import functools
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from dtbacklash.config.rig import ParameterConfig, RigConfig, share_of
from dtbacklash.errors import UserError
from dtbacklash.physics.element_kinds import LINEAR, ROTARY

if TYPE_CHECKING:
    import mujoco

#: what precedes an actuator's name where it is a place, as it may have that of its joint
ACTUATOR_PREFIX = "actuator_"
#: and the name of a joint that is the gap behind another one
PLAY_PREFIX = "play_"
#: the kinds of a model's joints, by their axes
KIND = {ROTARY: "turning_joint", LINEAR: "sliding_joint"}
#: group -> number of one of it -> its unit: of what turns, and of what slides
NUMBERS: dict[str, dict[str, tuple[str, str]]] = {
    "joints": {
        "damping": ("N m s/rad", "N s/m"), "armature": ("kg m^2", "kg"), "stiffness": ("N m/rad", "N/m"),
        "frictionloss": ("N m", "N"),
    },
    "bodies": {"mass": ("kg", "kg")},
    "actuators": {"gain": ("1", "1")},
}  # fmt: skip
#: how hard a dry friction holds, in MuJoCo's words: its impedance near 1, its time constant in steps
FRICTION_IMPEDANCE, FRICTION_STEPS = 0.999, 2.0
#: what ``dtb rig new mjcf`` writes where a model's number is not 0 (share); masses come from a drawing
USUAL = {"damping": 0.3, "armature": 0.2, "stiffness": 0.2, "frictionloss": 0.3, "mass": 0.05}


def _mujoco(path: str) -> Any:
    try:
        import mujoco
    except ImportError:
        raise UserError("rig.model", path, "needs MuJoCo: pip install 'dtbacklash[mujoco]'") from None
    return mujoco


def specification(path: str, fixed: Iterable[str] = ()) -> mujoco.MjSpec:
    """A model's description, each joint and actuator with a name; without the joints that are ``fixed``.

    Raises
    ------
    UserError : with the key ``rig.model`` or ``rig.fixed``: no such file, no MJCF, no such joint; MuJoCo is missing.
    """
    if not Path(path).is_file():
        raise UserError("rig.model", path, "no such file; a path from the rig's file on")
    mj = _mujoco(path)
    try:
        spec = mj.MjSpec.from_file(path)
    except ValueError as error:
        raise UserError("rig.model", path, f"is no MJCF: {' '.join(str(error).split())}") from error
    for k, joint in enumerate(spec.joints):
        joint.name = joint.name or f"joint_{k}"
    for k, actuator in enumerate(spec.actuators):
        actuator.name = actuator.name or actuator.target or f"actuator_{k}"
    for name in fixed:
        spec.delete(named("rig.fixed", name, {j.name: j for j in spec.joints}))
    return spec


@functools.lru_cache(maxsize=16)
def _read(path: str, fixed: tuple[str, ...], plays: tuple[str, ...], stamp: int) -> mujoco.MjModel:
    spec = specification(path, fixed)
    for name in plays:
        _add_play(spec, name, 1.0)
    return _compiled(spec, path)


def _add_play(spec: Any, name: str, width: float) -> None:
    """A joint behind a joint of the same axis, which goes so far: the actuator turns the first one's armature."""
    first = next(j for j in spec.joints if j.name == name)
    play = first.parent.add_joint(name=PLAY_PREFIX + name, type=first.type, axis=first.axis, pos=first.pos)
    for number in ("damping", "armature", "stiffness", "frictionloss", "ref", "springref", "margin"):
        _set_first(play, number, 0.0)  # a default of the model's joints is none of a gap
    degrees = spec.compiler.degree and first.type == _mujoco("").mjtJoint.mjJNT_HINGE
    half = 0.5 * (math.degrees(width) if degrees else width)
    play.limited, play.range = True, (-half, half)
    play.solref_limit, play.solimp_limit[:2] = (FRICTION_STEPS * spec.option.timestep, 1.0), FRICTION_IMPEDANCE


def _compiled(spec: Any, path: str) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise UserError("rig.model", path, f"is no MJCF: {' '.join(str(error).split())}") from error


def model_of(config: RigConfig, plays: tuple[str, ...] = ()) -> mujoco.MjModel:
    """A rig's model as its file has it, to be copied and not to be changed (raises UserError as above).

    plays : joints that have a second one behind them, ``play_NAME``, for a gap.
    """
    file = Path(config.model)
    return _read(config.model, tuple(config.fixed), plays, file.stat().st_mtime_ns if file.is_file() else 0)


def geared(config: RigConfig) -> list[str]:
    """Joints with an armature that an actuator of the rig turns, the last ones of their bodies: where a gap may be."""
    model = model_of(config)
    driven = [int(model.actuator_trnid[a, 0]) for a in range(model.nu)]
    return [
        model.joint(j).name for j in dict.fromkeys(driven)
        if model.dof_armature[model.jnt_dofadr[j]] > 0.0
        and j == model.body_jntadr[b := model.jnt_bodyid[j]] + model.body_jntnum[b] - 1
    ]  # fmt: skip


def completed(config: RigConfig) -> RigConfig:
    """The description of a rig whose file names a model, with the model's joints, actuators and uncertain numbers.

    Raises
    ------
    UserError : a name that the model has not; a joint that neither turns nor slides; an actuator without a command, or
        one that has states of its own.
    """
    if config.joints:
        raise UserError("rig.joints", ", ".join(config.joints), "are of an FMU; an MJCF names its joints itself")
    mj, model = _mujoco(config.model), model_of(config)
    axes = {mj.mjtJoint.mjJNT_HINGE: ROTARY, mj.mjtJoint.mjJNT_SLIDE: LINEAR}
    joints: dict[str, str] = {}
    for j in range(model.njnt):
        name, kind = model.joint(j).name, mj.mjtJoint(model.jnt_type[j])
        if kind not in axes:
            allowed = "neither turns nor slides, and no sensor shows it: fix it (fixed: [NAME]), or give it hinges"
            raise UserError("rig.model", f"joint {name}", allowed)
        joints[name] = axes[kind]
    elements = {name: {"kind": KIND[axis]} for name, axis in joints.items()}
    drives = {model.actuator(a).name: a for a in range(model.nu)}
    for column, name in config.commands.items():
        a = named(f"rig.commands.{column}", name, drives)
        if model.actuator_trntype[a] != mj.mjtTrn.mjTRN_JOINT or model.na:
            raise UserError(f"rig.commands.{column}", name, "must be an actuator at a joint, without states of its own")
        driven = model.joint(int(model.actuator_trnid[a, 0])).name
        elements[ACTUATOR_PREFIX + str(name)] = {"kind": "joint_drive", "drives": driven}
    check_columns(config)
    idle = [name for name in drives if name not in config.commands.values()]
    if idle or not config.commands:
        raise UserError("rig.commands", ", ".join(idle) or "(none)", "every actuator of the model has a column: "
                        f"{{COLUMN: {idle[0] if idle else 'ACTUATOR'}}}")  # fmt: skip
    parameters = {title: _parameter(model, joints, title, share) for title, share in config.tolerances.items()}
    name = config.name if config.name != RigConfig.name else Path(config.model).stem
    return replace(config, name=name, elements=elements, parameters=parameters)


def check_columns(config: RigConfig) -> None:
    """Refuse an actuator that two columns command, and a command whose column is something else."""
    told = list(config.commands.values())
    twice = [name for name in told if told.count(name) > 1]
    if twice:
        raise UserError("rig.commands", twice[0], "is commanded by two columns; each actuator has one")
    for both in sorted({*config.commands} & {*config.sensors, "t"}):
        raise UserError(
            f"rig.commands.{both}", config.commands[both], "is no command: the column is a sensor or the time"
        )


def _parameter(model: mujoco.MjModel, joints: Mapping[str, str], title: str, share: object) -> ParameterConfig:
    key = f"rig.tolerances.{title}"
    group, name, number = _parts(title)
    if number not in NUMBERS.get(group, {}):
        known = ", ".join(f"{g}.NAME.{n}" for g, numbers in NUMBERS.items() for n in numbers)
        raise UserError(key, title, f"no number of a model; choose one of {known}")
    there = {"joints": list(joints), "bodies": [model.body(b).name for b in range(1, model.nbody)],
             "actuators": [model.actuator(a).name for a in range(model.nu)]}[group]  # fmt: skip
    named(key, name, dict.fromkeys(there))
    turns = group != "joints" or joints[name] == ROTARY
    unit = NUMBERS[group][number][0 if turns else 1]
    return ParameterConfig(number_of(model, title), unit, share_of(key, share), f"{number} of {name}")


def _parts(title: str) -> tuple[str, str, str]:
    """Group, owner and number of a title, ``joints.elbow.damping``; an owner's name may have dots."""
    group, _, rest = title.partition(".")
    name, _, number = rest.rpartition(".")
    return group, name, number


def number_of(model: mujoco.MjModel, title: str) -> float:
    """A number of a model by its title, ``joints.elbow.damping``; SI."""
    array, at = _place(model, title)
    return float(array[at])


def set_number(model: mujoco.MjModel, title: str, value: float) -> None:
    """Change one in a compiled model; after a mass, ``mj_setConst`` has to be called."""
    array, at = _place(model, title)
    ratio = value / array[at] if array[at] else 1.0
    array[at] = value
    if title.startswith("bodies."):
        model.body_inertia[at] *= ratio
    if title.startswith("actuators."):  # a servo takes back what it is told by the same gain
        model.actuator_biasprm[at[0]] *= ratio


def _place(model: mujoco.MjModel, title: str) -> tuple[Any, Any]:
    group, name, number = _parts(title)
    if group == "joints":
        j = model.joint(name).id
        stiff = number == "stiffness"
        return (model.jnt_stiffness, j) if stiff else (getattr(model, f"dof_{number}"), model.jnt_dofadr[j])
    if group == "bodies":
        return model.body_mass, model.body(name).id
    return model.actuator_gainprm, (model.actuator(name).id, 0)


def named(key: str, name: object, there: Mapping[str, Any]) -> Any:
    """What has this name in the model."""
    if isinstance(name, str) and name in there:
        return there[name]
    near = difflib.get_close_matches(str(name), there, n=1)
    meant = f"; did you mean {near[0]}" if near else ""
    raise UserError(key, name, f"the model has no such name{meant}; it has {', '.join(there) or 'none'}")


def new_rig(model: str) -> str:
    """The text of a rig's file for a model: columns by the names of its actuators and sensors, usual tolerances.

    A model without sensors of joints has a column for each joint. Joints that neither turn nor slide are fixed there.

    Raises
    ------
    UserError : no such file, no MJCF; it has no actuator, or no joint that turns or slides; as :func:`completed`.
    """
    mj = _mujoco(model)
    kinds = {j.name: j.type for j in specification(model).joints}
    fixed = [name for name, kind in kinds.items() if kind not in (mj.mjtJoint.mjJNT_HINGE, mj.mjtJoint.mjJNT_SLIDE)]
    spec = specification(model, fixed)
    compiled = _compiled(spec, model)
    if not spec.actuators or len(fixed) == len(kinds):
        raise UserError("rig.model", model, "has no actuator that moves a joint")
    slides = {name: kind == mj.mjtJoint.mjJNT_SLIDE for name, kind in kinds.items() if name not in fixed}
    lines = [
        f"model: {Path(model).name}",
        "",
        "# the column of the log: the actuator of the model that it commands",
        "commands:",
    ]
    shown = _sensors(mj, spec, slides)
    lines += [f"  {_written(column)}: {_written(name)}" for column, name in _commands(spec, shown).items()]
    lines += ["", "# the column of the log: what it shows. quantity: position, velocity, acceleration of a joint, or",
              "# torque, force of actuator_NAME; recorded_in: deg, say; absolute: it is 0 where the model's joint is",
              "sensors:"]  # fmt: skip
    lines += [f"  {_written(column)}: {said}" for column, said in shown.items()]
    if fixed:
        lines += ["", "# joints that neither turn nor slide: taken out, they never move"]
        lines += [f"fixed: [{', '.join(map(_written, fixed))}]"]
    lines += ["", "# how far the model's numbers may be off, one standard deviation", "tolerances:"]
    for group, owners in (("joints", spec.joints), ("bodies", spec.bodies)):
        for name in (o.name for o in owners if o.name and o.name != "world"):
            for number in NUMBERS[group]:
                title = f"{group}.{name}.{number}"
                if number_of(compiled, title):
                    lines.append(f"  {_written(title)}: {100 * USUAL[number]:.3g} %")
    lines[-1] += " {}" if lines[-1] == "tolerances:" else ""
    text = "\n".join([*lines, ""])
    completed(RigConfig(**{**yaml.safe_load(text), "model": model}))
    return text


def _sensors(mj: Any, spec: Any, slides: Mapping[str, bool]) -> dict[str, str]:
    """Column -> what it shows, as YAML: the model's own sensors of joints and actuators, or else each joint.

    slides : joint -> whether it slides and does not turn.
    """
    drives = {a.name: a.target for a in spec.actuators if a.target in slides}
    found = {}
    for sensor in spec.sensors:
        kind, of = sensor.type, sensor.objname
        if kind == mj.mjtSensor.mjSENS_ACTUATORFRC and of in drives:
            quantity, unit = ("force", "N") if slides[drives[of]] else ("torque", "N m")
            found[sensor.name or of] = f"{{of: {_written(ACTUATOR_PREFIX + of)}, quantity: {quantity}}}  # {unit}"
        elif kind == mj.mjtSensor.mjSENS_JOINTVEL and of in slides:
            unit = "m/s" if slides[of] else "rad/s"
            found[sensor.name or f"v_{of}"] = f"{{of: {_written(of)}, quantity: velocity}}  # {unit}"
        elif kind == mj.mjtSensor.mjSENS_JOINTPOS and of in slides:
            found[sensor.name or of] = _position(of, slides[of])
    return found or {name: _position(name, slide) for name, slide in slides.items()}


def _position(name: str, slides: bool) -> str:
    return f"{{of: {_written(name)}, quantity: position, absolute: true}}  # {'m' if slides else 'rad'}"


def _commands(spec: Any, columns: Iterable[str]) -> dict[str, str]:
    """Column -> the actuator that it commands: the actuator's name, unless a sensor's column has it."""
    return {f"u_{a.name}" if a.name in columns else a.name: a.name for a in spec.actuators}


def _written(name: str) -> str:
    """A name as YAML takes it."""
    plain = re.fullmatch(r"\w[\w./-]*", name) and yaml.safe_load(name) == name
    return name if plain else json.dumps(name, ensure_ascii=False)


def mended(
    config: RigConfig, frictions: Mapping[str, float], dampings: Mapping[str, float], plays: Mapping[str, float]
) -> str:
    """The MJCF of a rig's model with the rig's parameters, and with what was found at its joints.

    frictions, dampings, plays : joint -> its dry friction, its damping beside the model's, its lost motion, SI.
    """
    spec, model = specification(config.model), model_of(config)
    joints, bodies, drives = ({one.name: one for one in there} for there in (spec.joints, spec.bodies, spec.actuators))
    for title, parameter in config.parameters.items():
        group, name, number = _parts(title)
        ratio = parameter.value / was if (was := number_of(model, title)) else 1.0
        if group == "joints":
            _set_first(joints[name], number, parameter.value)
        elif group == "actuators":
            drives[name].gainprm *= ratio
            drives[name].biasprm *= ratio
        elif bodies[name].explicitinertial:
            bodies[name].mass *= ratio
            bodies[name].inertia *= ratio
            bodies[name].fullinertia *= ratio
        else:
            for geom in bodies[name].geoms:
                geom.mass *= ratio  # NaN, where its density counts, stays NaN
                geom.density *= ratio
    for name, more in dampings.items():
        _set_first(joints[name], "damping", float(_first(joints[name].damping)) + more)
    for name, more in frictions.items():
        joints[name].frictionloss += more
        joints[name].solref_friction = FRICTION_STEPS * spec.option.timestep, 1.0
        joints[name].solimp_friction[:2] = FRICTION_IMPEDANCE
    for name, width in plays.items():
        _add_play(spec, name, width)
    # what the model is made of stays where it is: the file is written elsewhere
    home = Path(config.model).resolve().parent
    spec.meshdir, spec.texturedir = str(home / spec.meshdir), str(home / spec.texturedir)
    spec.compile()
    return str(spec.to_xml())


def _first(values: Any) -> float:
    """A number, or the linear one of MuJoCo's polynomials."""
    return float(values if isinstance(values, float) else values[0])


def _set_first(joint: Any, number: str, value: float) -> None:
    there = getattr(joint, number)
    if isinstance(there, float):
        setattr(joint, number, value)
    else:
        there[0] = value


def steps_roughly(config: RigConfig) -> bool:
    """Whether a rig's model is stepped by a method of first order, unlike a machine."""
    method = _mujoco(config.model).mjtIntegrator.mjINT_RK4
    return bool(model_of(config).opt.integrator != method)


def steps_of(model: mujoco.MjModel, path: str, sample_time_s: float) -> int:
    """How many of the model's steps make a sample.

    Raises
    ------
    UserError : the step is no divisor of the sample.
    """
    count = round(sample_time_s / model.opt.timestep)
    if count < 1 or not math.isclose(count * model.opt.timestep, sample_time_s, rel_tol=1e-4):
        step, near = model.opt.timestep, sample_time_s / max(math.ceil(sample_time_s / model.opt.timestep), 1)
        allowed = f"its step, {step:.9g} s, must divide the sample, {sample_time_s:.9g} s: write "
        raise UserError("rig.model", path, allowed + f'timestep="{near:.9g}" into its <option>')
    return count
