"""``dtb rig``: a rig of one's own. ``new`` writes a file to begin with, ``check`` draws one and says what is in it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.commands.help import of_command
from dtbacklash.config.new_rigs import MACHINES, text
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.physics.rig import Rig

PARTS = ("new", "check")
#: of a plant that is only looked at, s
STEP_S = 1e-4


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
        raise UserError("argument", " ".join(words) or "(missing)", "write dtb rig new MACHINE FILE.yaml")
    machine, file = words
    if machine not in MACHINES:
        raise UserError("machine", machine, "choose one of " + ", ".join(MACHINES))
    target = Path(file).expanduser()
    if target.suffix not in (".yaml", ".yml"):
        raise UserError("file", file, "must end in .yaml")
    if target.exists():
        raise UserError("file", file, "is there already; give another name, or remove it first")
    from dtbacklash.files import write_text

    write_text(target.absolute(), text(machine, target.stem, file), "file", file)
    print(f"{file}: {MACHINES[machine][0]}; change its numbers, then dtb rig check {shlex.quote(file)}")


def check(words: Sequence[str]) -> list[str]:
    """Draw the rig that is named by the words ``NAME|FILE [rig.KEY=VALUE ...] [out=FOLDER]``; what is to be said of it.

    The drawing is ``NAME_rig.png`` in the folder, which is this one unless ``out`` says another.
    """
    out = [word for word in words if word.startswith("out=")]
    words = [word for word in words if word not in out]
    if not words:
        raise UserError("argument", "(missing)", "write dtb rig check FILE.yaml")
    if len(out) > 1:
        raise UserError("out", out[1].removeprefix("out="), "is given twice")
    from dtbacklash.diagnose.say.beforehand import beforehand
    from dtbacklash.face.rigs import load_rig
    from dtbacklash.report.diagnosis.rig_drawing import chain

    rig = load_rig(words[0], *words[1:])
    drawing = _drawn(rig, Path(words[0]).stem, "".join(out).removeprefix("out=") if out else ".")
    lines = [f"{rig.config.name}: {rig.config.description}", "  " + " - ".join(chain(rig)), "", "parameters (SI):"]
    for name, p in rig.config.parameters.items():
        users = [place for place, spec in rig.config.elements.items() if name in spec.values()]
        where = f"of {', '.join(users)}" if users else "used by no element"
        lines.append(f"  {name} = {p.value:.6g} {p.unit}".rstrip() + f" +/- {100 * p.tolerance:.3g} %, {where}")
    lines += ["", "modes:", *(f"  {mode}" for mode in modes(rig))]
    lines += ["", f"recorded columns: t [s], u [{rig.command_unit}], " + ", ".join(
        f"{s.name} [{s.recorded_in or s.unit}] ({s.quantity} of {s.of})" for s in rig.sensors.values())]  # fmt: skip
    lines += ["", "what a diagnosis can name, and where:"]
    lines += [f"  {place}: {', '.join(names)}" for place, names in nameable(rig).items()]
    for sentence in beforehand(rig):
        lines += ["", sentence]
    more = "" if rig.only("gear") else " controller=open_loop"
    return [*lines, "", f"drawn in {drawing}", "", f"dtb run {shlex.quote(f'rig={words[0]}')}{more}"]


def _drawn(rig: Rig, name: str, folder: str) -> str:
    """Draw a rig into a folder; the path of the PNG as it is to be shown."""
    from dtbacklash.commands.console import shown_path
    from dtbacklash.files import write_bytes
    from dtbacklash.report.diagnosis.rig_drawing import draw_rig
    from dtbacklash.report.kit.style import png

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
    poles = sorted(poles_of(compile_plant(plain_rig(rig), STEP_S)), key=abs)
    fastest, told, free = max(map(abs, poles), default=0.0), [], 0
    for pole in poles:
        size = abs(pole)
        if size <= 1e-6 * fastest:
            free += 1
        elif pole.imag > 1e-6 * size:
            told.append(f"{size / 6.283185307179586:.3g} Hz, damping {100 * -pole.real / size:.2g} %")
        elif abs(pole.imag) <= 1e-6 * size:
            told.append(f"time constant {1 / size:.3g} s")
    loose = ["free to drift: hold it by a loop, or record it briefly"] if free else []
    return [*loose, *told] or ["none: what is recorded follows the command at once"]


def nameable(rig: Rig) -> dict[str, list[str]]:
    """Place -> the effects that a diagnosis can name there."""
    found = {place: list(rig.takes(place)) for place in rig.places}
    return {place: names for place, names in found.items() if names}
