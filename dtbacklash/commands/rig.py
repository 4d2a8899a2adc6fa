"""``dtb rig``: a rig of one's own. ``new`` writes a file to begin with, ``check`` draws one and says what is in it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.commands.help import of_command
from dtbacklash.config.groups import MACHINES, new_rig
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.physics.rig import Rig

PARTS = ("new", "check")
#: what stands for a machine where it is a simulator's model
MODELS = ("mjcf", "fmu")
#: of a plant that is only looked at, s
STEP_S = 1e-4
#: a parameter that is known no better says nothing (share)
TOLERANCE_USUAL = 1.0


def main(words: Sequence[str]) -> int:
    """Run ``dtb rig``; returns the exit code."""
    if not words:
        print(of_command("rig", ["--help"]))
        return 0
    part, *rest = words
    if part not in PARTS:
        raise UserError("rig", part, "choose one of " + ", ".join(PARTS))
    if part == "new":
        _new(rest)
    else:
        for line in check(rest):
            print(line)
    return 0


def _new(words: list[str]) -> None:
    if len(words) != 2:
        allowed = "write dtb rig new MACHINE FILE.yaml, or dtb rig new mjcf MODEL.xml, or fmu MODEL.fmu"
        raise UserError("argument", " ".join(words) or "(missing)", allowed)
    machine, file = words
    if machine not in (*MACHINES, *MODELS):
        raise UserError("machine", machine, "choose one of " + ", ".join((*MACHINES, *MODELS)))
    model = Path(file).expanduser()
    if machine in MODELS:
        if (machine == "fmu") != (model.suffix.lower() == ".fmu"):
            raise UserError("file", file, "an FMU ends in .fmu, and an MJCF does not")
        file = str(Path(file).with_suffix(".yaml"))
    target = Path(file).expanduser()
    if target.suffix not in (".yaml", ".yml"):
        raise UserError("file", file, "must end in .yaml")
    if target.exists():
        raise UserError("file", file, "is there already; give another name, or remove it first")
    from dtbacklash.files import write_text
    from dtbacklash.physics import fmus, mjcf

    if machine in MODELS:
        described = {"mjcf": mjcf, "fmu": fmus}[machine].new_rig(str(model))
        written, about = described, "joints, actuators and tolerances of the model"
    else:
        written = new_rig(machine, target.stem, file)
        about = written.partition("\n")[0].removeprefix("# ")
    write_text(target.absolute(), written, "file", file)
    print(f"{file}: {about}; change its numbers, then dtb rig check {shlex.quote(file)}")


def check(words: Sequence[str]) -> list[str]:
    """What is to be said of the rig that is named by the words ``NAME|FILE [rig.KEY=VALUE ...] [out=FOLDER]``.

    With ``out`` it is drawn as well, as ``NAME_rig.png`` in that folder.
    """
    out = [word for word in words if word.startswith("out=")]
    words = [word for word in words if word not in out]
    if not words:
        raise UserError("argument", "(missing)", "write dtb rig check FILE.yaml")
    if len(out) > 1:
        raise UserError("out", out[1].removeprefix("out="), "is given twice")
    from dtbacklash.api.rigs import load_rig
    from dtbacklash.diagnosis.explain.observability_notes import beforehand
    from dtbacklash.report.diagnosis.rig_drawing import chain

    rig = load_rig(words[0], *words[1:])
    if not rig.sensors:
        raise UserError("rig.sensors", "{}", "at least one, e.g. angle: {of: motor_rotor, quantity: position}")
    drawing = _drawn(rig, Path(words[0]).stem, out[0].removeprefix("out=")) if out else ""
    lines = [
        *(f"look at this: {doubt}" for doubt in doubts(rig)),
        f"{rig.config.name}: {rig.config.description}",
        "  " + " - ".join(chain(rig)),
        "",
        "parameters (SI):",
    ]
    for name, p in rig.config.parameters.items():
        users = [place for place, spec in rig.config.elements.items() if name in spec.values()]
        users = users or ([Path(rig.config.model).name] if rig.config.model else [])
        where = f"of {', '.join(users)}" if users else "used by no element"
        lines.append(f"  {name} = {p.value:.6g} {p.unit}".rstrip() + f" +/- {100 * p.tolerance:.3g} %, {where}")
    if not rig.config.model:
        lines += ["", "modes:", *(f"  {mode}" for mode in modes(rig))]
    told = [f"{c} ({a})" for c, a in rig.config.commands.items()] or [f"u [{rig.command_unit}]"]
    lines += ["", f"recorded columns: t [s], {', '.join(told)}, " + ", ".join(
        f"{s.name} [{s.recorded_in or s.unit}] ({s.quantity} of {s.of})" for s in rig.sensors.values())]  # fmt: skip
    lines += ["", "what a diagnosis can name, and where:"]
    lines += [f"  {place}: {', '.join(rig.takes(place))}" for place in rig.places if rig.takes(place)]
    for sentence in beforehand(rig):
        lines += ["", sentence]
    more = "" if rig.only("gear") else " controller=open_loop"
    drawn = ["", f"drawn in {drawing}"] if drawing else []
    use = f"dtb diagnose recording=LOG.csv {shlex.quote(f'rig={words[0]}')} out=found"
    return [*lines, *drawn, "", use if rig.config.model else f"dtb run {shlex.quote(f'rig={words[0]}')}{more}"]


def doubts(rig: Rig) -> list[str]:
    """What is allowed and hardly meant: elements that nothing reaches, tolerances that leave nothing known."""
    from dtbacklash.physics.element_kinds import GROUND
    from dtbacklash.report.diagnosis.rig_drawing import edges

    near: dict[str, set[str]] = {name: set() for name in rig.elements}
    for a, b in edges(rig):
        if GROUND not in (a, b):
            near[a].add(b)
            near[b].add(a)
    reached, waiting = set(), [next(iter(rig.elements))]  # the command enters at the first
    while waiting:
        name = waiting.pop()
        reached.add(name)
        waiting += near[name] - reached
    said = []
    for name in (name for name in rig.elements if name not in reached and not rig.config.model):
        watch = [s.name for s in rig.sensors.values() if s.of == name]
        seen = f", and {', '.join(watch)} shows nothing" if watch else ""
        said.append(f"rig.elements.{name} is connected to nothing that the command moves{seen}")
    for name, p in rig.config.parameters.items():
        if (share := p.tolerance) > TOLERANCE_USUAL:
            meant = f"as good as unknown; {share / 100:g} would be {share:g} %"
            said.append(f"rig.parameters.{name}.tolerance={share:g} is {100 * share:g} %: {meant}")
        if name not in rig.config.used:
            said.append(f"rig.parameters.{name} is used by no element")
    return said


def _drawn(rig: Rig, name: str, folder: str) -> str:
    """Draw a rig into a folder; the path of the PNG as it is to be shown."""
    from dtbacklash.commands.console import shown_path
    from dtbacklash.files import write_bytes
    from dtbacklash.report.components.style import png
    from dtbacklash.report.diagnosis.rig_drawing import draw_rig

    if not folder:
        raise UserError("out", "(empty)", "give a folder")
    target = Path(folder).expanduser().absolute() / f"{name}_rig.png"
    write_bytes(target, png(draw_rig(rig, {}, [])), "out", folder)
    return shown_path(target)


def modes(rig: Rig) -> list[str]:
    """The poles of the rig without its effects, slowest first, in words."""
    from dtbacklash.physics.assembly import compile_plant, poles_of
    from dtbacklash.recording.plausible import plain_rig

    compile_plant(rig, STEP_S)  # effects that do not go with the rig are refused
    plain, held = _with_gravity(rig, plain_rig(rig))
    poles = sorted(poles_of(compile_plant(plain, STEP_S)), key=abs)
    fastest, told, free = max(map(abs, poles), default=0.0), [], 0
    for pole in poles:
        size = abs(pole)
        if size <= 1e-6 * fastest:
            free += 1
        elif pole.imag > 1e-6 * size:
            told.append(f"{size / 6.283185307179586:.3g} Hz, damping {100 * max(0.0, -pole.real / size):.2g} %")
        elif abs(pole.imag) <= 1e-6 * size:
            told.append(f"time constant {1 / size:.3g} s")
    loose = ["free to drift: hold it by a loop, or record it briefly"] if free else []
    return [*held, *loose, *told] or ["none: what is recorded follows the command at once"]


def _with_gravity(rig: Rig, plain: Rig) -> tuple[Rig, list[str]]:
    """The rig without its effects, but with what gravity is to a mass that hangs: a spring; and that in words."""
    from dtbacklash.physics.effects.body import GRAVITY, lowest
    from dtbacklash.physics.element_kinds import GROUND
    from dtbacklash.physics.rig import build_rig

    config, said = plain.config, []
    for place, there in rig.effects.items():
        if GRAVITY.name in there and rig.kind_at(place) == GRAVITY.kind:
            torque, phase = (there[GRAVITY.name][p.name] for p in GRAVITY.parameters)
            spring = {"kind": "shaft", "between": [GROUND, place], "stiffness": f"{torque!r} N m/rad"}
            config = replace(config, elements={**config.elements, f"{GRAVITY.name}_{place}": spring})
            said.append(f"gravity holds {place} at {math.degrees(lowest(phase)) + 0.0:.0f}°, about which it swings:")
    return build_rig(config) if said else plain, said
