"""One figure of what each belief makes of the loop: the largest overshoot, and the move at which the nominal one errs
most."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dtbacklash.experiment.run import RunResult
from dtbacklash.report.kit.numbers import number
from dtbacklash.report.kit.style import COLOUR, INK, MUTED, SERIES, new_figure, styled

#: what the right-hand panel shows, each in its colour
DRAWN = {"nominal": SERIES[1], "both": SERIES[0], "truth": INK}
#: from this long before a move to this long after it, s
BEFORE_S, AFTER_S = 0.3, 4.0


@styled
def beliefs_figure(table: pd.DataFrame, runs: dict[str, RunResult | None]) -> Figure:
    """``table`` : columns as of :data:`dtbacklash.closing.COLUMNS`. runs : belief -> its run, None if it diverged."""
    figure = new_figure(4.2)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    _bars(left, table)
    _moves(right, runs)
    return figure


def _bars(ax: Axes, table: pd.DataFrame) -> None:
    """The largest overshoot of each belief, from above."""
    finite = [v for v in table["overshoot_pct"] if math.isfinite(v)]
    most = max([*finite, 1.0])
    for j, (name, value) in enumerate(zip(table["belief"], table["overshoot_pct"], strict=True)):
        stands = math.isfinite(value)
        ax.barh(j, value if stands else most, color=DRAWN.get(name, MUTED), height=0.62, alpha=1.0 if stands else 0.3)
        ax.annotate(
            f"{number(value, 3)} %" if stands else "diverged", (value if stands else most, j), (4, 0),
            textcoords="offset points", va="center", fontsize=11, color=INK,
        )  # fmt: skip
    ax.set_yticks(range(len(table)), list(table["belief"]))
    ax.invert_yaxis()
    ax.set_xlim(0.0, 1.35 * most)
    ax.set_xlabel("largest overshoot [%]")
    ax.set_title("What is believed of the machine")
    ax.grid(visible=False, axis="y")


def _moves(ax: Axes, runs: dict[str, RunResult | None]) -> None:
    """The output at the move with the largest overshoot of the nominal belief; where that diverged, of the next one."""
    shown = {name: run for name, run in runs.items() if name in DRAWN and run is not None}
    if not shown:
        return
    worst_of = next(iter(shown))
    moves = shown[worst_of].moves
    worst = moves.iloc[int(moves["overshoot_pct"].to_numpy().argmax())]
    for name, run in shown.items():
        t_s = run.t_s - worst["t_s"]
        part = (t_s > -BEFORE_S) & (t_s < AFTER_S)
        if name == worst_of:
            ax.plot(t_s[part], run.trace["r_mm"].to_numpy()[part], color=COLOUR["reference"], lw=1.0, ls="--")
        ax.plot(
            t_s[part], run.trace["q3_mm"].to_numpy()[part], color=DRAWN[name], label=name,
            lw=1.2 if name == "truth" else 2.0, ls=":" if name == "truth" else "-", zorder=3 if name == "truth" else 2,
        )  # fmt: skip
    ends = np.array([worst["from_mm"], worst["to_mm"]])
    middle, half = float(ends.mean()), float(np.abs(np.diff(ends))[0])
    ax.set_ylim(middle - 0.72 * half, middle + 0.72 * half)
    ax.set_xlabel(f"time after the move at {number(worst['t_s'])} s [s]")
    ax.set_ylabel("q3 [mm]")
    who = {"nominal": "the nominal belief", "both": "the found belief", "truth": "the truth"}[worst_of]
    ax.set_title(f"The move that {who} does worst")
    ax.legend(loc="center right")
