"""What a sweep tells: progress while it runs, one table and one figure at its end."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from dtbacklash.commands.console import announce_compilation, shown_path, stdout_console
from dtbacklash.runfolder import PARTIAL, hidden_sibling

if TYPE_CHECKING:
    from dtbacklash.sweep import Job

POLL_S = 0.25


@contextmanager
def watch(missing: list[Job], total: int) -> Iterator[None]:
    """Show on stderr how many jobs are done, by their status files, whoever runs them and wherever."""
    announce_compilation()
    console = Console(stderr=True)
    stop = threading.Event()
    kept = total - len(missing)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("jobs"),
        TimeElapsedColumn(),
    )
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    row = bar.add_task("sweep", total=total, completed=kept)

    def look() -> None:
        shown, last = -1, False
        while True:
            finished = kept + sum(1 for one in missing if one.status_file.exists())
            if finished != shown:
                bar.update(row, completed=finished)
                if not console.is_terminal:
                    print(f"{finished} of {total} jobs finished", file=sys.stderr, flush=True)
                shown = finished
            if last:
                return
            last = stop.wait(POLL_S)

    watcher = threading.Thread(target=look, daemon=True)
    with bar:
        watcher.start()
        try:
            yield
        finally:
            stop.set()
            watcher.join()  # it looks once more before it ends


def finish(folder: Path, jobs: list[Job], kept: int) -> int:
    """Write ``sweep.csv`` and ``sweep.png``, print the table; returns the exit code of the sweep."""
    from dtbacklash.report import sweep_figure

    entries = [one.status() or _refused(one) for one in jobs]
    table = gather(jobs, entries)
    scratch = hidden_sibling(folder / "sweep.csv", PARTIAL)
    table.to_csv(scratch, index=False)
    scratch.replace(folder / "sweep.csv")
    axes = list(jobs[0].choices)
    scratch = hidden_sibling(folder / "sweep", PARTIAL).with_suffix(".png")
    try:
        sweep_figure.draw(table, axes, scratch)
        scratch.replace(folder / "sweep.png")
    finally:
        scratch.unlink(missing_ok=True)
    _print(folder, table, axes, kept)
    failed = [entry for entry in entries if entry.get("status") != "done"]
    if not failed:
        return 0
    all_by_input = len(failed) == len(entries) and all(entry.get("by_input") for entry in failed)
    return 2 if all_by_input else 1


def gather(jobs: list[Job], entries: list[dict[str, Any]]) -> pd.DataFrame:
    """One row a job: its choices, its figures of merit, ``status`` (done or failed) and ``error``."""
    from dtbacklash.sweep import FIGURES_OF_MERIT

    rows = []
    for one, entry in zip(jobs, entries, strict=True):
        figures = entry.get("figures") or {}
        row: dict[str, Any] = dict(one.choices)
        row |= {name: figures.get(name) for name in FIGURES_OF_MERIT}
        rows.append(row | {"status": entry.get("status", "failed"), "error": entry.get("error", "")})
    table = pd.DataFrame(rows)
    for name in ("n_estimations", "n_accepted"):  # whole numbers, even where a job has none
        table[name] = table[name].astype("Int64")
    return table


def _refused(one: Job) -> dict[str, Any]:
    """The entry of a job that could not be set up, or of which nothing came back."""
    try:
        return dict(json.loads(one.status_file.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {"status": "failed", "error": "nothing came back from its worker", "by_input": False}


def _print(folder: Path, table: pd.DataFrame, axes: list[str], kept: int) -> None:
    from dtbacklash.report import tables

    console = stdout_console()
    tables.show(tables.sweep(table.drop(columns="error"), axes), "")
    for row in table[table["status"] != "done"].to_dict("records"):
        choices = ", ".join(f"{axis}={row[axis]}" for axis in axes)
        print(f"dtb: job {choices} failed: {row['error']}", file=sys.stderr)
    done = int((table["status"] == "done").sum())
    earlier = f", {kept} of them from before" if kept else ""
    console.print(f"{done} of {len(table)} jobs done{earlier}")
    console.print(escape(shown_path(folder / "sweep.csv")), soft_wrap=True)
