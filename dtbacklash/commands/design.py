"""``dtb design``: the experiment that tells apart what a diagnosis left open."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash.campaign.application import Application
from dtbacklash.config.commands import DesignConfig
from dtbacklash.config.grammar import RUN_FOLDER
from dtbacklash.config.hydra_app import quoted
from dtbacklash.config.load import settings_hash
from dtbacklash.files import run_folder

if TYPE_CHECKING:
    from dtbacklash.api.progress import Tell
    from dtbacklash.diagnosis.experiments.design import Design
    from dtbacklash.diagnosis.experiments.rivalry import Rivalry

MARK = "design.json"
ENTRIES = frozenset({MARK, "command.csv", "figures", "report.html"})
FIGURES = ("least_apart", "tries")


def do(
    config: DesignConfig, folder: Path, command: str, tell: Tell | None
) -> tuple[tuple[Design, Rivalry], dict[str, Any]]:
    """Look for the command, and write the folder, complete or not at all."""
    from dtbacklash.api.experiments import experiment

    with run_folder(folder, RUN_FOLDER, MARK, ENTRIES) as scratch:
        found, rivalry = experiment(config, (os.cpu_count() if tell else None) or 1, tell)
        from dtbacklash.report.experiments import design as report

        report.write(found, rivalry, scratch, command)
    return (found, rivalry), {"least_apart": report.errors_of(found.best)[0], "tries": found.tries}


def show(made: tuple[Design, Rivalry], config: DesignConfig, folder: Path) -> int:
    """Print how far apart the models would be, and what uses the command; returns the exit code."""
    from dtbacklash.commands.console import shown_path
    from dtbacklash.report.components import tables
    from dtbacklash.report.experiments import design as report

    found, rivalry = made
    tables.show(tables.of(report.rivals_table(found, rivalry)), "", *report.sentences(found, rivalry))
    rig, command = shown_path(Path(str(config.found)) / "rig.yaml"), shown_path(folder / "command.csv")
    print(f"To see it: {report.run_command(found, rivalry, rig, command)}")
    print(command)
    print(shown_path(folder / "report.html"))
    return 0


def with_folder(words: list[str]) -> list[str]:
    """The words with ``found=`` before a folder that stands alone."""
    return [word if "=" in word or word.startswith("-") else f"found={quoted(word)}" for word in words]


def fingerprint(config: DesignConfig) -> str:
    """A hash of settings, the diagnosis, the commands to choose from, and the code."""
    folder = Path(str(config.found))
    return settings_hash(config, [str(folder / "diagnosis.json"), str(folder / "rig.yaml"), *config.commands])


APPLICATION = Application("design", fingerprint, do, show, MARK, FIGURES, "designing", complete=with_folder)
