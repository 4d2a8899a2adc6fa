"""``dtb <command> --help``, made from the command's grammar and schema; loads neither Hydra nor numpy."""

from __future__ import annotations

import textwrap

from dtbacklash.config.grammar import COMMON, Grammar
from dtbacklash.config.groups import GROUPS, LAUNCHERS, options
from dtbacklash.config.setting import Declared

WIDTH, COLUMN = 116, 36


def text(grammar: Grammar) -> str:
    """The help of a command, with the options of the packaged ``conf`` and of a ``conf`` folder here."""
    flags = " ".join(f"[{flag}]" for flag in grammar.flags)
    usage = f"usage: dtb {grammar.name} [-m] {'[group=option ...] ' if grammar.groups else ''}[key=value ...] [-v]"
    parts = [f"{usage} {flags}".rstrip(), "", grammar.about]
    parts += [
        "-m sweeps: every combination of the comma-separated choices, one table at the end; started again, it does"
    ]
    parts += ["only what is missing.", ""]
    if grammar.groups:
        parts += ["choices (group=option):", *_choices(grammar), ""]
    parts += ["settings (key=default) [unit]:", *_settings(grammar)]
    parts += [line for word, about in COMMON.items() for line in _row(word, _meaning(grammar, word, about.meaning))]
    parts += ["", *([grammar.after] if grammar.after else []), "examples:"]
    parts += [f"  {example}" for example in grammar.examples]
    if grammar.groups:
        parts += ["", "A folder `conf` in the current directory extends the choices: conf/rig/mine.yaml is rig=mine."]
    return "\n".join(parts)


def plain_text(grammar: Grammar, program: str) -> str:
    """The help of a command that writes one file; ``program``: how a person calls it."""
    parts = [f"usage: {program} [group=option ...] [key=value ...]", "", grammar.about, ""]
    parts += ["choices (group=option):", *_choices(grammar, launchers=False), ""]
    parts += ["settings (key=default) [unit]:", *_settings(grammar), "", "examples:"]
    return "\n".join([*parts, *(f"  {example}" for example in grammar.examples)])


def _choices(grammar: Grammar, launchers: bool = True) -> list[str]:
    lines = []
    for group in (*grammar.groups, *(("hydra/launcher",) if launchers else ())):
        chosen = LAUNCHERS if group == "hydra/launcher" else ", ".join(options(group))
        lines.append(f"  {group:<15} {GROUPS[group]}")
        lines += [f"  {'':<17} {line}" for line in textwrap.wrap(chosen, WIDTH - 20)]
    return lines


def _settings(grammar: Grammar) -> list[str]:
    """A row a setting; the rig's, which is described by its file, in one."""
    lines: list[str] = []
    for one in grammar.settings.values():
        if one.key.startswith("rig."):
            continue
        unit = f" [{one.unit}]" if one.unit else ""
        allowed = one.allowed() if one.about.choices else ""
        lines += _row(_word(one), f"{one.about.meaning}{unit}" + (f" ({allowed})" if allowed else ""))
    if "rig" in grammar.groups:
        lines += _row("rig.parameters.NAME.value=VALUE", "a parameter of the rig [SI]")
        lines += _row("rig.effects.ELEMENT.EFFECT.PARAMETER=VALUE", "a physical effect [SI]")
    return lines


def _word(one: Declared) -> str:
    return f"{one.about.flag} ({one.key}=true)" if one.about.flag else f"{one.word}={one.shown()}"


def _meaning(grammar: Grammar, word: str, meaning: str) -> str:
    return f"{meaning} (default {grammar.folder})" if word.startswith("out=") else meaning


def _row(head: str, meaning: str) -> list[str]:
    """Head and meaning in two columns; a long head has a line of its own."""
    lines = textwrap.wrap(meaning, WIDTH - COLUMN) or [""]
    first = f"  {head}"
    if len(first) >= COLUMN:
        return [first, *(" " * COLUMN + line for line in lines)]
    return [f"{first:<{COLUMN}}{lines[0]}", *(" " * COLUMN + line for line in lines[1:])]
