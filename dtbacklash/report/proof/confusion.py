"""The confusion matrix of a proof as a picture: rows hidden, columns named."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.kinds import KINDS
from dtbacklash.prove.names import ELSEWHERE, EXTRA, FAILED, NOTHING, PARAMETERS, UNEXPLAINED
from dtbacklash.prove.rules import SENSOR
from dtbacklash.prove.score import Score
from dtbacklash.report.kit.style import MUTED, new_figure, styled

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
