"""What the user sees on the terminal: tables, a summary line, where the report is."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.text import Text

if TYPE_CHECKING:
    import pandas as pd

WIDTH_ELSEWHERE = 120


def stdout_console() -> Console:
    """Return a console for results, as wide as the terminal, or wide enough for a table in a file."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=WIDTH_ELSEWHERE)


def print_run(summary: dict[str, Any], moves: pd.DataFrame, estimates: pd.DataFrame, folder: Path) -> None:
    """Print the moves, the estimates, what sums them up, what helps if it does not settle, and where the report is."""
    from dtbacklash.report.components import tables
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
    from dtbacklash.report.components import tables

    console = stdout_console()
    console.print(Text(found), soft_wrap=True)
    console.print()
    tables.show(tables.of(beliefs_table(table)))
    console.print(escape(shown_path(folder / "report.html")), soft_wrap=True)


def shown_path(path: Path) -> str:
    """Return ``path`` relative to here if it lies below, for people to click or copy."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative
