"""``dtb paper``: every figure of the paper and ``claims.csv``."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import sources
from dtbacklash.campaign.application import Application
from dtbacklash.config.commands import PaperConfig
from dtbacklash.config.grammar import RUN_FOLDER
from dtbacklash.config.load import load
from dtbacklash.files import run_folder

if TYPE_CHECKING:
    from dtbacklash.commands.console import Tell

MARK = "claims.csv"
ENTRIES = frozenset({MARK, "figures", "report.html", "summary.json"})
FIGURES = ("claims", "passed")


def single(config: PaperConfig, folder: Path, command: str) -> int:
    """Make the figures and check the claims; returns 0 if every claim holds, 1 if any fails."""
    from dtbacklash.commands.console import progress, shown_path

    with progress("paper") as tell:
        passed = reproduce(folder, tell)
    print(shown_path(folder / MARK))
    return 0 if passed else 1


def reproduce(folder: Path, tell: Tell | None = None) -> bool:
    """Write the folder, complete or not at all; returns whether every claim holds."""
    from dtbacklash.paper import run_paper

    with run_folder(folder, RUN_FOLDER, MARK, ENTRIES) as scratch:
        return run_paper(scratch, tell)


def work(config: PaperConfig, folder: Path, command: str) -> dict[str, Any]:
    """The same as a job of a sweep; returns how many claims there are and hold."""
    reproduce(folder)
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return {name: summary[name] for name in FIGURES}


def fingerprint(config: PaperConfig) -> str:
    """The paper's experiments depend on the code alone."""
    return sources.digest()


APPLICATION = Application("paper", partial(load, schema=PaperConfig), fingerprint, work, MARK, FIGURES)
