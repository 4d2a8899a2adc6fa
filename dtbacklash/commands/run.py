"""``dtb run``: one closed-loop experiment, or with ``-m`` a sweep over many."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import files
from dtbacklash.campaign.application import Application
from dtbacklash.config.grammar import SWEEP_FOLDER
from dtbacklash.config.load import fingerprint, load
from dtbacklash.config.run import RunConfig
from dtbacklash.face.run_files import simulate_and_write

if TYPE_CHECKING:
    import pandas as pd

FIGURES = ("overshoot_pct_max", "settling_time_s_max", "peak_voltage_v", "n_estimations", "n_accepted")


def single(config: RunConfig, folder: Path, command: str) -> int:
    """Simulate ``config``, write its folder and tell the user; returns the exit code."""
    from dtbacklash.commands import console

    if config.task == "close_the_loop":
        return _close(config, folder, command)
    with console.progress("simulating") as tell:
        result = simulate_and_write(config, folder, command, tell)
    console.print_run(result.summary, result.moves, result.estimates, folder)
    sys.stdout.flush()
    return 0


def _close(config: RunConfig, folder: Path, command: str) -> int:
    """Record, diagnose, run with what was found, and tell the user; returns the exit code."""
    from dtbacklash.commands import console
    from dtbacklash.face.close_files import close_and_write
    from dtbacklash.report.closing.page import found_in_words

    with console.progress("closing the loop") as tell:
        closed = close_and_write(config, folder, command, lambda text, share: tell(share, text))
    console.print_beliefs(found_in_words(closed.diagnosis), closed.table, folder)
    return 0


def work(config: RunConfig, folder: Path, command: str) -> dict[str, Any]:
    """Simulate and write the folder of one job; returns its summary."""
    if config.task == "close_the_loop":
        from dtbacklash.face.close_files import close_and_write, summary

        return summary(config, close_and_write(config, folder, command), command)
    return dict(simulate_and_write(config, folder, command).summary)


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
    "run", partial(load, schema=RunConfig), fingerprint, work, "summary.json", FIGURES, finish, writes=saved,
    writes_key="recording.save",
)  # fmt: skip
