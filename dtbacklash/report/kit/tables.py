"""Tables for the terminal: at most 100 columns wide, plain text where no terminal is.

Each function returns a `rich.table.Table`; `show` prints it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from io import StringIO
from typing import Any, TextIO

import pandas as pd
from rich import box
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from dtbacklash.report.kit import blocks
from dtbacklash.report.kit.numbers import fixed, number

WIDTH = 100

Cell = Callable[[Any], str]


def show(*renderables: RenderableType, file: TextIO | None = None) -> None:
    """Print to `file` (default: stdout); at most 100 columns; what its encoding cannot say becomes "?"."""
    target = file or sys.stdout
    terminal = target.isatty()
    width = min(Console(file=target).width, WIDTH) if terminal else WIDTH
    buffer = StringIO()
    console = Console(file=buffer, width=width, force_terminal=terminal, highlight=False)
    for renderable in renderables:
        console.print(renderable)
    encoding = getattr(target, "encoding", None) or "utf-8"
    text = "\n".join(line.rstrip() for line in buffer.getvalue().splitlines())
    print(text.encode(encoding, "replace").decode(encoding), file=target)


def blank(title: str) -> Table:
    """A table of the house's look, without columns yet."""
    # ASCII lines: a log file and an old terminal show them as well
    return Table(
        title=title,
        title_justify="left",
        title_style="bold",
        header_style="bold",
        box=box.ASCII2,
        show_edge=False,
        pad_edge=False,
        caption_justify="left",
        caption_style="none",
    )


def fill(table: Table, frame: pd.DataFrame, columns: list[tuple[str, str, Cell, bool]]) -> Table:
    """Add the columns (name, heading, format, right-aligned) that the frame has, and its rows."""
    used = [column for column in columns if column[0] in frame]
    for _, heading, _, right in used:
        # Text, not str: rich would read "[s]" and "[0, 180]" as markup
        table.add_column(Text(heading), justify="right" if right else "left", overflow="fold")
    for row in frame[[column[0] for column in used]].itertuples(index=False):
        table.add_row(*(Text(cell(value)) for (_, _, cell, _), value in zip(used, row, strict=True)))
    return table


def decimals(count: int, missing: str = "-") -> Cell:
    """A format with a fixed count of decimals."""
    return lambda value: fixed(value, count, missing)


def plain_cell(value: Any) -> str:
    """A number with four digits, or a text as it is."""
    return number(value, 4, plain=True)


def moves(frame: pd.DataFrame) -> Table:
    """The table of moves, `metrics.move_table`."""
    return fill(blank("Moves of the reference"), frame, [
        ("move", "move", plain_cell, True), ("t_s", "at [s]", decimals(1), True),
        ("from_mm", "from [mm]", decimals(2), True), ("to_mm", "to [mm]", decimals(2), True),
        ("overshoot_pct", "overshoot [%]", decimals(2), True),
        ("settling_time_s", "settling time [s]", decimals(3, "not settled"), True),
        ("peak_voltage_v", "peak [V]", decimals(2), True),
    ])  # fmt: skip


def estimates(frame: pd.DataFrame) -> Table:
    """The table of estimations, with the reason of each that was rejected."""
    return fill(blank("Estimates of the twin"), frame, [
        ("t_event_s", "event [s]", decimals(2), True), ("t_applied_s", "applied [s]", decimals(2), True),
        ("gap_deg", "gap [deg]", decimals(2), True), ("true_gap_deg", "true [deg]", decimals(2), True),
        ("accepted", "accepted", plain_cell, False), ("reason", "reason", plain_cell, False),
        ("subsystem", "subsystem", plain_cell, False),
    ])  # fmt: skip


def beliefs(frame: pd.DataFrame) -> Table:
    """The table of a loop that was closed, `dtbacklash.closing.COLUMNS`."""
    return fill(blank("The loop with each belief"), frame, [
        ("belief", "belief", plain_cell, False), ("overshoot_pct", "overshoot [%]", decimals(2), True),
        ("settling_time_s", "settling time [s]", decimals(3, "not settled"), True),
        ("estimations", "estimations", plain_cell, True), ("accepted", "accepted", plain_cell, True),
        ("largest_gap_error_deg", "largest gap error [deg]", decimals(2), True),
    ])  # fmt: skip


def sweep(frame: pd.DataFrame, axes: list[str]) -> Table:
    """The jobs of a sweep: the swept keys `axes`, then what came out; below it the errors of failed jobs."""
    failed = frame["status"] != "done"
    shown = frame.assign(outcome=["FAILED" if bad else "ok" for bad in failed])
    figures: list[tuple[str, str, Cell, bool]] = [
        ("overshoot_pct_max", "over-\nshoot [%]", decimals(2), True),
        ("settling_time_s_max", "settling\ntime [s]", decimals(3), True),
        ("peak_voltage_v", "peak\n[V]", decimals(1), True),
        ("n_estimations", "esti-\nmates", decimals(0), True),
    ]
    if not any(name in frame for name, *_ in figures):  # of another command than `dtb run`
        others = [str(name) for name in frame if name not in {"folder", *axes, "status", "error"}]
        figures = [(name, name.replace("_", "\n"), plain_cell, True) for name in others]
    table = fill(blank("Sweep"), shown, [
        *((name, name, plain_cell, False) for name in axes), *figures, ("outcome", "", plain_cell, False),
    ])  # fmt: skip
    if failed.any() and "error" in frame:
        table.caption = notes(f"job {i}: {frame['error'][i]}" for i in frame.index[failed])
    return table


def claims(frame: pd.DataFrame) -> Table:
    """The claims of the paper beside what this program finds; below it the reasons of those that fail."""
    shown = frame.assign(result=["pass" if passed else "FAIL" for passed in frame["pass"]])
    table = fill(blank("Claims of the paper"), shown, [
        ("result", "", plain_cell, False),
        ("section", "section", plain_cell, False), ("claim", "claim", plain_cell, False),
        ("paper", "paper", plain_cell, True), ("ours", "ours", plain_cell, True),
        ("tolerance", "tolerance", plain_cell, True),
    ])  # fmt: skip
    bad = frame[~frame["pass"].astype(bool)]
    if len(bad):
        pairs = zip(bad["claim"], bad["reason"], strict=True)
        table.caption = notes(f"FAIL {claim}: {reason}" for claim, reason in pairs)
    return table


def of(block: blocks.Table) -> Group:
    """A block's table for the terminal, below its title."""
    table = blank("")
    for head in block.heads:
        right = head.endswith("#")
        table.add_column(Text(head.removesuffix("#")), justify="right" if right else "left", overflow="fold")
    for row in block.rows:
        table.add_row(*(Text(str(cell).replace("`", "")) for cell in row))
    return Group(Text(block.title, style="bold"), table)


def notes(lines: Iterable[str]) -> Text:
    """Lines below a table."""
    return Text("\n" + "\n".join(lines))
