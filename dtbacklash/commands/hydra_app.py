"""Calls a task through Hydra with our schema, our plugins and our manners."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Callable

import hydra
from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf

from dtbacklash.commands.run_help import GROUPS, options
from dtbacklash.config.run import RunConfig
from dtbacklash.errors import UserError

# mappings with free keys: Hydra wants `++` to add to them, which nobody should have to know
OPEN_MAPPINGS = (
    "rig.effects.",
    "rig.parameters.",
    "rig.elements.",
    "rig.sensors.",
    "sensors.noise.",
    "sensors.resolution.",
)

FLAGS = {"-m", "--multirun", "-r", "--run", "--resolve", "--hydra-help", "-sc", "--shell-completion"}
VALUED = {"-c", "--cfg", "-p", "--package", "-i", "--info", "-cd", "--config-dir"}


def plain_overrides(words: list[str]) -> list[str]:
    """Return the command line with what Hydra demands and a person would not write.

    Raises
    ------
    UserError : an unknown flag, a word that is not ``key=value``, a setting taken away.
    """
    result = []
    expects_value = False
    for word in words:
        if word.startswith("-"):
            _check_flag(word)
            expects_value = word in VALUED
            result.append(word)
        elif expects_value:
            expects_value = False
            result.append(word)
        else:
            result += _plain_override(word)
    return result


def _check_flag(word: str) -> None:
    name, equals, _ = word.partition("=")
    if name not in FLAGS | VALUED or (equals and name not in VALUED):
        raise UserError("option", word, "choose one of " + ", ".join(sorted(FLAGS | VALUED | {"--help"})))


def _plain_override(word: str) -> list[str]:
    key, equals, value = word.partition("=")
    if key.startswith("~"):
        raise UserError(key[1:], value or "~", "a setting cannot be removed; give it a value")
    name = key.lstrip("+")
    if not equals or not name.strip():
        raise UserError("argument", word, "write key=value")
    if name == "experiment" and value in ("", "null"):
        return []
    if name in GROUPS:
        if value in ("", "null"):
            raise UserError(name, value, "choose one of " + ", ".join(options(name)))
        return [f"{name}={value}"]
    if name == "hydra.run.dir" and not value:
        raise UserError(name, value, "give a folder")
    if name.startswith(OPEN_MAPPINGS):
        return [f"++{name}={value}"]
    return [word]


def sweep_name(overrides: list[str]) -> str:
    """Name a sweep by its keys and a hash of its choices: the same command finds its jobs again."""
    keys = "_".join(re.sub(r"[^A-Za-z0-9._-]", "-", word.partition("=")[0].lstrip("+")) for word in overrides)
    digest = hashlib.sha256("\n".join(sorted(overrides)).encode()).hexdigest()[:8]
    return f"{keys[:60] or 'sweep'}_{digest}"


def register() -> None:
    """Make the schema and the resolvers known to Hydra."""
    ConfigStore.instance().store(name="run_schema", node=RunConfig)
    OmegaConf.register_new_resolver("dtb_sweep_name", sweep_name, replace=True)


def call(task: Callable[[DictConfig], object], program: str, words: list[str]) -> None:
    """Run ``task`` by ``hydra.main``; exceptions of the task and of Hydra come out as they are."""
    register()
    sys.argv = [program, *plain_overrides(words)]
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises instead of printing pages; the edge makes one line of it
    hydra.main(version_base="1.3", config_path="pkg://dtbacklash.conf", config_name="run")(task)()
