"""From Hydra's configuration to a checked one of a command's schema, and back to plain data."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import types
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dtbacklash import source_hash
from dtbacklash.config.grammar import Grammar, grammar_of, unknown_key
from dtbacklash.config.rig import of_the_model
from dtbacklash.config.run import RunConfig
from dtbacklash.errors import UserError

Config = TypeVar("Config")


def load(config: DictConfig, schema: type[Config]) -> Config:
    """Resolve and check ``config``.

    Raises UserError: a value out of range, an unknown key, an interpolation that leads nowhere.
    """
    _refuse_unknown(config, schema, grammar_of(schema), "")
    try:
        _check_model(config)
        result = OmegaConf.to_object(config)  # runs every __post_init__
    except OmegaConfBaseException as error:
        first_line = str(error).splitlines()[0]
        key = error.full_key or "config"
        value = OmegaConf.to_container(config, resolve=False)
        for part in key.split("."):
            value = value.get(part, "...") if isinstance(value, dict) else value
        raise UserError(key, value, first_line.lower()) from error
    assert isinstance(result, schema)
    return result


def _check_model(config: DictConfig) -> None:
    """Refuse a model that is no rig in its own name: a rig's description knows only that it is one."""
    if config.get("model") is None:
        return
    try:
        OmegaConf.to_object(config.model)
    except UserError as mistake:
        raise of_the_model(mistake) from mistake


def _refuse_unknown(config: DictConfig, schema: type, grammar: Grammar, prefix: str) -> None:
    """Refuse what ``+key=value`` added: a key that nothing reads is a mistake."""
    known = typing.get_type_hints(schema)
    for key in map(str, config):
        dotted = prefix + key
        if key not in known:
            raise UserError(dotted, config[key], unknown_key(dotted, grammar))
        child = known[key]
        if isinstance(child, types.UnionType) and config[key] is not None:
            child = next(k for k in typing.get_args(child) if k is not type(None))
        if dataclasses.is_dataclass(child) and isinstance(child, type):
            _refuse_unknown(config[key], child, grammar, f"{dotted}.")


def plain(config: object) -> dict[str, Any]:
    """A configuration as nested dictionaries of JSON types."""
    assert dataclasses.is_dataclass(config)
    assert not isinstance(config, type)
    return dataclasses.asdict(config)


def fingerprint(config: RunConfig) -> str:
    """Return a hash of all that decides the result: settings, content of input files, the code."""
    settled = plain(config)
    settled["code"] = source_hash.digest()
    del settled["recording"]
    for section in ("profile", "reference"):
        path = settled[section].pop("path")
        if path is not None:
            settled[section]["content"] = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    if config.uncertainty is not None and (file := Path(config.uncertainty) / "diagnosis.json").is_file():
        settled["uncertainty"] = hashlib.sha256(file.read_bytes()).hexdigest()
    text = json.dumps(settled, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def settings_hash(config: object, files: Iterable[str | None] = ()) -> str:
    """A hash of settings, of the content of ``files`` (those that there are), and of the code."""
    contents = [Path(file).read_bytes() for file in files if file is not None and Path(file).is_file()]
    hashes = [hashlib.sha256(content).hexdigest() for content in contents]
    text = json.dumps([plain(config), hashes, source_hash.digest()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
