"""The page of a loop that was closed over a diagnosis: what was found, and what the loop makes of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawn

from dtbacklash.closed_loop_check import COLUMNS, Closed
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import beliefs_of, settled
from dtbacklash.diagnosis.result import Diagnosis
from dtbacklash.experiment.run import RunResult
from dtbacklash.report.components.blocks import Block, Code, Figure, Link, Table
from dtbacklash.report.components.numbers import fixed, number, quantity
from dtbacklash.report.components.page import embedded, render
from dtbacklash.report.components.style import COLOUR, INK, MUTED, SERIES, new_figure, save, styled
from dtbacklash.report.run.words import as_yaml, describe, subjects

HEADINGS = {
    "belief": "belief",
    "overshoot_pct": "largest overshoot [%]",
    "settling_time_s": "longest settling time [s]",
    "estimations": "estimations",
    "accepted": "accepted estimates",
    "largest_gap_error_deg": "largest error of an accepted gap [deg]",
}
MEANINGS = {
    "nominal": "controller and twin believe in the nominal rig",
    "twin only": "the twin knows what was found, the controller does not",
    "design only": "the controller knows what was found, the twin does not",
    "both": "controller and twin know what was found",
    "truth": "controller and twin know the machine as it is",
}
CAPTION = (
    "The largest overshoot with each belief, and the output at the move that the nominal belief does worst.",
    "If what was found is right, the bar of “both” is as short as that of “truth” and its line lies on the dotted one.",
)

#: what the right-hand panel shows, each in its colour
DRAWN = {"nominal": SERIES[1], "both": SERIES[0], "truth": INK}
#: from this long before a move to this long after it, s
BEFORE_S, AFTER_S = 0.3, 4.0


def write(closed: Closed, config: RunConfig, folder: Path, command: str) -> None:
    """Write ``report.html`` and, if wanted, ``figures/close_the_loop.png`` into an existing folder.

    config : of the loop, before anything was found.
    """
    figure = []
    if config.figures:
        (folder / "figures").mkdir(exist_ok=True)
        path = save(beliefs_figure(closed.table, closed.runs), folder / "figures" / "close_the_loop.png")
        figure = [Figure(embedded(path), *CAPTION)]
    said = f"The verdict is “{closed.diagnosis.verdict.replace('_', ' ')}”. "
    page = render(
        "From a recording to a controller",
        "The machine was recorded in its loop, the recording was diagnosed, and the loop was run with what was found.",
        [
            Block("What was found", [
                found_in_words(closed.diagnosis),
                Link(said, "found/report.html", "The page of the diagnosis", " has the details."),
            ]),
            Block("What the loop makes of it", [*figure, beliefs_table(closed.table, True)]),
            Block("What was run", [subjects(describe(settled(config, beliefs_of(config))))], folded=True),
            Block("Run it again, and all settings", [
                Code(command), Block("Configuration, resolved", [Code(as_yaml(config))], folded=True),
                "The table is also in `close_the_loop.csv`, and the rig that was found is in `found/rig.yaml`. To run "
                "the machine under a controller that knows what was found, give its own settings and "
                "`model=found/rig.yaml`.",
            ], folded=True),
        ],
    )  # fmt: skip
    (folder / "report.html").write_text(page, encoding="utf-8")


def beliefs_table(table: pd.DataFrame, meanings: bool = False) -> Table:
    """The loop with each belief, and on demand what each of them means."""
    rows = []
    for row in table.to_dict("records"):
        cells = [str(row["belief"]), *(number(row[name]) for name in COLUMNS[1:-1]), fixed(row[COLUMNS[-1]], 2)]
        rows.append([*cells, *[MEANINGS[cells[0]]] * meanings])
    heads = [HEADINGS[name] + ("#" if k else "") for k, name in enumerate(COLUMNS)]
    return Table((*heads, *["what it is"] * meanings), rows, "The loop with each belief")


def found_in_words(diagnosis: Diagnosis) -> str:
    """What was found and what had to move, one sentence after the other."""
    moved = [
        f"{name} is {quantity(r.value, r.unit)} instead of {quantity(r.nominal, r.unit)}"
        for name, r in diagnosis.recalibrated.items()
    ]
    told = diagnosis.summary if diagnosis.findings or not moved else ""
    return f"{told} Recalibrated: {', '.join(moved)}.".strip() if moved else diagnosis.summary


@styled
def beliefs_figure(table: pd.DataFrame, runs: dict[str, RunResult | None]) -> Drawn:
    """``table`` : columns as of :data:`dtbacklash.closed_loop_check.COLUMNS`.

    runs : belief -> its run, None if it diverged.
    """
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
