"""The commands that are Hydra applications: what each is called, what can be chosen, how a person writes it.

A command's name is also that of its primary config in ``conf`` and of its jobs (``hydra.job.name``). Light: a help text
needs nothing else. The texts stand in ``commands.toml``.
"""

from __future__ import annotations

import importlib
import tomllib
import typing
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dtbacklash.config.groups import RIGS
from dtbacklash.config.setting import OUTPUT, Declared, Setting, declared

#: mappings with free keys: Hydra wants `++` to add to them, which nobody should have to know
OPEN_PARTS = ("effects", "laws", "parameters", "elements", "sensors")
OPEN_MAPPINGS = tuple(f"{group}.{part}." for group in RIGS for part in OPEN_PARTS)
#: settings of Hydra that are paths, and the word for both
RUN_FOLDER, SWEEP_FOLDER, FOLDER_WORD = "hydra.run.dir", "hydra.sweep.dir", "out"
JOBS_KEY = "hydra.launcher.n_jobs"
VERBOSE = ("-v", "--verbose")
#: in open loop the reference is the command: these are volts, and stand for the same ending in ``_mm``
OPEN_LOOP = tuple(f"reference.{name}_v" for name in ("amplitude", "offset", "step", "rms"))


@dataclass(frozen=True)
class Grammar:
    """One command: its ``schema`` as ``module:class``, the ``groups`` of ``conf`` that it takes, and its help.

    in_open_loop : whether the reference is the rig's command unless a controller is chosen.
    beside : settings that are none of the schema's.
    """

    name: str
    schema_path: str
    groups: Sequence[str]
    summary: str
    about: str
    folder: str
    examples: Sequence[str]
    after: str = ""
    in_open_loop: bool = False
    beside: Sequence[str] = ()

    @cached_property
    def schema(self) -> type:
        """The dataclass that its configuration becomes."""
        module, _, name = self.schema_path.partition(":")
        found = getattr(importlib.import_module(module), name)
        assert isinstance(found, type)
        return found

    @cached_property
    def settings(self) -> dict[str, Declared]:
        """Dotted key -> setting."""
        return {one.key: one for one in declared(self.schema)}

    @cached_property
    def words(self) -> dict[str, str]:
        """Short word -> dotted key."""
        return {one.about.word: key for key, one in self.settings.items() if one.about.word}

    @cached_property
    def flags(self) -> dict[str, str]:
        """Option -> the override that it stands for."""
        return {one.about.flag: f"{key}=true" for key, one in self.settings.items() if one.about.flag}

    @cached_property
    def open_mappings(self) -> tuple[str, ...]:
        """Prefixes below which keys are free."""
        own = [f"{key}." for key, one in self.settings.items() if one.is_mapping]
        return (*OPEN_MAPPINGS, *(prefix for prefix in own if prefix not in OPEN_MAPPINGS))

    def path_kind(self, key: str) -> str:
        """Whether the value of ``key`` is a path, and of which kind: see :attr:`.Setting.path`."""
        if key in (RUN_FOLDER, SWEEP_FOLDER):
            return OUTPUT
        return self.settings[key].about.path if key in self.settings else ""

    def known_keys(self) -> list[str]:
        """Everything that may be set, as a person writes it."""
        own = [*(one.word for one in self.settings.values()), *self.beside]
        return own if self.one_file else [*own, FOLDER_WORD, RUN_FOLDER, SWEEP_FOLDER, JOBS_KEY]

    @property
    def one_file(self) -> bool:
        """Whether ``out=`` is its own setting and names a file: there is no folder, and nothing to sweep."""
        return FOLDER_WORD in self.settings


#: what every command takes beside its own settings
COMMON = {
    "out=FOLDER": Setting("where the results go; short for hydra.run.dir, with -m for hydra.sweep.dir"),
    "hydra.launcher.n_jobs=-1": Setting("jobs of a sweep at a time (-1: one a core)"),
    "-v": Setting("say what it is doing"),
    "--cfg job": Setting("show the configuration, run nothing"),
}

#: command -> its entry in ``commands.toml``; the help of the others stands there as well
_SAID: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
HELP: dict[str, str] = _SAID.pop("help")
_ALL = {name: Grammar(name, **said) for name, said in _SAID.items()}
RUN, EXPORT = _ALL["run"], _ALL["export"]

#: the applications of Hydra: a folder of results, sweeps
GRAMMARS = {name: one for name, one in _ALL.items() if name != EXPORT.name}
#: what is composed as these are, and writes one file
FILES = {EXPORT.name: EXPORT}


def grammar_of(schema: type) -> Grammar:
    """The command whose configuration is a ``schema``."""
    return next(one for one in _ALL.values() if one.schema is schema)


def kind_of(key: str, grammar: Grammar = RUN) -> str:
    """Say in words what type the setting ``key`` has."""
    words = {float: "a number", int: "a whole number", bool: "true or false", str: "a text", dict: "a mapping"}
    if key in grammar.settings and typing.get_origin(grammar.settings[key].plain_kind) is list:
        choices = ", ".join(grammar.settings[key].about.choices)
        (item,) = typing.get_args(grammar.settings[key].plain_kind)
        example = grammar.settings[key].shown()
        items = choices or {int: "whole numbers", float: "numbers"}.get(item, "texts")
        return f"a list of {items}" + ("" if example in ("null", "[]") else f", e.g. {example}")
    if key in grammar.settings:
        kind = grammar.settings[key].plain_kind
        return words.get(typing.get_origin(kind) or kind, "a value of another kind")
    numbers = key.startswith(("sensors.", *(f"{group}.parameters." for group in RIGS)))
    return "a number" if numbers else "a value of another kind"


def unknown_key(key: str, grammar: Grammar = RUN) -> str:
    """Say that ``key`` is no setting of a command, and which one may be meant."""
    import difflib

    known = grammar.known_keys()
    groups = {name.split(".")[0] for name in known if not name.startswith("hydra.")}
    near = difflib.get_close_matches(key, [*known, *groups], n=1, cutoff=0.6)
    near = near or [name for name in known if name.split(".")[-1] == key.rsplit(".", maxsplit=1)[-1]][:1]
    if near:
        return f"no such setting; did you mean {near[0]}?"
    if key.startswith("hydra."):
        return f"no such setting; dtb {grammar.name} --cfg hydra lists them"
    section = key.split(".", maxsplit=1)[0] + "."
    inside = [name for name in known if name.startswith(section)]
    return "no such setting; choose one of " + ", ".join(inside or sorted(groups))
