"""One figure over all jobs of a sweep: overshoot, settling time and number of estimations.

Up to three swept choices become x axis, colour and columns; what does not fit so becomes one point a job, by number.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, SymmetricalLogLocator

from dtbacklash.report.components.style import INK, MARKERS, MUTED, SERIES, new_figure, save, styled

PANELS = {
    "overshoot_pct_max": "largest\novershoot [%]",
    "settling_time_s_max": "longest\nsettling time [s]",
    "n_estimations": "estimations",
}
FAILED_COLOUR = "#b3261e"
MAX_SERIES, MAX_COLUMNS, MAX_NAMES = 16, 4, 12
DECADES = 50.0  # values that span this factor stand on a logarithmic axis
#: an axis reaches at least this far, so that next to nothing does not look like much
LEAST = {"overshoot_pct_max": 1.0, "settling_time_s_max": 0.1, "n_estimations": 1.0}
JOB, COLUMN, FAILED = "job", "_column", "_failed"


@dataclass(frozen=True)
class Swept:
    """Which swept choice goes where; ``column`` joins several choices if there are more than three."""

    x: str
    series: str | None
    column: str | None
    numeric: bool

    @property
    def joined(self) -> bool:
        """Whether a line between two jobs means something; between two seeds it does not."""
        return self.numeric and self.x != JOB and not self.x.endswith("seed")


def draw(table: pd.DataFrame, axes: list[str], path: Path) -> Path:
    """Draw the sweep and write the PNG to ``path``.

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
    table[FAILED], table[JOB] = table["status"] != "done", np.arange(1, len(table) + 1)
    layout = _layout(table, [name for name in axes if name in table])
    columns = _levels(table[layout.column]) if layout.column else [""]
    figure = new_figure(6.4, width=max(9.0, 3.6 * len(columns)))
    panels = figure.subplots(len(PANELS), len(columns), sharex=True, sharey="row", squeeze=False)
    for column, value in zip(panels.T, columns, strict=True):
        part = table[table[layout.column] == value] if layout.column else table
        for ax, name in zip(column, PANELS, strict=True):
            _panel(ax, part, table, layout, name)
        column[0].set_title(value.replace(", ", "\n"), fontsize=None if len(columns) < 3 else 10)
        column[-1].set_xlabel(layout.x)
    for ax, (name, label) in zip(panels[:, 0], PANELS.items(), strict=True):
        ax.set_ylabel(label)
        _scale(ax, table[name], LEAST[name])
    _legend(figure, table, layout)
    return figure


def _layout(table: pd.DataFrame, axes: list[str]) -> Swept:
    """x axis, colour and columns for the swept keys; where that would be unreadable, the job's number is the x axis."""
    levels = {name: table[name].astype(str).nunique() for name in axes}
    axes = [name for name in axes if levels[name] > 1] or axes[:1]
    numeric = [name for name in axes if levels[name] >= 3 and _is_numeric(table[name])]
    x = max(numeric or axes or [JOB], key=lambda name: levels.get(name, 0))
    rest = sorted((name for name in axes if name != x), key=lambda name: -levels[name])
    series, others = (rest[0], rest[1:]) if rest else (None, [])
    columns = table[others].astype(str).drop_duplicates().shape[0] if others else 1
    too_many = columns > MAX_COLUMNS or (series is not None and levels[series] > MAX_SERIES)
    if x == JOB or too_many or (x not in numeric and levels[x] > MAX_NAMES):
        return Swept(JOB, None, None, True)
    if others:
        table[COLUMN] = [", ".join(f"{k} = {_name(row[k])}" for k in others) for _, row in table.iterrows()]
    return Swept(x, series, COLUMN if others else None, x in numeric)


def _is_numeric(column: pd.Series) -> bool:
    return bool(pd.to_numeric(column, errors="coerce").notna().all()) and column.dtype != bool


def _name(value: object) -> str:
    """A choice as a label: numbers short, of a file only its name."""
    if isinstance(value, float):
        return f"{value:g}"
    return Path(str(value)).name if "/" in str(value) else str(value)


def _levels(column: pd.Series) -> list[str]:
    return list(dict.fromkeys(column.astype(str)))


def _panel(ax: Axes, part: pd.DataFrame, table: pd.DataFrame, layout: Swept, name: str) -> None:
    """One figure of merit over the x axis, a colour and marker a series."""
    names = _levels(table[layout.x])
    series = _levels(table[layout.series]) if layout.series else [""]
    for k, label in enumerate(series):
        rows = part[part[layout.series].astype(str) == label] if layout.series else part
        if layout.numeric:
            rows = rows.assign(_x=pd.to_numeric(rows[layout.x])).sort_values("_x")
            x = rows["_x"].to_numpy(dtype=float)
        else:
            x = np.array([names.index(v) for v in rows[layout.x].astype(str)]) + 0.5 * ((k + 0.5) / len(series) - 0.5)
        # on a common x equal values would hide each other: the first series is the largest
        share = (len(series) - 1 - k) / max(len(series) - 1, 1) if layout.numeric else 0.0
        _dots(ax, x, rows, name, k, "-" if layout.joined else "none", 7.5 * (1.0 + 0.8 * share))
    ax.margins(x=0.05)
    if layout.numeric:
        values = pd.to_numeric(table[layout.x])
        if layout.joined and values.min() > 0 and values.max() / values.min() >= DECADES:
            ax.set_xscale("log")
        else:
            ax.xaxis.set_major_locator(MaxNLocator(6, integer=bool((values % 1 == 0).all())))
        return
    ax.grid(False, axis="x")
    for group in range(0, len(names), 2):
        ax.axvspan(group - 0.5, group + 0.5, color=MUTED, alpha=0.10, lw=0)
    shown = [_name(name) for name in names]
    if sum(map(len, shown)) > 30:
        ax.set_xticks(range(len(names)), shown, rotation=35, ha="right", rotation_mode="anchor")
    else:
        ax.set_xticks(range(len(names)), shown)
    ax.tick_params(axis="x", length=0, pad=6)


def _marker(k: int) -> tuple[str, str]:
    return SERIES[k % len(SERIES)], MARKERS[(k + k // len(SERIES)) % len(MARKERS)]


def _dots(ax: Axes, x: np.ndarray, rows: pd.DataFrame, name: str, k: int, line: str, size: float) -> None:
    """The jobs of one series: a marker each; a cross at the foot: failed, an arrow on top: not settled."""
    (colour, marker), failed = _marker(k), rows[FAILED].to_numpy(dtype=bool)
    y = np.where(failed, np.nan, rows[name].to_numpy(dtype=float))
    ax.plot(x, y, marker, ls=line, lw=1.2, color=colour, ms=size, mec="white", mew=0.8, clip_on=False)
    edge = ax.get_xaxis_transform()  # x in data, y as a share of the panel's height
    ax.plot(x[failed], np.full(failed.sum(), 0.09), "x", color=FAILED_COLOUR, ms=9, mew=2.6, transform=edge)
    missing = np.isnan(y) & ~failed
    ax.plot(x[missing], np.full(missing.sum(), 0.93), "^", color="white", mec=colour, mew=1.8, ms=8, transform=edge)


def _scale(ax: Axes, values: pd.Series, least: float) -> None:
    """From zero; logarithmic above 1 where a few jobs would hide all others; whole numbers for counts."""
    top = float(np.nanmax([*values, least]))
    logarithmic = top > 100 and top > 15 * float(values.median())
    if logarithmic:
        ax.set_yscale("symlog", linthresh=1.0)
        ax.yaxis.set_major_locator(locator := SymmetricalLogLocator(base=10, linthresh=1.0))
        locator.set_params(numticks=4)
    else:
        ax.yaxis.set_major_locator(MaxNLocator(4, integer=values.name == "n_estimations"))
    # what is zero stands clear of the axis and of the labels below it
    ax.set_ylim(-0.3 if logarithmic else -0.06 * top, (4.0 if logarithmic else 1.18) * top)


def _legend(figure: Figure, table: pd.DataFrame, layout: Swept) -> None:
    """Series, and only those special marks that occur, above all panels."""
    series = _levels(table[layout.series]) if layout.series else []
    marks = [(label, *_marker(k)) for k, label in enumerate(series)]
    handles = [
        Line2D([], [], ls="none", marker=m, ms=8, color=colour, label=_name(label)) for label, colour, m in marks
    ]
    if table[FAILED].any():
        handles.append(Line2D([], [], ls="none", marker="x", ms=9, mew=2.6, color=FAILED_COLOUR, label="failed"))
    if (table[list(PANELS)].isna().any(axis=1) & ~table[FAILED]).any():
        handles.append(
            Line2D([], [], ls="none", marker="^", ms=8, mew=1.8, color="white", mec=INK, label="not settled")
        )
    if handles:
        columns = min(len(handles), 6)
        figure.legend(
            handles=handles, title=layout.series, handletextpad=0.3, loc="outside upper center", ncols=columns
        )
