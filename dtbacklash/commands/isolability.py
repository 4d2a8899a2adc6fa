"""``dtb isolability``: what a planned experiment would show, and what it would confuse."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash.campaign.application import Application
from dtbacklash.config.commands import IsolabilityConfig
from dtbacklash.config.grammar import RUN_FOLDER
from dtbacklash.config.load import settings_hash
from dtbacklash.files import run_folder

if TYPE_CHECKING:
    from dtbacklash.api.progress import Tell
    from dtbacklash.diagnosis.experiments.isolability import Isolability

MARK = "isolability.json"
ENTRIES = frozenset({MARK, "effects.csv", "matrix.csv", "figures", "report.html"})
FIGURES = ("effects", "confused", "hidden")


def do(config: IsolabilityConfig, folder: Path, command: str, tell: Tell | None) -> tuple[Isolability, dict[str, Any]]:
    """Simulate, compare, and write the folder, complete or not at all."""
    from dtbacklash.api.experiments import isolable

    with run_folder(folder, RUN_FOLDER, MARK, ENTRIES) as scratch:
        found = isolable(config, (os.cpu_count() if tell else None) or 1, tell)
        from dtbacklash.report.experiments import isolability as report

        if tell:
            tell(0.95, "drawing the matrix")
        report.write(found, scratch, command)
    return found, {
        "effects": len(found.effects), "confused": len(found.pairs), "hidden": len(found.hidden),
    }  # fmt: skip


def show(found: Isolability, config: IsolabilityConfig, folder: Path) -> int:
    """Print sizes, what would be confused, and where the page is; returns the exit code."""
    from dtbacklash.commands.console import shown_path
    from dtbacklash.report.components import tables
    from dtbacklash.report.experiments import isolability as report

    tables.show(tables.of(report.effects_table(found)), "", report.lead(found), "", *report.sentences(found))
    if not (config.sensors.noise or config.sensors.resolution):
        print("\nThe sensors were taken as exact; their noise is sensors.noise.COLUMN=SIZE.")
    print(shown_path(folder / "report.html"))
    return 0


def fingerprint(config: IsolabilityConfig) -> str:
    """A hash of settings, the planned command and the code."""
    return settings_hash(config, [config.command, config.reference.path])


APPLICATION = Application("isolability", fingerprint, do, show, MARK, FIGURES, "looking ahead")
