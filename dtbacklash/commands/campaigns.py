"""What every command with ``-m`` says at the end of a sweep."""

from __future__ import annotations

import sys


def report() -> int:
    """Print the table of the sweep that has just ended, and why jobs failed; returns the exit code."""
    from rich.markup import escape

    from dtbacklash.campaign import sweep
    from dtbacklash.commands.console import shown_path, stdout_console
    from dtbacklash.report.kit import tables

    outcome = sweep.outcome()
    if outcome is None:  # Hydra was only asked to show something
        return 0
    table, axes = outcome.table, outcome.axes
    tables.show(tables.sweep(table.drop(columns="error"), axes), "")
    for row in table[table["status"] != "done"].to_dict("records"):
        choices = ", ".join(f"{axis}={row[axis]}" for axis in axes)
        print(f"dtb: job {choices} failed: {row['error']}", file=sys.stderr)
    done = int((table["status"] == "done").sum())
    earlier = f", {outcome.kept} of them from before" if outcome.kept else ""
    console = stdout_console()
    console.print(f"{done} of {len(table)} jobs done{earlier}")
    page = outcome.folder / "report.html"
    shown = page if page.exists() else outcome.folder / sweep.TABLE
    console.print(escape(shown_path(shown)), soft_wrap=True)
    return outcome.exit_code
