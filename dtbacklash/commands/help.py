"""``dtb <command> --help``, made from grammars and schemas; loads neither Hydra nor numpy."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from dtbacklash.config import benchmark, twin
from dtbacklash.config.grammar import COMMON, EXPORT, FILES, GRAMMARS, HELP, Grammar
from dtbacklash.config.groups import GROUPS, LAUNCHERS, MACHINES, options
from dtbacklash.config.setting import Declared, declared

WIDTH, COLUMN = 116, 36
#: the commands that have parts, each with settings of its own; what is said of them, and an example below
PARTED = {"twin": twin.PARTS, "benchmark": benchmark.PARTS}
ABOUT = {
    "twin": ("The digital twin as a process of its own, over MQTT 5.", ("In three terminals:", *twin.EXAMPLE)),
    "benchmark": (
        "Which physics is missing, where, and how much of it: a benchmark that any tool can enter.",
        ("Example:", "dtb benchmark make out=bench", "dtb benchmark score answers bench key=bench.key"),
    ),
}


def of_command(name: str, words: Sequence[str]) -> str:
    """The help of the command ``name``; ``words`` : what stands behind it, of which one may name a part."""
    if name in HELP:
        return HELP[name].format(machines=", ".join(MACHINES)) if name == "rig" else HELP[name]
    if name in PARTED:
        return of_part(name, words[0]) if words[0] in PARTED[name] else _parted(name)
    if name == EXPORT.name and words[:1] == ["controller"]:
        return HELP["controller"]
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


def _parted(name: str) -> str:
    about, example = ABOUT[name]
    lines = [f"usage: dtb {name} <part> [key=value ...]", "", about, ""]
    lines += [f"  {part:<10} {one.about.splitlines()[0]}" for part, one in PARTED[name].items()]
    lines += ["", f"dtb {name} <part> --help lists its settings. {example[0]}", *(f"  {line}" for line in example[1:])]
    return "\n".join(lines)


def of_part(name: str, part: str) -> str:
    """The text of ``dtb twin <part> --help``, and of the other commands that have parts."""
    one = PARTED[name][part]
    settings = ["", "settings (key=default) [unit]:", *_settings(declared(one.schema))] if one.schema else []
    return "\n".join([f"usage: dtb {name} {part} [key=value ...]", "", one.about, *settings])


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
