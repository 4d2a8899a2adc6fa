"""What the user sees on the terminal: progress, the table of moves, a summary line."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TimeElapsedColumn
from rich.text import Text

from dtbacklash.campaign.progress import SO_FAR, duration

if TYPE_CHECKING:
    import pandas as pd

PATIENCE_S = 2.0  # what is quicker needs no progress bar
LINE_EVERY_S = 10.0  # outside of a terminal
KNOWN_SHARE = 0.05  # with less done nobody knows how long the rest takes
WIDTH_ELSEWHERE = 120

log = logging.getLogger("dtbacklash.progress")


class Tell(Protocol):
    """Takes the fraction done, 0 to 1, and what is being done now."""

    def __call__(self, share: float, text: str = "") -> None: ...


class TimeLeft(ProgressColumn):
    """The time left, by the share that was done when something was told last and by what has passed since."""

    def __init__(self) -> None:
        super().__init__()
        self._begun, self._end = time.monotonic(), 0.0

    def told(self, share: float) -> None:
        """The share done, of the time as well."""
        passed = time.monotonic() - self._begun
        if KNOWN_SHARE < share < 1.0 and passed > PATIENCE_S:
            self._end = passed / share

    def __str__(self) -> str:
        if not self._end:
            return ""
        left = self._end - (time.monotonic() - self._begun)
        return f"about {duration(left)} left" if left > 0.0 else "longer than the steps before it"

    def render(self, task: Task) -> Text:
        """The same in a bar."""
        return Text(str(self))


@contextmanager
def progress(what: str, compiles: bool = True) -> Iterator[Tell]:
    """Give a function of the fraction done and of what is being done.

    In a terminal a bar with the time left appears on stderr after 2 s, by itself: what is silent for long is seen to
    work. Elsewhere, as in a log, a line every 10 s. What is known so far, behind ``so far`` in a text, is a line of its
    own each time that it changes. With ``-v`` there are lines of every step instead. ``compiles``: whether the compiled
    code is needed, which may have to be made first.
    """
    console = Console(stderr=True)
    verbose = log.isEnabledFor(logging.INFO)
    left, begun = TimeLeft(), time.monotonic()
    columns = "{task.description}", BarColumn(bar_width=20), "{task.percentage:3.0f} %", TimeElapsedColumn(), left
    bar = Progress(*columns, console=console, transient=True)
    number = bar.add_task(what, total=1.0)
    patience = threading.Timer(PATIENCE_S, bar.start)
    patience.daemon = True
    told: list[str] = []
    found = ""
    compiling = False
    ended = threading.Event()

    def say_now_and_then() -> None:
        while not ended.wait(LINE_EVERY_S):
            task = bar.tasks[number]
            line = ", ".join(filter(None, (f"dtb: {task.description}, {task.percentage:.0f} %", str(left))))
            print(line, file=sys.stderr, flush=True)

    def tell(share: float, text: str = "") -> None:
        nonlocal compiling, found
        text, _, known = text.partition(SO_FAR)
        if compiles and not told:
            compiling = announce_compilation()
        compiling = compiling and share <= KNOWN_SHARE
        doing = ", ".join(filter(None, (text, "compiling" if compiling else "")))
        doing = f"{what}: {doing}" if text else doing or what
        left.told(share)
        bar.update(number, completed=share, description=doing)
        if known != found and known and not verbose:
            found = known
            print(f"dtb: after {duration(time.monotonic() - begun)}: {known}", file=sys.stderr, flush=True)
        line = f"{text}; {known}" if known else text or f"{what}: {10 * int(10 * share)} %"
        if not told or told[-1] != line:
            told.append(line)
            if verbose:
                log.info("%3.0f %%  %s", 100 * share, line if text else what)

    if console.is_terminal and not verbose:
        patience.start()
    elif not verbose:
        threading.Thread(target=say_now_and_then, daemon=True).start()
    try:
        yield tell
    finally:
        ended.set()
        patience.cancel()
        if patience.is_alive():
            patience.join()
        if bar.live.is_started:  # else it would end with an empty line
            bar.stop()


def announce_compilation() -> bool:
    """Say why the first run takes longer than the others; returns whether it does."""
    from dtbacklash.compiled import is_cold
    from dtbacklash.physics.kernel.sample import advance

    cold = is_cold(advance)
    if cold:
        print("dtb: compiling the closed loop, once on this machine (some minutes)", file=sys.stderr, flush=True)
    return cold


def stdout_console() -> Console:
    """Return a console for results, as wide as the terminal, or wide enough for a table in a file."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=WIDTH_ELSEWHERE)


def print_run(summary: dict[str, Any], moves: pd.DataFrame, estimates: pd.DataFrame, folder: Path) -> None:
    """Print the moves, the estimates, what sums them up, what helps if it does not settle, and where the report is."""
    from dtbacklash.report.kit import tables
    from dtbacklash.report.run.text import lines

    console = stdout_console()
    for line in lines(summary, moves, estimates):
        if isinstance(line, Text):
            console.print(line, soft_wrap=True)
        else:
            tables.show(line)
    console.print(escape(shown_path(folder / "report.html")), soft_wrap=True)


def print_beliefs(found: str, table: pd.DataFrame, folder: Path) -> None:
    """Print what was found, the loop with each belief, and where the report is."""
    from dtbacklash.report.closing.page import beliefs_table
    from dtbacklash.report.kit import tables

    console = stdout_console()
    console.print(Text(found), soft_wrap=True)
    console.print()
    tables.show(tables.of(beliefs_table(table)))
    console.print(escape(shown_path(folder / "report.html")), soft_wrap=True)


def shown_path(path: Path) -> str:
    """Return ``path`` relative to here if it lies below, for people to click or copy."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative
