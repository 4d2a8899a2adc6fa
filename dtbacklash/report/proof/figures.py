"""Figures of a proof: shares beside their bars, what is seen at which size, errors beside the oracle's."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.element_kinds import KINDS
from dtbacklash.prove.name_scores import (
    ELSEWHERE,
    EXTRA,
    FAILED,
    FAMILIES,
    NOTHING,
    PARAMETERS,
    UNEXPLAINED,
    error_ratio,
)
from dtbacklash.prove.rules import SENSOR
from dtbacklash.prove.score import RATIO_MAX, UNKNOWN, Bin, Score, Share
from dtbacklash.report.components.style import INK, MUTED, SERIES, label_decades, logarithmic, new_figure, styled
from dtbacklash.scoring.shares import wilson

PASS, MISS = "#00704f", "#b3261e"
#: a share of fewer things says little: it is drawn open
FEW = 5
KIND_COLOUR = {"single": SERIES[0], "several": SERIES[1]}


@styled
def shares_figure(score: Score) -> Figure:
    """Every share with its 95 % interval, the range of its bar behind it, and its count."""
    shares = score.figures
    figure = new_figure(0.9 + 0.42 * len(shares))
    ax = figure.subplots()
    for row, share in enumerate(reversed(shares)):
        _share(ax, row, share)
    ax.set_yticks(range(len(shares)), [_wrapped(s.what) for s in reversed(shares)])
    ax.set_ylim(-0.6, len(shares) - 0.4)
    ax.set_xlim(0.0, 100.0)
    ax.set_xlabel("share of cases or parameters [%]")
    ax.tick_params(axis="y", length=0, labelsize=10)
    ax.grid(False, axis="y")
    handles = [
        Line2D([], [], marker="o", color=PASS, label="meets its bar"),
        Line2D([], [], marker="o", color=MISS, label="misses it"),
        Line2D([], [], marker="o", color=INK, label="has no bar"),
        Patch(color=MUTED, alpha=0.25, label="the bar's range"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=4)
    return figure


def _wrapped(text: str, width: int = 44) -> str:
    return "\n".join(textwrap.wrap(text, width))


def _share(ax: Axes, row: int, share: Share) -> None:
    colour = INK if share.met is None else PASS if share.met else MISS
    if share.bar is not None:
        low, high = share.bar
        ax.barh(row, 100 * (high - low), left=100 * low, height=0.72, color=MUTED, alpha=0.25, lw=0)
    if share.of:
        low, high = share.interval
        ax.plot([100 * low, 100 * high], [row, row], color=colour, lw=2.2)
        ax.plot([100 * share.share], [row], "o", color=colour, ms=8, mec="white", clip_on=False, zorder=3)
    text = f"{share.right}/{share.of}" if share.of else "none"
    ax.text(1.022, row, text, transform=ax.get_yaxis_transform(), va="center", fontsize=10, color=INK)


def centre(b: Bin) -> float:
    """Where a range of visibility is drawn: its geometric middle; of an open range, half a decade's."""
    low = b.low if b.low > 0.0 else b.high / math.sqrt(10.0)
    high = b.high if math.isfinite(b.high) else low * math.sqrt(10.0)
    return math.sqrt(low * high)


@styled
def visibility_figure(score: Score) -> Figure:
    """The share of hidden effects that are found against their size, for all and for each part of the rig."""
    every = score.bins_of()
    present = [f for f in [*FAMILIES, UNKNOWN] if any(b.family == f for b in score.bins)]
    rows = 1 + math.ceil(len(present) / 2)
    figure = new_figure(0.7 + 2.5 * rows)
    grid = figure.add_gridspec(rows, 2)
    top = figure.add_subplot(grid[0, 0])
    _detection(top, every, "all effects of the catalogue")
    coverage = figure.add_subplot(grid[0, 1], sharex=top)
    _coverage(coverage, every)
    for j, name in enumerate(present):
        ax = figure.add_subplot(grid[1 + j // 2, j % 2], sharex=top)
        title = "unknown physics: admitted or located" if name == UNKNOWN else f"at the {name}"
        _detection(ax, score.bins_of(name), title)
    logarithmic(top.xaxis, [centre(b) for b in score.bins])
    for ax in figure.axes:
        ax.set_ylim(-4, 104)
        ax.set_yticks([0, 50, 90, 100])
    for ax in figure.axes[-2:]:
        ax.set_xlabel("change of the signals / their noise (rms)")
    handles = [
        Line2D([], [], marker="o", color=SERIES[0], label="named exactly"),
        Line2D([], [], marker="s", ls="--", color=SERIES[1], label="named or in the stated ambiguity"),
        Line2D([], [], marker="o", ls="none", mfc="white", color=MUTED, label=f"fewer than {FEW}"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _detection(ax: Axes, bins: Sequence[Bin], title: str) -> None:
    """Found exactly, and within the stated ambiguity, with Wilson's band about the first."""
    ax.set_title(title, fontsize=11)
    ax.set_ylabel("found [%]")
    x = [centre(b) for b in bins]
    _curve(ax, x, [(b.within, b.of) for b in bins], SERIES[1], "s", "--")
    _curve(ax, x, [(b.exact, b.of) for b in bins], SERIES[0], "o", "-", [wilson(b.exact, b.of) for b in bins])


def _coverage(ax: Axes, bins: Sequence[Bin]) -> None:
    ax.set_title("95 % intervals of what was named exactly", fontsize=11)
    ax.set_ylabel("hold the truth [%]")
    ax.axhspan(90, 99, color=MUTED, alpha=0.25, lw=0)
    held = [b for b in bins if b.intervals]
    points = [(b.hold, b.intervals) for b in held]
    _curve(ax, [centre(b) for b in held], points, SERIES[2], "o", "-", [wilson(b.hold, b.intervals) for b in held])


def _curve(
    ax: Axes,
    x: Sequence[float],
    points: Sequence[tuple[int, int]],
    colour: str,
    marker: str,
    line: str,
    band: Sequence[tuple[float, float]] = (),
) -> None:
    """Shares, given as (right, of), in percent; with their intervals as a band where there are any."""
    if not points:
        return
    y = [100 * right / of for right, of in points]
    if band:
        limits = 100 * np.array(band)
        ax.fill_between(x, limits[:, 0], limits[:, 1], color=colour, alpha=0.15, lw=0)
    ax.plot(x, y, line, color=colour, lw=1.6)
    for xi, yi, (_, of) in zip(x, y, points, strict=True):
        face = "white" if of < FEW else colour
        ax.plot([xi], [yi], marker, color=colour, mfc=face, ms=6.5, mew=1.4, clip_on=False, zorder=3)


@styled
def errors_figure(rows: pd.DataFrame) -> Figure:
    """Held-out errors beside the oracle's, and their ratio against the size of what was hidden.

    ``rows`` : the table of ``score.csv``.
    """
    shown = rows[rows["kind"].isin(list(KIND_COLOUR)) & rows["held_out_oracle"].notna()]
    figure = new_figure(4.8)
    left, right = figure.subplots(1, 2)
    oracle = shown["held_out_oracle"].astype(float)
    models = {"nominal": ("nominal", MUTED, 4), "recalibrated": ("recalibrated", SERIES[3], 4),
              "extended": ("diagnosed", SERIES[0], 5)}  # fmt: skip
    for model, (words, colour, size) in models.items():
        losses = shown[f"held_out_{model}"].astype(float)
        left.plot(oracle, losses, "o", color=colour, ms=size, alpha=0.7, mew=0, label=words)
    logarithmic(left.xaxis, oracle)
    logarithmic(left.yaxis, shown[[f"held_out_{model}" for model in models]].to_numpy(dtype=float).ravel())
    ends = [0.9, max(1.2 * float(oracle.max()), 10.0) if len(oracle) else 10.0]
    left.plot(ends, ends, color=INK, lw=1.0)
    left.set_xlabel("oracle's held-out error [noise floors]")
    left.set_ylabel("held-out error [noise floors]")
    _above(left, *left.get_legend_handles_labels())
    _ratios(right, shown)
    return figure


def _above(ax: Axes, handles: Sequence[Artist], labels: Sequence[str]) -> None:
    """A legend above a panel, in two columns."""
    ax.legend(
        handles, labels, loc="lower left", bbox_to_anchor=(0.0, 1.02), ncols=2, handletextpad=0.3, columnspacing=1
    )


def _ratios(ax: Axes, shown: pd.DataFrame) -> None:
    ratio = error_ratio(shown)
    for kind, colour in KIND_COLOUR.items():
        for clear in (True, False):
            mask = (shown["kind"] == kind) & (shown["clear"].astype(bool) == clear)
            label = {"single": "one effect", "several": "two or three"}[kind] if clear else None
            ax.plot(shown.loc[mask, "visibility_min"].astype(float), ratio[mask], "o", color=colour, label=label,
                    mfc=colour if clear else "white", ms=5, alpha=0.8)  # fmt: skip
    ax.axhline(RATIO_MAX, color=MISS, lw=1.2, ls="--")
    logarithmic(ax.xaxis, shown["visibility_min"].to_numpy(dtype=float))
    ax.set_yscale("log")
    top = float(ratio.replace(np.inf, np.nan).max()) if len(ratio) else 1.0
    low, high = 0.85 * min(0.9, float(ratio.min()) if len(ratio) else 0.9), 1.15 * max(2.0, top if top > 0 else 2.0)
    ax.set_ylim(low, high)
    label_decades(ax.yaxis, low, high)
    ax.set_xlabel("smallest change of the signals / their noise")
    ax.set_ylabel("held-out error / oracle's")
    handles, labels = ax.get_legend_handles_labels()
    handles.append(Line2D([], [], ls="none", marker="o", mfc="white", color=MUTED, ms=5))
    handles.append(Line2D([], [], ls="--", color=MISS, lw=1.2))
    labels += ["not clear to the oracle", f"bar: {RATIO_MAX}"]
    _above(ax, handles, labels)


WORDS = (NOTHING, PARAMETERS, UNEXPLAINED, EXTRA, FAILED)
RIGHT, STATED, WRONG = "#0072b2", "#b7a25c", "#d55e00"
#: the order of the kinds of place along both axes: that of the power flow
ORDER = (*KINDS, SENSOR)


def _order(labels: set[str], last: tuple[str, ...]) -> list[str]:
    effects = [effect for _, effect in CATALOGUE]

    def place(label: str) -> tuple[int, int, str]:
        kind, _, effect = label.partition(" ")
        return (
            ORDER.index(kind) if kind in ORDER else len(ORDER),
            effects.index(effect) if effect in effects else len(effects),
            label,
        )

    return sorted(labels - set(last), key=place) + [word for word in last if word in labels]


@styled
def confusion_figure(score: Score) -> Figure:
    """Counts of hidden against named; blue is right, sand is within what the tool stated, orange is wrong."""
    cells = score.by_kind()
    effects = {label for pair in cells for label in pair if " " in label and label not in (ELSEWHERE, EXTRA)}
    rows = _order(effects | {r for r, _ in cells}, WORDS)
    columns = _order(effects | {c for _, c in cells}, (ELSEWHERE, *WORDS))
    side = 0.27
    figure = new_figure(3.0 + side * len(rows), width=max(9.0, 3.6 + side * len(columns)))
    ax = figure.subplots()
    for (row, column), (count, within) in cells.items():
        colour = _colour(row, column, count, within)
        i, j = rows.index(row), columns.index(column)
        ax.add_patch(_square(j, i, colour))
        ax.text(j, i, str(count), ha="center", va="center", fontsize=9, color="white")
    for k, label in enumerate(rows):
        if label in columns:
            ax.add_patch(_frame(columns.index(label), k))
    ax.set_xlim(-0.5, len(columns) - 0.5)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xticks(range(len(columns)), [_label(c) for c in columns], rotation=90, fontsize=9)
    ax.set_yticks(range(len(rows)), [_label(r) for r in rows], fontsize=9)
    ax.set_xticks(np.arange(-0.5, len(columns)), minor=True)
    ax.set_yticks(np.arange(-0.5, len(rows)), minor=True)
    ax.grid(False)
    ax.grid(True, which="minor")
    ax.tick_params(which="both", length=0)
    ax.set_xlabel("named")
    ax.set_ylabel("hidden")
    handles = [
        Patch(color=RIGHT, label="right"),
        Patch(color=STATED, label="in the stated ambiguity, or unknown physics located"),
        Patch(color=WRONG, label="wrong or missed"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=3)
    return figure


def _label(name: str) -> str:
    if name in (*WORDS, ELSEWHERE):
        return name
    kind, _, effect = name.partition(" ")
    return f"{kind}: {effect}".replace("_", " ")


def _colour(row: str, column: str, count: int, within: int) -> str:
    """Of a cell; where it holds both, what is wrong is not hidden by what is not."""
    silent = {(NOTHING, NOTHING), (NOTHING, PARAMETERS), (PARAMETERS, PARAMETERS), (PARAMETERS, NOTHING),
              (UNEXPLAINED, UNEXPLAINED)}  # fmt: skip
    if (row, column) in silent or (row == column and row not in WORDS):
        return RIGHT
    return STATED if within == count else WRONG


def _square(x: int, y: int, colour: str) -> Rectangle:
    return Rectangle((x - 0.5, y - 0.5), 1.0, 1.0, facecolor=colour, edgecolor="white", lw=0.8)


def _frame(x: int, y: int) -> Rectangle:
    return Rectangle((x - 0.5, y - 0.5), 1.0, 1.0, facecolor="none", edgecolor=MUTED, lw=0.8, zorder=3)
