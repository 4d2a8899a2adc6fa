"""``dtb run``: one closed-loop experiment, or with ``-m`` a sweep over many."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import files
from dtbacklash.api.run_files import simulate_and_write
from dtbacklash.campaign.application import Application
from dtbacklash.config.grammar import SWEEP_FOLDER
from dtbacklash.config.load import fingerprint
from dtbacklash.config.run import RunConfig

if TYPE_CHECKING:
    import pandas as pd

    from dtbacklash.api.progress import Tell

FIGURES = ("overshoot_pct_max", "settling_time_s_max", "peak_voltage_v", "n_estimations", "n_accepted")


def do(config: RunConfig, folder: Path, command: str, tell: Tell | None) -> tuple[Any, dict[str, Any]]:
    """Simulate, or close the loop, and write the folder; gives a ``RunResult`` or a ``Closed``."""
    if config.task == "close_the_loop":
        from dtbacklash.api.run_files import close_and_write, closed_summary

        told = None if tell is None else lambda text, share: tell(share, text)
        closed = close_and_write(config, folder, command, told)
        return closed, closed_summary(config, closed, command)
    result = simulate_and_write(config, folder, command, tell)
    return result, dict(result.summary)


def show(result: Any, config: RunConfig, folder: Path) -> int:
    """Print what came out; returns the exit code."""
    from dtbacklash.commands import console

    if config.task == "close_the_loop":
        from dtbacklash.report.closing.page import found_in_words

        console.print_beliefs(found_in_words(result.diagnosis), result.table, folder)
        return 0
    console.print_run(result.summary, result.moves, result.estimates, folder)
    sys.stdout.flush()
    if never_answered(result.summary):
        print("dtb: the twin has answered none of the requests", file=sys.stderr)
        return 1
    return 0


def never_answered(summary: dict[str, Any]) -> bool:
    """Whether a run asked a twin at the other end of a network, and in vain each time."""
    remote = summary.get("remote")
    return bool(remote and remote["requests"] and not remote["answered"])


def finish(folder: Path, table: pd.DataFrame, axes: list[str]) -> None:
    """Draw ``sweep.png``, the figures of merit over the swept choices, and write the page."""
    from dtbacklash.report.sweep import figure, page

    with files.written(folder / "sweep.png", SWEEP_FOLDER, folder) as scratch:
        figure.draw(table, axes, scratch)
    page.write(folder, table, axes)


def saved(config: RunConfig) -> Path | None:
    """The file to which a run also writes what the sensors saw."""
    return None if config.recording.save is None else Path(config.recording.save).absolute()


APPLICATION = Application(
    "run", fingerprint, do, show, "summary.json", FIGURES, "simulating", finish=finish, writes=saved,
    writes_key="recording.save",
)  # fmt: skip
