"""What a sweep can be made of: the commands that turn one composed configuration into one folder of results."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from omegaconf import DictConfig

#: name (``hydra.job.name``) -> "module:attribute"; a text, so that nothing is imported before it is wanted
APPLICATIONS: dict[str, str] = {
    "run": "dtbacklash.commands.run:APPLICATION",
    "diagnose": "dtbacklash.commands.diagnose:APPLICATION",
    "conceal": "dtbacklash.commands.conceal:APPLICATION",
    "prove": "dtbacklash.commands.prove:APPLICATION",
    "paper": "dtbacklash.commands.paper:APPLICATION",
}


def as_they_are(words: list[str]) -> list[str]:
    """The words of a command line that need nothing more."""
    return words


def nothing_more(folder: Path, table: pd.DataFrame, axes: list[str]) -> None:
    """A campaign whose jobs say all: each has its page, or what it hides stays hidden."""


def nothing_else(settings: Any) -> Path | None:
    """A job that writes its own folder and nothing else."""
    return None


@dataclass(frozen=True)
class Application:
    """One command as a campaign sees it.

    Attributes
    ----------
    name : as in ``hydra.job.name``.
    load : from the composed configuration to checked settings; raises :class:`~dtbacklash.errors.UserError`.
    fingerprint : of the settings: a hash of all that decides the result.
    work : (settings, folder, command) -> the row of figures. Writes the folder, complete or not at all.
    mark : the file that a complete result holds.
    figures : the columns of the table, names of what ``work`` returns.
    finish : (folder, table, axes) writes the page and the figure of the whole campaign, each at once or not at all.
        The table has a row a job: the choices (the columns ``axes``), the figures, ``status``, ``error``, and
        ``folder``, the name of the job's folder.
    complete : the overrides of one job -> the same with the choices that follow from them.
    writes : settings -> the file outside its folder that a job writes as well, or None.
    writes_key : the setting that names this file.
    """

    name: str
    load: Callable[[DictConfig], Any]
    fingerprint: Callable[[Any], str]
    work: Callable[[Any, Path, str], dict[str, Any]]
    mark: str
    figures: tuple[str, ...]
    finish: Callable[[Path, pd.DataFrame, list[str]], None] = nothing_more
    complete: Callable[[list[str]], list[str]] = as_they_are
    writes: Callable[[Any], Path | None] = nothing_else
    writes_key: str = ""


def find(name: str) -> Application:
    """The application called ``name``, imported now.

    Raises
    ------
    KeyError : there is none.
    """
    module, _, attribute = APPLICATIONS[name].partition(":")
    found = getattr(importlib.import_module(module), attribute)
    assert isinstance(found, Application)
    return found
