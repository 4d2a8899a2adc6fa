"""``dtb paper``: every figure of the paper and ``claims.csv``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import source_hash
from dtbacklash.campaign.application import Application
from dtbacklash.config.commands import PaperConfig
from dtbacklash.config.grammar import RUN_FOLDER
from dtbacklash.files import read_json, run_folder

if TYPE_CHECKING:
    from dtbacklash.api.progress import Tell

MARK = "claims.csv"
ENTRIES = frozenset({MARK, "figures", "report.html", "summary.json"})
FIGURES = ("claims", "passed")


def do(config: PaperConfig, folder: Path, command: str, tell: Tell | None) -> tuple[bool, dict[str, Any]]:
    """Make the figures and check the claims; gives whether every claim holds, how many there are and how many hold."""
    from dtbacklash.paper import run_paper

    with run_folder(folder, RUN_FOLDER, MARK, ENTRIES) as scratch:
        passed = run_paper(scratch, tell)
    return passed, read_json(folder / "summary.json")


def show(passed: bool, config: PaperConfig, folder: Path) -> int:
    """Print where the claims are; returns 0 if every claim holds, else 1."""
    from dtbacklash.commands.console import shown_path

    print(shown_path(folder / MARK))
    return 0 if passed else 1


def fingerprint(config: PaperConfig) -> str:
    """The paper's experiments depend on the code alone."""
    return source_hash.digest()


APPLICATION = Application("paper", fingerprint, do, show, MARK, FIGURES, "paper")
