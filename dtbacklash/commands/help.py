"""``dtb <command> --help``, made from grammars and schemas; loads neither Hydra nor numpy."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from dtbacklash.config.grammar import COMMON, EXPORT, FILES, GRAMMARS, Grammar
from dtbacklash.config.groups import GROUPS, LAUNCHERS, MACHINES, options
from dtbacklash.config.setting import Declared, declared
from dtbacklash.config.twin import EXAMPLE, PARTS

WIDTH, COLUMN = 116, 36
RECORDINGS = """\
usage: dtb recordings
       dtb recordings fetch NAME [FILE]

Lists the recordings that have a mapping (conf/recording/*.yaml): what they are, where they were found, how
to cite them. fetch downloads the files of one of them from their public source and compares their SHA-256.

A recording is looked for in the folder $DTB_RECORDINGS (also in its subfolder NAME), then in the download
cache."""

RIG = """\
usage: dtb rig new MACHINE FILE.yaml
       dtb rig check NAME|FILE.yaml [rig.KEY=VALUE ...] [out=FOLDER]

new writes a commented rig that runs, to be changed: {machines}.
check draws it (NAME_rig.png, here or in FOLDER) and lists its elements, parameters in SI, modes, the columns of a
recording, and what a diagnosis can name where."""


CONTROLLER = """usage: dtb export controller [out=FILE.c|FILE.fmu] [fmi=2|3] [group=option ...] [key=value ...]

Writes the designed controller as C99 without dependencies: its matrices, the play, the prefilter, and one function,
controller_step(&c, r, y), which does to the last digits but rounding what the controller of dtb run does. The gap in
force is a field that a twin may set. A file that ends in .fmu is the same, compiled for co-simulation (FMI 2.0, or 3.0
with fmi=3), with its source inside. The settings are those of dtb run (dtb run --help).

examples:
  dtb export controller out=controller.c
  dtb export controller out=controller.fmu fmi=3 model=found/rig.yaml
  dtb export controller controller=lqg controller.limit_v=12"""

EFFECTS = """\
usage: dtb effects [NAME] [rig=RIG]

Lists the physics that a rig may have beside its linear model: by kind of element its effects, each with its law and its
parameters [SI]; with rig= only what that rig takes, with the places. NAME shows one effect in detail.

Laws of one's own are listed as well: those of conf/effect/*.yaml here, of the rig's file, and of installed packages.

examples:
  dtb effects
  dtb effects coulomb_friction
  dtb effects rig=lead_screw"""


def of_command(name: str, words: Sequence[str]) -> str:
    """The help of the command ``name``; ``words`` : what stands behind it, of which one may name a part."""
    if name == "recordings":
        return RECORDINGS
    if name == "rig":
        return RIG.format(machines=", ".join(MACHINES))
    if name == "effects":
        return EFFECTS
    if name == "twin":
        return of_the_twin(words[0]) if words[0] in PARTS else _twin()
    if name == EXPORT.name and words[:1] == ["controller"]:
        return CONTROLLER
    return text((GRAMMARS | FILES)[name])


def text(grammar: Grammar) -> str:
    """The help of a command, with the options of the packaged ``conf`` and of a ``conf`` folder here."""
    program = "dtb export fmu" if grammar is EXPORT else f"dtb {grammar.name} [-m]"
    usage = ["usage:", program, *(["[group=option ...]"] if grammar.groups else []), "[key=value ...]"]
    parts = [" ".join([*usage, *([] if grammar.one_file else ["[-v]"]), *(f"[{flag}]" for flag in grammar.flags)])]
    parts += ["", grammar.about]
    if not grammar.one_file:
        parts += [
            "-m sweeps: every combination of the comma-separated choices, one table at the end; started again, it does",
            "only what is missing.",
        ]
    if grammar.groups:
        parts += ["", "choices (group=option):", *_choices(grammar)]
    parts += ["", "settings (key=default) [unit]:"]
    parts += _settings(one for one in grammar.settings.values() if not one.key.startswith("rig."))
    if "rig" in grammar.groups:
        parts += _row("rig.parameters.NAME.value=VALUE", "a parameter of the rig [SI]")
        parts += _row("rig.effects.ELEMENT.EFFECT.PARAMETER=VALUE", "a physical effect [SI]")
    if not grammar.one_file:
        for word, about in COMMON.items():
            default = f" (default {grammar.folder})" if word.startswith("out=") else ""
            parts += _row(word, about.meaning + default)
    parts += ["", *([grammar.after] if grammar.after else []), "examples:"]
    parts += [f"  {example}" for example in grammar.examples]
    if grammar.groups:
        parts += ["", "A folder `conf` in the current directory extends the choices: conf/rig/mine.yaml is rig=mine."]
    return "\n".join(parts)


def _twin() -> str:
    lines = ["usage: dtb twin <part> [key=value ...]", "", "The digital twin as a process of its own, over MQTT 5.", ""]
    lines += [f"  {name:<10} {part.about.splitlines()[0]}" for name, part in PARTS.items()]
    lines += ["", "dtb twin <part> --help lists its settings. In three terminals:", *(f"  {line}" for line in EXAMPLE)]
    return "\n".join(lines)


def of_the_twin(name: str) -> str:
    """The text of ``dtb twin <part> --help``."""
    part = PARTS[name]
    settings = ["", "settings (key=default) [unit]:", *_settings(declared(part.schema))] if part.schema else []
    return "\n".join([f"usage: dtb twin {name} [key=value ...]", "", part.about, *settings])


def _choices(grammar: Grammar) -> list[str]:
    chosen = {group: ", ".join(options(group)) for group in grammar.groups}
    if not grammar.one_file:
        chosen["hydra/launcher"] = LAUNCHERS
    lines = []
    for group, names in chosen.items():
        lines.append(f"  {group:<15} {GROUPS[group]}")
        lines += textwrap.wrap(names, WIDTH, initial_indent=" " * 20, subsequent_indent=" " * 20)
    return lines


def _settings(settings: Iterable[Declared]) -> list[str]:
    """A row a setting: the word and its default, the meaning, the unit, the choices."""
    lines: list[str] = []
    for one in settings:
        word = f"{one.about.flag} ({one.key}=true)" if one.about.flag else f"{one.word}={one.shown()}"
        unit = f" [{one.unit}]" if one.unit else ""
        choices = f" ({one.allowed()})" if one.about.choices else ""
        lines += _row(word, one.about.meaning + unit + choices)
    return lines


def _row(head: str, meaning: str) -> list[str]:
    """Head and meaning in two columns; a long head has a line of its own."""
    indent = " " * COLUMN
    lines = textwrap.wrap(meaning, WIDTH, initial_indent=indent, subsequent_indent=indent)
    first = f"  {head}"
    return [first, *lines] if len(first) >= COLUMN else [f"{first:<{COLUMN}}{lines[0].lstrip()}", *lines[1:]]
