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
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from dtbacklash.report.numbers import fixed, number
from dtbacklash.report.sweep_figure import failed_jobs

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


def _table(title: str) -> Table:
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


def _fill(table: Table, frame: pd.DataFrame, columns: list[tuple[str, str, Cell, bool]]) -> Table:
    """Add the columns (name, heading, format, right-aligned) that the frame has, and its rows."""
    used = [column for column in columns if column[0] in frame]
    for _, heading, _, right in used:
        # Text, not str: rich would read "[s]" and "[0, 180]" as markup
        table.add_column(Text(heading), justify="right" if right else "left", overflow="fold")
    for row in frame[[column[0] for column in used]].itertuples(index=False):
        table.add_row(*(Text(cell(value)) for (_, _, cell, _), value in zip(used, row, strict=True)))
    return table


def _decimals(count: int, missing: str = "-") -> Cell:
    return lambda value: fixed(value, count, missing)


def _plain(value: Any) -> str:
    return number(value, 4)


def moves(frame: pd.DataFrame) -> Table:
    """The table of moves, `metrics.move_table`."""
    return _fill(_table("Moves of the reference"), frame, [
        ("move", "move", _plain, True), ("t_s", "at [s]", _decimals(1), True),
        ("from_mm", "from [mm]", _decimals(2), True), ("to_mm", "to [mm]", _decimals(2), True),
        ("overshoot_pct", "overshoot [%]", _decimals(2), True),
        ("settling_time_s", "settling time [s]", _decimals(3, "not settled"), True),
        ("peak_voltage_v", "peak [V]", _decimals(2), True),
    ])  # fmt: skip


def estimates(frame: pd.DataFrame) -> Table:
    """The table of estimations, with the reason of each that was rejected."""
    return _fill(_table("Estimates of the twin"), frame, [
        ("t_event_s", "event [s]", _decimals(2), True), ("t_applied_s", "applied [s]", _decimals(2), True),
        ("gap_deg", "gap [deg]", _decimals(2), True), ("true_gap_deg", "true [deg]", _decimals(2), True),
        ("accepted", "accepted", _plain, False), ("reason", "reason", _plain, False),
    ])  # fmt: skip


def sweep(frame: pd.DataFrame, axes: list[str]) -> Table:
    """The jobs of a sweep: the swept keys `axes`, then what came out; below it the errors of failed jobs."""
    failed = failed_jobs(frame)
    shown = frame.assign(outcome=["FAILED" if bad else "ok" for bad in failed])
    table = _fill(_table("Sweep"), shown, [
        ("job", "job", _plain, True), *((name, name, _plain, False) for name in axes),
        ("overshoot_pct_max", "over-\nshoot [%]", _decimals(2), True),
        ("settling_time_s_max", "settling\ntime [s]", _decimals(3), True),
        ("peak_voltage_v", "peak\n[V]", _decimals(1), True),
        ("n_estimations", "esti-\nmates", _decimals(0), True), ("outcome", "", _plain, False),
    ])  # fmt: skip
    if failed.any() and "error" in frame:
        names = frame["job"] if "job" in frame else pd.Series(frame.index, index=frame.index)
        table.caption = _notes(f"job {names[i]}: {frame['error'][i]}" for i in frame.index[failed])
    return table


def claims(frame: pd.DataFrame) -> Table:
    """The claims of the paper beside what this program finds; below it the reasons of those that fail."""
    shown = frame.assign(result=["pass" if passed else "FAIL" for passed in frame["pass"]])
    table = _fill(_table("Claims of the paper"), shown, [
        ("result", "", _plain, False),
        ("section", "section", _plain, False), ("claim", "claim", _plain, False),
        ("paper", "paper", _plain, True), ("ours", "ours", _plain, True),
        ("tolerance", "tolerance", _plain, True),
    ])  # fmt: skip
    bad = frame[~frame["pass"].astype(bool)]
    if len(bad) and "reason" in bad:
        pairs = zip(bad["claim"], bad["reason"], strict=True)
        table.caption = _notes(f"FAIL {claim}: {reason}" for claim, reason in pairs)
    return table


def fit(errors: dict[str, Any]) -> Table:
    """The errors of the models on the data they were fitted to and on held-out data.

    Args:
        errors: ``metric``, ``train`` and ``held_out`` (model -> error or None), ``noise_floor``.
    """
    nrmse = errors.get("metric") == "nrmse"
    percent: Cell = lambda value: f"{number(100 * value)} %" if nrmse and not pd.isna(value) else number(value)  # noqa: E731
    rows = [
        {"data": words, **errors[part], "noise_floor": errors.get("noise_floor")}
        for part, words in (("train", "fitted to"), ("held_out", "held out"))
    ]
    frame = pd.DataFrame(rows).dropna(axis=1, how="all")
    return _fill(_table("Error of the models" + (" (normalised rms)" if nrmse else "")), frame, [
        ("data", "data", _plain, False),
        ("nominal", "nominal", percent, True), ("recalibrated", "recalibrated", percent, True),
        ("extended", "extended", percent, True), ("noise_floor", "noise floor", percent, True),
    ])  # fmt: skip


def proof(score: Any) -> Table:
    """The shares of a proof with their bars, and the errors and times below.

    Args:
        score: a `dtbacklash.prove.score.Score`.
    """
    from dtbacklash.prove.table import figure_row, quantity_row

    names = ("figure", "share", "count", "interval", "bar", "met", "all")
    frame = pd.DataFrame([dict(zip(names, figure_row(f), strict=True)) for f in score.figures])
    table = _fill(_table("Blind proof"), frame.replace("**miss**", "MISS"), [
        ("figure", "figure", _plain, False), ("share", "share", _plain, True), ("count", "count", _plain, True),
        ("interval", "95 % interval", _plain, True), ("bar", "bar", _plain, True), ("met", "", _plain, False),
        ("all", "all sizes", _plain, True),
    ])  # fmt: skip
    lines = []
    for q in score.quantities:
        what, median, ninety, unit, of, bar, met = quantity_row(q)
        judged = f"; {bar}: {met}".replace("**miss**", "MISS") if bar else ""
        lines.append(" ".join(f"{what}: median {median}, 90 % {ninety} {unit}".split()) + f" ({of} cases{judged})")
    table.caption = _notes(lines)
    return table


def _notes(lines: Iterable[str]) -> Text:
    """Lines below a table."""
    return Text("\n" + "\n".join(lines))
