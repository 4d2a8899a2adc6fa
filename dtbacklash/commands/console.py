"""What the user sees on the terminal: progress, the table of moves, a summary line."""

from __future__ import annotations

import logging
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

PATIENCE_S = 2.0  # what is quicker needs no progress bar
WIDTH_ELSEWHERE = 120


@contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """Give a function that takes the fraction done; a bar appears on stderr when it takes longer than 2 s."""
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    number = bar.add_task(what, total=1.0)
    begin = time.monotonic()
    started, ticks = False, 0

    def tick(fraction: float) -> None:
        nonlocal started, ticks
        ticks += 1
        if ticks == 1:
            announce_compilation()
        if not started and time.monotonic() - begin > PATIENCE_S:
            bar.start()
            started = True
        bar.update(number, completed=fraction)

    try:
        yield tick
    finally:
        if started:
            bar.stop()


@contextmanager
def messages(verbose: bool) -> Iterator[None]:
    """With ``-v`` the package's messages go to stderr."""
    logger = logging.getLogger("dtbacklash")
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("dtb: %(message)s"))
    level = logger.level
    if verbose:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


def announce_compilation() -> None:
    """Say why the first run takes longer than the others."""
    from dtbacklash.compiled import is_cold

    if is_cold():
        print("dtb: compiling the simulation, once on this machine (about 20 s)", file=sys.stderr, flush=True)


def stdout_console() -> Console:
    """Return a console for results, as wide as the terminal, or wide enough for a table in a file."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=WIDTH_ELSEWHERE)


def print_run(summary: dict[str, Any], moves: pd.DataFrame, estimates: pd.DataFrame, folder: Path) -> None:
    """Print the moves, the estimates, one line that sums them up, and where the report is."""
    from dtbacklash.report import tables

    shown = [table(frame) for table, frame in ((tables.moves, moves), (tables.estimates, estimates)) if len(frame)]
    for table in shown:
        tables.show(table, "")
    console = stdout_console()
    console.print(escape(_summary_line(summary)), soft_wrap=True)
    report = folder / "report.html"
    console.print(escape(shown_path(report)), soft_wrap=True)


def shown_path(path: Path) -> str:
    """Return ``path`` relative to here if it lies below, for people to click or copy."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative


def _summary_line(summary: dict[str, Any]) -> str:
    from dtbacklash.report.numbers import number

    parts = [f"peak {number(summary.get('peak_voltage_v'))} V"]
    if summary.get("n_moves"):
        longest = summary.get("settling_time_s_max")
        settles = longest is not None and not math.isnan(longest)
        parts.insert(0, f"overshoot at most {number(summary.get('overshoot_pct_max'))} %")
        parts.insert(1, f"settling at most {number(longest)} s" if settles else "not every move settles")
    if summary.get("n_estimations"):
        parts.append(f"{summary.get('n_accepted')} of {summary.get('n_estimations')} estimates accepted")
    wall = summary.get("wall_s", {})
    parts.append(f"{number(summary.get('seconds_simulated'))} s simulated in {number(wall.get('total'))} s")
    return f"{summary.get('controller')}: " + ", ".join(parts)
