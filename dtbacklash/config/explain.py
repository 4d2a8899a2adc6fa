"""Turns what Hydra, OmegaConf and YAML raise into one line: key, value, what is allowed."""

from __future__ import annotations

import re
from collections.abc import Sequence

import yaml
from hydra.errors import ConfigCompositionException, HydraException, MissingConfigException, OverrideParseException
from hydra.plugins.config_source import ConfigLoadError
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException, ValidationError

from dtbacklash.config.grammar import FOLDER_WORD, RUN, RUN_FOLDER, SWEEP_FOLDER, Grammar, kind_of, unknown_key
from dtbacklash.config.groups import RIGS
from dtbacklash.errors import UserError
from dtbacklash.files import cannot_write


def explain(error: BaseException, words: Sequence[str], grammar: Grammar = RUN) -> UserError | None:
    """Return the user's mistake behind ``error``, or None if it is a mistake of ours.

    error : what came out of Hydra.
    words : the overrides of the command line, to find the value that belongs to a key.
    grammar : of the command.
    """
    if isinstance(error, UserError):
        return error
    if isinstance(error, MissingConfigException):
        return _missing_option(error)
    if isinstance(error, OverrideParseException):
        return _unreadable(error.override)
    if isinstance(error, yaml.YAMLError):
        return _bad_yaml(error)
    if isinstance(error, OmegaConfBaseException):
        return _bad_setting(error, words, grammar)
    if isinstance(error, (HydraException, ConfigLoadError)):
        cause = error.__cause__ or error.__context__  # Hydra re-raises some with their text only
        if isinstance(cause, (OmegaConfBaseException, yaml.YAMLError)):
            return explain(cause, words, grammar)
        return _composition(error, words, grammar)
    if isinstance(error, UnicodeDecodeError):
        return UserError("file", "a YAML file", "must be text in UTF-8")
    if isinstance(error, BrokenPipeError):  # who read our output has gone: nobody's mistake
        return None
    if isinstance(error, OSError) and error.errno is None:  # OmegaConf, of a file that holds a number or a word
        return UserError("file", "a YAML file", "must hold settings, one `key: value` a line")
    if isinstance(error, OSError):  # the task explains its own; this is Hydra making the folder
        return cannot_write("hydra.run.dir", error.filename, error)
    if isinstance(error, AssertionError):  # OmegaConf, of a key below a section that is null
        word = next((w for w in words if w.lstrip("+").startswith("model.")), "")
        key, _, value = word.lstrip("+").partition("=")
        return UserError(key, value, "there is no model to change; choose model=NAME or model=FILE") if word else None
    return None


def as_written(mistake: UserError, words: Sequence[str], grammar: Grammar) -> UserError:
    """The mistake in the words of the command line: ``out`` where that was written for ``hydra.run.dir``."""
    short = {key: word for word, key in grammar.words.items()}
    short |= dict.fromkeys((RUN_FOLDER, SWEEP_FOLDER), FOLDER_WORD)
    word = short.get(mistake.key)
    if word is not None and value_of(word, words) is not None:
        mistake.key = word
    return mistake


def value_of(key: str, words: Sequence[str]) -> str | None:
    """Return the value that the command line gives to ``key``, or None."""
    for word in reversed(words):
        name, equals, value = word.partition("=")
        if equals and name.lstrip("+~") == key:
            return value
    return None


def _missing_option(error: MissingConfigException) -> UserError:
    missing = error.missing_cfg_file or "config"
    options = ", ".join(error.options or [])
    if missing.startswith("hydra/"):
        group, _, option = missing.rpartition("/")
    else:
        group, _, option = missing.partition("/")
    if group in RIGS:
        options += ", or the path of a YAML file"
        if option.endswith((".yaml", ".yml")):
            return UserError(group, option, f"no such file; choose one of {options}")
    if group == "hydra/launcher" and "submitit" in option:
        options += " (submitit needs the extra: pip install 'dtbacklash[submitit]')"
    return UserError(group, option, f"choose one of {options}" if options else "no such file")


def _unreadable(word: str) -> UserError:
    key, equals, value = word.partition("=")
    if not equals:
        return UserError("argument", word, "write key=value")
    return UserError(key, value, "cannot be read; put quotes around a value with special signs: key=\"'value'\"")


def _bad_yaml(error: yaml.YAMLError) -> UserError:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or "not readable"
    where = f"{mark.name}:{mark.line + 1}" if mark is not None else "a YAML file"
    return UserError("file", where, f"is not valid YAML: {problem}")


def _bad_setting(error: OmegaConfBaseException, words: Sequence[str], grammar: Grammar) -> UserError:
    key = error.full_key or str(error.key or "config")
    if "." not in key:  # inside a free mapping OmegaConf forgets the way to the key
        key = next((w.partition("=")[0].lstrip("+") for w in words if f".{key}." in w.partition("=")[0]), key)
    value = value_of(key, words)
    if value is None:
        quoted = re.search(r"Value '([^']*)'", str(error))
        value = str(error.value) if error.value is not None else quoted[1] if quoted else "..."
    first_line = (str(error).splitlines() or ["not allowed"])[0]
    if isinstance(error, (ConfigAttributeError, ConfigKeyError)):
        # `foo.bar=1` is reported in the name of foo; show what was written
        written = next((w.partition("=")[0] for w in words if w.startswith(key + ".")), key)
        return UserError(written, value_of(written, words) or value, unknown_key(written, grammar))
    if re.fullmatch(r"(rig|model)\.parameters\.[^.]+", key) and value_of(key, words) is not None:
        return UserError(key, value, f"a parameter has a value and a tolerance: write {key}.value={value}")
    if "is not a subclass of ParameterConfig" in first_line:
        return UserError(key, value, "the rig has no such parameter; `--cfg job` shows those that it has")
    if isinstance(error, ValidationError):
        return UserError(key, value, f"must be {kind_of(key, grammar)}")
    return UserError(key, value, first_line)


def _composition(error: Exception, words: Sequence[str], grammar: Grammar) -> UserError:
    """What Hydra says about a combination of overrides; its first lines carry the matter."""
    text = str(error)
    if "--multirun" in text:
        found = re.search(r"'([^'=]+)=(.*?)'(?:\n| requires|$)", text)
        key, value = (found.group(1).lstrip("+"), found.group(2)) if found else ("argument", "...")
        decimal = kind_of(key, grammar) == "a number" or key.startswith(grammar.open_mappings)
        if decimal and re.fullmatch(r"[+-]?\d+,\d+( [^,]*)?", value):
            point = value.replace(",", ".")
            return UserError(key, value, f"write a decimal point ({point}); with -m a comma separates several values")
        return UserError(key, value, "takes one value here; give several with -m (a sweep)")
    quoted = re.search(r"'([^']+)'", text)
    name = quoted.group(1).lstrip("+~") if quoted else "config"
    key, equals, value = name.partition("=")
    shown = value if equals else value_of(key, words)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if isinstance(error, ConfigCompositionException) and "No match in the defaults list" in text:
        return UserError(key, shown, unknown_key(key, grammar))
    return UserError(key, shown if shown is not None else "...", " ".join(lines[:2]) or "not allowed")
