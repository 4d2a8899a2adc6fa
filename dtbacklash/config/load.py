"""From Hydra's configuration to a checked :class:`RunConfig`, and back to plain data."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import typing
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dtbacklash import sources
from dtbacklash.config.run import RunConfig
from dtbacklash.errors import UserError


def load(config: DictConfig) -> RunConfig:
    """Resolve and check ``config``.

    Raises
    ------
    UserError : a value out of range, an unknown key, an interpolation that leads nowhere.
    """
    _refuse_unknown(config, RunConfig, "")
    try:
        result = OmegaConf.to_object(config)  # runs every __post_init__
    except OmegaConfBaseException as error:
        first_line = str(error).splitlines()[0]
        key = error.full_key or "config"
        value = OmegaConf.to_container(config, resolve=False)
        for part in key.split("."):
            value = value.get(part, "...") if isinstance(value, dict) else value
        raise UserError(key, value, first_line.lower()) from error
    assert isinstance(result, RunConfig)
    return result


def _refuse_unknown(config: DictConfig, schema: type, prefix: str) -> None:
    """Refuse what ``+key=value`` added: a key that nothing reads is a mistake."""
    known = typing.get_type_hints(schema)
    for key in map(str, config):
        dotted = prefix + key
        if key not in known:
            raise UserError(dotted, config[key], unknown_key(dotted))
        child = known[key]
        if dataclasses.is_dataclass(child) and isinstance(child, type):
            _refuse_unknown(config[key], child, f"{dotted}.")


def settings(schema: type = RunConfig, prefix: str = "") -> dict[str, Any]:
    """Return every setting of the schema: dotted key -> type."""
    result: dict[str, Any] = {}
    for name, kind in typing.get_type_hints(schema).items():
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            result |= settings(kind, f"{prefix}{name}.")
        else:
            result[prefix + name] = kind
    return result


def unknown_key(key: str) -> str:
    """Say that ``key`` is no setting, and which one may be meant."""
    import difflib

    known = [*settings(), "hydra.run.dir", "hydra.sweep.dir", "hydra.launcher.n_jobs"]
    groups = {name.split(".")[0] for name in settings()}
    near = difflib.get_close_matches(key, [*known, *groups], n=1, cutoff=0.6)
    near = near or [name for name in known if name.split(".")[-1] == key.rsplit(".", maxsplit=1)[-1]][:1]
    if near:
        return f"no such setting; did you mean {near[0]}?"
    if key.startswith("hydra."):
        return "no such setting; dtb run --cfg hydra lists them"
    section = key.split(".", maxsplit=1)[0] + "."
    inside = [name for name in known if name.startswith(section)]
    return "no such setting; choose one of " + ", ".join(inside or sorted(groups))


def kind_of(key: str) -> str:
    """Say in words what type the setting ``key`` has."""
    kind = settings().get(key)
    words = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
    if kind is None and key.startswith(("sensors.", "rig.parameters.")):
        return "a number"
    return words.get(kind, "a value of another kind")  # type: ignore[arg-type]


def plain(config: RunConfig) -> dict[str, Any]:
    """Return ``config`` as nested dictionaries of JSON types."""
    return dataclasses.asdict(config)


def fingerprint(config: RunConfig) -> str:
    """Return a hash of all that decides the result: settings, content of input files, the code."""
    settled = plain(config)
    settled["code"] = sources.digest()
    del settled["recording"]
    for section in ("profile", "reference"):
        path = settled[section].pop("path")
        if path is not None:
            settled[section]["content"] = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    text = json.dumps(settled, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
