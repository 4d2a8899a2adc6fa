"""A command as an application of Hydra: from a person's words to its overrides, and the call."""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from hydra import version
from hydra._internal.hydra import Hydra
from hydra._internal.utils import create_automatic_config_search_path, get_args_parser
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from dtbacklash import files, units
from dtbacklash.config.commands import folder_name
from dtbacklash.config.grammar import (
    FILES,
    FOLDER_WORD,
    GRAMMARS,
    OPEN_LOOP,
    OPEN_MAPPINGS,
    RUN_FOLDER,
    SWEEP_FOLDER,
    VERBOSE,
    Grammar,
)
from dtbacklash.config.groups import LAUNCHER, NO_RECORDING, RIGS, SUFFIXES, options
from dtbacklash.config.rig import in_si
from dtbacklash.config.setting import INPUT
from dtbacklash.errors import UserError

VERSION_BASE = "1.3"
CONF = "pkg://dtbacklash.conf"
LOGGER = "dtbacklash"
MULTIRUN = ("-m", "--multirun")
FLAGS = {*MULTIRUN, "--resolve"}
VALUED = {"-c", "--cfg", "-p", "--package", "-i", "--info"}
#: what Hydra reads as it stands: names of options, paths without a sign that means something to it
_PLAIN = re.compile(r"[A-Za-z0-9_./-]+")
#: a number with its unit
_WITH_UNIT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)? +[^\d\s].*")
#: what Python refuses to read as a number
_HUGE = re.compile(r"\d{1000}")
#: a sweep by one of Hydra's functions
_FUNCTION = re.compile(r"(choice|glob|range|interval|shuffle|sort|tag)\(.*\)$")

#: part of a rig -> how something in it is chosen on the command line
OF_A_RIG = {
    "laws": "dahl_friction=packaged", "parameters": "k.value=9000",
    "effects": "motor_bearing.coulomb_friction.torque=0.02",
}  # fmt: skip

Task = Callable[[DictConfig], object]


class NoteFolders(Callback):
    """What Hydra calls around a run: notes which folders it is about to create, so that a failed run removes them."""

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        files.note_missing(Path(str(config.hydra.run.dir)))


def overrides(grammar: Grammar, words: Sequence[str]) -> list[str]:
    """The command line as Hydra reads it, with what it demands and a person would not write.

    Raises UserError: an unknown option, a word that is not ``key=value``, a setting taken away, or given twice.
    """
    sweeps = is_sweep(words)
    result: list[str] = []
    given: dict[str, str] = {}
    expects_value = False
    for word, following in zip(words, [*words[1:], ""], strict=False):
        if expects_value:
            expects_value = False
            result.append(word)
        elif word.startswith("-"):
            expects_value = word in VALUED
            result += _option(grammar, word, following)
        else:
            key, value = _split(grammar, word, sweeps)
            key, value = _in_volts(grammar, words, key, _as_number(grammar, key, value))
            if key in given:
                raise UserError(word.partition("=")[0], value, f"is given twice; the first is {given[key]}")
            given[key] = value
            result += _override(grammar, key, value, word.partition("=")[0].lstrip("+"), sweeps)
    return result


def is_sweep(words: Sequence[str]) -> bool:
    """Whether a command line asks for a sweep."""
    return any(word in MULTIRUN for word in words)


def _option(grammar: Grammar, word: str, following: str) -> list[str]:
    name, equals, given = word.partition("=")
    if word in VERBOSE:
        return [f"hydra.verbose=[{LOGGER}]"]
    if word in grammar.flags:
        return [grammar.flags[word]]
    setting = name.lstrip("-").replace("-", "_")
    if name not in FLAGS | VALUED and setting in {*grammar.known_keys(), *grammar.groups, FOLDER_WORD, *grammar.words}:
        raise UserError("option", word, f"a setting has no dashes: write {setting}={given or following or 'VALUE'}")
    if name not in FLAGS | VALUED or (equals and name not in VALUED):
        known = sorted(FLAGS | VALUED | {*VERBOSE, *grammar.flags, "--help"})
        raise UserError("option", word, "choose one of " + ", ".join(known))
    return [word]


def _split(grammar: Grammar, word: str, sweeps: bool) -> tuple[str, str]:
    """The dotted key and the value of a word."""
    key, equals, value = word.partition("=")
    if key.startswith("~"):
        raise UserError(key[1:], value or "~", "a setting cannot be removed; give it a value")
    name = key.lstrip("+")
    if not equals or not name.strip():
        raise UserError("argument", word, "write key=value")
    if _HUGE.search(value):
        raise UserError(name, value, "holds a number of more than 1000 digits")
    if name == FOLDER_WORD and not grammar.one_file:
        return (SWEEP_FOLDER if sweeps else RUN_FOLDER), value
    return grammar.words.get(name, name), value


def _as_number(grammar: Grammar, key: str, value: str) -> str:
    """The value of a number's setting that is written with its unit, or several of a sweep, in the setting's unit."""
    declared = grammar.settings.get(key)
    unit = "V" if key in OPEN_LOOP else declared.unit if declared else units.by_suffix(key)
    own = units.composed(unit) if unit and (key in OPEN_LOOP or declared is None or declared.is_number) else None
    if own is None or key.startswith(OPEN_MAPPINGS):
        return value
    return ",".join(_in_unit(key, one.strip(), unit, own) for one in value.split(","))


def _in_unit(key: str, value: str, unit: str, own: units.Unit) -> str:
    text = _unquoted(value)
    if not _WITH_UNIT.fullmatch(text):
        return value
    number, si = in_si(key, text)
    if si != own.si:
        raise UserError(key, text, f"must be in {unit}")
    return repr(number / own.factor)


def _in_volts(grammar: Grammar, words: Sequence[str], key: str, value: str) -> tuple[str, str]:
    """A setting of the reference that is named by the unit that it has in open loop, by the name of its field."""
    name = key.removesuffix("_v")
    if key not in OPEN_LOOP:
        return key, value
    chosen = [word for word in words if word.startswith("controller=")]
    if chosen != ["controller=open_loop"] and (chosen or not grammar.in_open_loop):
        allowed = f"is a voltage, which the reference of controller=open_loop is; else write {name}_mm"
        raise UserError(key, value, allowed)
    return f"{name}_mm", value


def _override(grammar: Grammar, key: str, value: str, written: str, sweeps: bool) -> list[str]:
    """The overrides of Hydra for one setting."""
    if key == "experiment" and value in ("", "null"):
        return []
    if key == "model" and value in ("", "null"):
        return ["~model"]  # what an experiment believes may be taken back
    if key == "recording" and value != NO_RECORDING:  # in a run; elsewhere it is the short word of a setting
        allowed = f"is a recording to diagnose (dtb diagnose recording={value}); a run takes recording.save=FILE"
        raise UserError(key, value, allowed)
    if key in (*grammar.groups, LAUNCHER):
        if value in ("", "null"):
            raise UserError(key, value, "choose one of " + ", ".join(options(key)))
        return [f"{key}={_rigs(key, value, sweeps) if key in RIGS else value}"]
    if key in grammar.settings and grammar.settings[key].is_mapping:
        return [f"++{key}.{name}={quoted(text)}" for name, text in _pairs(written, value).items()]
    kind = grammar.path_kind(key)
    if kind:
        if not value:
            raise UserError(written, value, "give a folder" if key in (RUN_FOLDER, SWEEP_FOLDER) else "give a value")
        return [f"{key}={paths(written, value, sweeps and kind == INPUT, literal=kind != INPUT)}"]
    if key.startswith(grammar.open_mappings):
        return [f"++{key}={value}"]
    return [f"{key}={value}"]


def _rigs(key: str, value: str, sweeps: bool) -> str:
    """Names of rigs and paths of their files; Hydra would take a name with ``.yaml`` behind it for the name."""
    found = paths(key, value, sweeps)
    for name in [] if _FUNCTION.match(value) else map(_unquoted, _at_commas(found)):
        file = Path(name.replace("\\'", "'").replace("\\\\", "\\"))
        if file.is_dir() and str(file) not in options(key):
            inside = ", ".join(sorted(one.name for suffix in SUFFIXES for one in file.glob(f"*{suffix}"))[:10])
            raise UserError(key, name, f"is a folder; give a rig's file in it ({inside or 'it holds no YAML file'})")
        if file.suffix in SUFFIXES and not file.is_file():
            known = ", ".join(options(key))
            meant = f"the rig that comes with dtb is {key}={file.stem}" if name == file.name and file.stem in options(
                key) else f"choose one of {known}, or the path of a YAML file"  # fmt: skip
            raise UserError(key, name, f"no such file; {meant}")
    return found


def _pairs(key: str, value: str) -> dict[str, str]:
    """The mapping ``{name: text, ...}`` of a word, as YAML writes it."""
    import yaml

    try:
        found = yaml.safe_load(value)
    except yaml.YAMLError:
        found = None
    if not isinstance(found, dict) or any(isinstance(one, (dict, list)) or one is None for one in found.values()):
        group, _, part = key.partition(".")
        size = "0.05 mm" if key == "enough" else "mm"
        example = f"{key}.{OF_A_RIG[part]}" if group in RIGS and part in OF_A_RIG else f"{key}='{{q3: {size}}}'"
        raise UserError(key, value, f"must be a mapping, e.g. {example}")
    return {str(name): str(text) for name, text in found.items()}


def paths(key: str, value: str, sweeps: bool, literal: bool = False) -> str:
    """One path, or several of a sweep, each in quotes where Hydra needs them: blanks, umlauts and commas are signs.

    sweeps : whether commas outside of quotes separate paths. literal : a comma is a sign in any case.

    Raises UserError: several where one is taken.
    """
    if value == "null" or _FUNCTION.match(value):
        return value
    parts = [value] if literal else _at_commas(value)
    if len(parts) > 1 and not sweeps:
        if not Path(value).expanduser().exists():
            allowed = f"takes one value here; give several with -m (a sweep), or put quotes around one: {key}=\"'a,b'\""
            raise UserError(key, value, allowed)
        parts = [value]
    return ",".join(quoted(str(Path(text).expanduser()) if text.startswith("~") else text)
                    for text in map(_unquoted, parts))  # fmt: skip


def quoted(text: str) -> str:
    """A text as Hydra's grammar reads it back, sign by sign."""
    if _PLAIN.fullmatch(text) and text != "null":
        return text
    return QuotedString(text=text, quote=Quote.single).with_quotes()


def _at_commas(value: str) -> list[str]:
    """Split at commas that stand outside of quotes and of a list's brackets."""
    return re.findall(r"(?:'[^']*'|\"[^\"]*\"|\[[^\]]*\]|[^,])+", value)


def _unquoted(text: str) -> str:
    inside = len(text) > 1 and text[0] == text[-1] and text[0] in "'\""
    return text[1:-1] if inside else text


def unquoted(value: str) -> str:
    """A value of an override as a person writes it, for names and tables."""
    return _unquoted(value).replace("\\'", "'").replace("\\\\", "\\") if value.startswith("'") else value


def sweep_name(words: list[str], command: str = "run") -> str:
    """Name a sweep by its command, its keys and a hash of its choices: the same command finds its jobs again."""
    keys = [re.sub(r"[^A-Za-z0-9._-]", "-", word.partition("=")[0].lstrip("+")) for word in words]
    named = "_".join(keys if command == "run" else [command, *keys])
    digest = hashlib.sha256("\n".join(sorted(words)).encode()).hexdigest()[:8]
    return f"{named[:60] or 'sweep'}_{digest}"


def file_name(source: str | None) -> str:
    """The name of a file (of several the first) without folder and suffixes, with signs that every disk takes."""
    first = source or ""
    if first.startswith("[") and first.endswith("]"):
        first = first[1:-1].partition(",")[0].strip(" '\"")
    stem = Path(first).name.partition(".")[0].strip("*?") or "recording"
    return "".join(sign if sign.isalnum() or sign in "-_" else "_" for sign in stem)[:60]


def register() -> None:
    """Make the schemas and the resolvers known to Hydra."""
    _register_schemas(ConfigStore.instance())
    OmegaConf.register_new_resolver("dtb_sweep_name", sweep_name, replace=True)
    OmegaConf.register_new_resolver("dtb_file_name", file_name, replace=True)
    OmegaConf.register_new_resolver("dtb_proof_name", folder_name, replace=True)


@cache
def _register_schemas(store: ConfigStore) -> None:
    for grammar in (GRAMMARS | FILES).values():
        store.store(name=f"{grammar.name}_schema", node=grammar.schema)


def call(task: Task, config_name: str, words: Sequence[str]) -> object:
    """Run ``task`` with the configuration of ``words``, or its jobs; exceptions come out as they are.

    task : called with the composed configuration: once here, or once a job of a sweep in a worker, which finds it by
        its module and name. It never reads ``sys.argv``.
    config_name : of the primary config and its :class:`Grammar`.
    words : the command line behind the program.

    Returns what ``task`` or the sweeper has returned; None if the configuration was only shown.
    """
    register()
    asked = get_args_parser().parse_intermixed_args(overrides(GRAMMARS[config_name], words))
    given = list(asked.overrides)
    version.setbase(VERSION_BASE)
    search_path = create_automatic_config_search_path(None, None, CONF)
    # not hydra.main: it composes the configuration once more to see whether it asks for a sweep
    hydra = Hydra.create_main_hydra2(task_name=config_name, config_search_path=search_path)
    try:
        if asked.cfg:
            hydra.show_cfg(config_name, given, asked.cfg, asked.package, asked.resolve)
        elif asked.info:
            hydra.show_info(asked.info, config_name, given)
        elif asked.multirun:
            return hydra.multirun(config_name, task, [*given, "hydra.mode=MULTIRUN"])
        else:
            return hydra.run(config_name, task, [*given, "hydra.mode=RUN"]).return_value
        return None
    finally:
        GlobalHydra.instance().clear()
        logging.getLogger(LOGGER).setLevel(logging.NOTSET)  # what -v has set
