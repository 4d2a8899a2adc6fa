"""One figure over all jobs of a sweep: overshoot, settling time and number of estimations.

Up to three swept choices become x axis, colour and columns; what does not fit so becomes one line a job.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis, YAxis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from dtbacklash.report.kit.style import INK, MARKERS, MUTED, SERIES, line_up, new_figure, save, styled

PANELS = {
    "overshoot_pct_max": "largest\novershoot [%]",
    "settling_time_s_max": "longest\nsettling time [s]",
    "n_estimations": "estimations",
}
FAILED_COLOUR = "#b3261e"
MAX_SERIES, MAX_COLUMNS, MAX_LINES = 16, 4, 150
CHARACTER = 0.1  # inch, of a tick's label
DECADES = 50.0  # values that span this factor stand on a logarithmic axis
MARKER = 7.5
#: an axis reaches at least this far, so that next to nothing does not look like much
LEAST = {"overshoot_pct_max": 1.0, "settling_time_s_max": 0.1, "n_estimations": 1.0}


@dataclass(frozen=True)
class Layout:
    """Which swept choice goes where; `column` joins several choices if there are more than three."""

    x: str
    series: str | None
    column: str | None
    numeric: bool


def draw(table: pd.DataFrame, axes: list[str], path: Path) -> Path:
    """Draw the sweep and write the PNG to `path`.

    Args:
        table: one row a job. Columns: the swept keys, `overshoot_pct_max`, `settling_time_s_max` (NaN: not
            settled), `n_estimations`, and `status` (what is not "done" has failed).
        axes: names of the swept keys, in the order to be read; may be empty.
        path: PNG to write.
    """
    return save(sweep_figure(table, axes), path)


@styled
def sweep_figure(table: pd.DataFrame, axes: list[str]) -> Figure:
    """The figure that `draw` writes; arguments as there."""
    table = table.reset_index(drop=True).copy()
    for name in PANELS:
        table[name] = pd.to_numeric(table[name], errors="coerce").astype(float) if name in table else np.nan
    table["_failed"] = table["status"] != "done"
    axes = [name for name in axes if name in table]
    varying = [name for name in axes if table[name].astype(str).nunique() > 1] or axes[:1]
    layout = _layout(table, varying) if varying else None
    if layout is None:
        return _one_line_a_job(table, varying)
    return _grid(table, layout)


def _layout(table: pd.DataFrame, axes: list[str]) -> Layout | None:
    """x axis, colour and columns for the swept keys, or None if that would be unreadable."""
    levels = {name: table[name].astype(str).nunique() for name in axes}
    numeric = [name for name in axes if levels[name] >= 3 and _is_numeric(table[name])]
    x = max(numeric or axes, key=lambda name: levels[name])
    rest = sorted((name for name in axes if name != x), key=lambda name: -levels[name])
    series, others = (rest[0], rest[1:]) if rest else (None, [])
    columns = table[others].astype(str).drop_duplicates().shape[0] if others else 1
    too_many = columns > MAX_COLUMNS or (series is not None and levels[series] > MAX_SERIES)
    if too_many or (x not in numeric and levels[x] > 12):
        return None
    if others:
        joined = [", ".join(f"{k} = {_name(row[k])}" for k in others) for _, row in table.iterrows()]
        table["_column"] = joined
    return Layout(x, series, "_column" if others else None, x in numeric)


def _is_numeric(column: pd.Series) -> bool:
    return bool(pd.to_numeric(column, errors="coerce").notna().all()) and column.dtype != bool


def _name(value: object) -> str:
    """A choice as a label: numbers short, of a file only its name."""
    if isinstance(value, float):
        return f"{value:g}"
    return Path(str(value)).name if "/" in str(value) else str(value)


def _grid(table: pd.DataFrame, layout: Layout) -> Figure:
    """A row of panels for each figure of merit, a column for each value of `layout.column`."""
    columns = list(dict.fromkeys(table[layout.column])) if layout.column else [None]
    figure = new_figure(6.4, width=max(9.0, 3.6 * len(columns)))
    panels = figure.subplots(len(PANELS), len(columns), sharex=True, sharey="row", squeeze=False)
    for j, value in enumerate(columns):
        part = table if value is None else table[table[layout.column] == value]
        for i, name in enumerate(PANELS):
            _panel(panels[i, j], part, table, layout, name)
        if value is not None:
            panels[0, j].set_title(value.replace(", ", "\n"), fontsize=None if len(columns) < 3 else 10)
        panels[-1, j].set_xlabel(layout.x)
    for i, (name, label) in enumerate(PANELS.items()):
        panels[i, 0].set_ylabel(label)
        _scale_values(panels[i, 0].yaxis, table[name])
    line_up(list(panels[:, 0]))
    _legend(figure, table, layout)
    return figure


def _panel(ax: Axes, part: pd.DataFrame, table: pd.DataFrame, layout: Layout, name: str) -> None:
    """One figure of merit over the x axis, a colour and marker a series."""
    names = _levels(table[layout.x])
    series = _levels(table[layout.series]) if layout.series else [""]
    for k, label in enumerate(series):
        rows = part[part[layout.series].astype(str) == label] if layout.series else part
        if layout.numeric:
            rows = rows.assign(_x=pd.to_numeric(rows[layout.x])).sort_values("_x")
            x = rows["_x"].to_numpy(dtype=float)
        else:
            shift = 0.5 * ((k + 0.5) / len(series) - 0.5)
            x = np.array([names.index(v) + shift for v in rows[layout.x].astype(str)], dtype=float)
        # a line between two seeds would mean nothing
        joined = layout.numeric and not layout.x.endswith("seed")
        # on a common x equal values would hide each other: the first series is the largest
        share = (len(series) - 1 - k) / max(len(series) - 1, 1) if layout.numeric else 0.0
        size = MARKER * (1.0 + 0.8 * share)
        _dots(ax, x, rows, name, k, joined=joined, size=size)
    if layout.numeric:
        values = sorted({float(value) for value in pd.to_numeric(table[layout.x])})
        _value_ticks(ax, values, joined=not layout.x.endswith("seed"))
    else:
        _category_ticks(ax, names)


def _width(ax: Axes) -> float:
    """Width of a panel, in inch, before the layout is made: a row of equal panels beside the labels."""
    grid, figure = ax.get_gridspec(), ax.get_figure(root=True)
    assert grid is not None
    assert figure is not None
    return (float(figure.get_size_inches()[0]) - 1.2) / grid.ncols - 0.2


def _category_ticks(ax: Axes, names: list[str]) -> None:
    """A grey stripe behind every other category, and their names: broken at underscores, else slanted."""
    ax.grid(False, axis="x")
    for group in range(0, len(names), 2):
        ax.axvspan(group - 0.5, group + 0.5, color=MUTED, alpha=0.10, lw=0)
    ax.set_xlim(-0.5, len(names) - 0.5)
    room = int(_width(ax) / len(names) / CHARACTER)
    labels = [_broken(_name(name), room) for name in names]
    if max(len(line) for label in labels for line in label.split("\n")) <= room:
        ax.set_xticks(range(len(names)), labels)
    else:
        shown = [_name(name) for name in names]
        ax.set_xticks(range(len(names)), shown, rotation=35, ha="right", rotation_mode="anchor")
    ax.tick_params(axis="x", length=0, pad=6)


def _broken(name: str, room: int) -> str:
    """A name in lines of at most ``room`` characters, broken after underscores where it can be."""
    lines = [""]
    for part in re.findall(r"[^_]*_|[^_]+", name):
        if lines[-1] and len(lines[-1]) + len(part) > room:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def _value_ticks(ax: Axes, values: list[float], *, joined: bool) -> None:
    """Ticks at the swept values, as many as have room; logarithmic where they span decades."""
    logarithmic = joined and values[0] > 0 and values[-1] / values[0] >= DECADES
    if logarithmic:
        ax.set_xscale("log")
    place = np.log10(values) if logarithmic else np.asarray(values, dtype=float)
    place = (place - place[0]) / max(place[-1] - place[0], 1e-300) * 0.9 * _width(ax)
    kept: list[int] = []
    for k in range(len(values)):
        half = 0.5 * CHARACTER * (len(f"{values[k]:g}") + 2)
        if not kept or place[k] - half > place[kept[-1]] + 0.5 * CHARACTER * len(f"{values[kept[-1]]:g}"):
            kept.append(k)
    ax.set_xticks([values[k] for k in kept], [f"{values[k]:g}" for k in kept])
    ax.xaxis.set_minor_locator(NullLocator())
    ax.margins(x=0.05)


def _levels(column: pd.Series) -> list[str]:
    return list(dict.fromkeys(column.astype(str)))


def _dots(ax: Axes, x: np.ndarray, rows: pd.DataFrame, name: str, k: int, *, joined: bool, size: float) -> None:
    """The jobs of one series: a marker each; a cross at the foot: failed, an arrow on top: not settled."""
    colour, marker = SERIES[k % len(SERIES)], MARKERS[(k + k // len(SERIES)) % len(MARKERS)]
    y, failed = rows[name].to_numpy(dtype=float), rows["_failed"].to_numpy(dtype=bool)
    y = np.where(failed, np.nan, y)
    ax.plot(
        x, y, marker, ls="-" if joined else "none", lw=1.2, color=colour, ms=size, mec="white", mew=0.8, clip_on=False
    )
    edge = ax.get_xaxis_transform()  # x in data, y as a share of the panel's height
    ax.plot(x[failed], np.full(failed.sum(), 0.09), "x", color=FAILED_COLOUR, ms=9, mew=2.6, transform=edge)
    missing = np.isnan(y) & ~failed
    ax.plot(x[missing], np.full(missing.sum(), 0.93), "^", color="white", mec=colour, mew=1.8, ms=8, transform=edge)


def _scale_values(axis: Axis, values: pd.Series) -> None:
    """From zero; logarithmic above 1 where a few jobs would hide all others; whole numbers for counts."""
    top = max(float(values.max()) if values.notna().any() else 1.0, LEAST.get(str(values.name), 0.0))
    logarithmic = top > 100 and top > 15 * float(values.median())
    set_scale, set_limits = (
        (axis.axes.set_yscale, axis.axes.set_ylim)
        if isinstance(axis, YAxis)
        else (axis.axes.set_xscale, axis.axes.set_xlim)
    )
    if logarithmic:
        set_scale("symlog", linthresh=1.0)
        decades = math.ceil(math.log10(top))
        step = math.ceil(decades / (3 if isinstance(axis, YAxis) else 2))
        axis.set_major_locator(
            FixedLocator([0.0, *(10.0**k for k in range(0 if step == 1 else step, decades + 1, step))])
        )
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(_power if decades > 4 else lambda value, _: f"{value:g}"))
    elif values.name == "n_estimations":
        axis.set_major_locator(MaxNLocator(4, integer=True))
    else:
        axis.set_major_locator(MaxNLocator(4))
    # what is zero stands clear of the axis and of the labels below it
    set_limits(-0.3 if logarithmic else -0.06 * top, (4.0 if logarithmic else 1.18) * top if top > 0 else 1.0)


def _power(value: float, _position: int) -> str:
    """0, 1, 10 or a power of ten."""
    return f"{value:g}" if value < 100 else f"$10^{{{round(math.log10(value))}}}$"


def _legend(figure: Figure, table: pd.DataFrame, layout: Layout) -> None:
    """Series, and only those special marks that occur, above all panels."""
    handles = []
    series = _levels(table[layout.series]) if layout.series else []
    for k, label in enumerate(series):
        marker = MARKERS[(k + k // len(SERIES)) % len(MARKERS)]
        handles.append(
            Line2D([], [], ls="none", marker=marker, ms=8, color=SERIES[k % len(SERIES)], label=_name(label))
        )
    handles += _special_handles(table)
    if handles:
        figure.legend(
            handles=handles,
            loc="outside upper center",
            ncols=min(len(handles), 6),
            title=layout.series,
            handletextpad=0.3,
        )


def _special_handles(table: pd.DataFrame) -> list[Line2D]:
    handles = []
    if table["_failed"].any():
        handles.append(Line2D([], [], ls="none", marker="x", ms=9, mew=2.6, color=FAILED_COLOUR, label="failed"))
    if (table[list(PANELS)].isna().any(axis=1) & ~table["_failed"]).any():
        handles.append(
            Line2D([], [], ls="none", marker="^", ms=8, mew=1.8, color="white", mec=INK, label="not settled")
        )
    return handles


def _one_line_a_job(table: pd.DataFrame, axes: list[str]) -> Figure:
    """All jobs below each other, labelled in full: for sweeps over many choices at once."""
    labels = [", ".join(_name(row[name]) for name in axes) or f"job {i}" for i, row in table.iterrows()]
    n = len(table)
    step = 0.26 if n <= 60 else 0.14
    figure = new_figure(1.8 + step * min(n, MAX_LINES))
    panels = figure.subplots(1, len(PANELS), sharey=True, squeeze=False)[0]
    rows = np.arange(n)
    for k, (ax, (name, label)) in enumerate(zip(panels, PANELS.items(), strict=True)):
        failed = table["_failed"].to_numpy(dtype=bool)
        y = np.where(failed, np.nan, table[name].to_numpy(dtype=float))
        ax.hlines(rows, 0, np.nan_to_num(y), color=MUTED, lw=1.0, alpha=0.6)
        ax.plot(y, rows, "o", color=SERIES[k], ms=6, clip_on=False)
        edge = ax.get_yaxis_transform()
        ax.plot(np.full(failed.sum(), 0.08), rows[failed], "x", color=FAILED_COLOUR, ms=8, mew=2.4, transform=edge)
        missing = np.isnan(y) & ~failed
        ax.plot(np.full(missing.sum(), 0.94), rows[missing], ">", color="white", mec=INK, mew=1.6, ms=7, transform=edge)
        ax.set_xlabel(label)
        _scale_values(ax.xaxis, pd.Series(y, name=name))
        ax.grid(False, axis="y")
    panels[0].set_ylim(n - 0.5, -0.5)
    every = -(-n // MAX_LINES)  # more lines than there is room for: a label now and then
    panels[0].set_yticks(rows[::every], labels[::every], fontsize=10 if step > 0.2 else 7)
    handles = _special_handles(table)
    title = ", ".join(axes)
    if handles or title:
        figure.legend(handles=handles, loc="outside upper left", ncols=4, title=title, alignment="left")
    return figure
