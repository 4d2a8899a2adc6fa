"""``dtb <command> --help``, made from grammars and schemas; loads neither Hydra nor numpy."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from dtbacklash.config.grammar import COMMON, EXPORT, FILES, GRAMMARS, HELP, Grammar
from dtbacklash.config.groups import GROUPS, LAUNCHERS, MACHINES, options
from dtbacklash.config.setting import Declared, declared
from dtbacklash.config.twin import EXAMPLE, PARTS

WIDTH, COLUMN = 116, 36


def of_command(name: str, words: Sequence[str]) -> str:
    """The help of the command ``name``; ``words`` : what stands behind it, of which one may name a part."""
    if name in HELP:
        return HELP[name].format(machines=", ".join(MACHINES)) if name == "rig" else HELP[name]
    if name == "twin":
        return of_the_twin(words[0]) if words[0] in PARTS else _twin()
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
