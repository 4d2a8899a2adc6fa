"""The commands that turn one composed configuration into one folder of results, and may be swept."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash.config.grammar import GRAMMARS
from dtbacklash.config.load import load

if TYPE_CHECKING:
    import pandas as pd
    from omegaconf import DictConfig

#: name (``hydra.job.name``) -> "module:attribute"; a text, so that nothing is imported before it is wanted
APPLICATIONS = {name: f"dtbacklash.commands.{name}:APPLICATION" for name in GRAMMARS}


@dataclass(frozen=True)
class Application:
    """One command, alone or as the jobs of a sweep.

    name : as in ``hydra.job.name``.
    fingerprint : of the settings: a hash of all that decides the result.
    do : (settings, folder, command line, tell) writes the folder, complete or not at all. Gives what ``show`` shows and
        the row of figures. ``tell`` is told how far it is; None in a job of a sweep.
    show : (what ``do`` gave first, settings, folder) says on the terminal what came out; returns the exit code. The
        folder is None where nothing could be written, and ``do`` raised an error with its ``result``.
    mark : the file that a complete result holds.
    figures : the columns of the table, names in the row.
    doing : what it does, for a bar of progress.
    progress : the bar, where it is another one than that of a command.
    finish : (folder, table, axes) writes the page and the figure of the whole sweep, each at once or not at all.
        The table has a row a job: the choices (the columns ``axes``), the figures, ``status``, ``error``, and
        ``folder``, the name of the job's folder. None: each job has its page, or hides what it holds.
    complete : the overrides of one job -> the same with the choices that follow from them.
    writes : settings -> the file outside its folder that a job writes as well, or None.
    writes_key : the setting that names this file.
    """

    name: str
    fingerprint: Callable[[Any], str]
    do: Callable[[Any, Path, str, Any], tuple[Any, dict[str, Any]]]
    show: Callable[[Any, Any, Any], int]
    mark: str
    figures: tuple[str, ...]
    doing: str = ""
    progress: Callable[[], AbstractContextManager[Any]] | None = None
    finish: Callable[[Path, pd.DataFrame, list[str]], None] | None = None
    complete: Callable[[list[str]], list[str]] = list
    writes: Callable[[Any], Path | None] = lambda settings: None
    writes_key: str = ""

    def load(self, config: DictConfig) -> Any:
        """The checked settings of a composed configuration; raises :class:`~dtbacklash.errors.UserError`."""
        return load(config, GRAMMARS[self.name].schema)


def find(name: str) -> Application:
    """The application called ``name``, imported now; raises KeyError: there is none."""
    module, _, attribute = APPLICATIONS[name].partition(":")
    found = getattr(importlib.import_module(module), attribute)
    assert isinstance(found, Application)
    return found
