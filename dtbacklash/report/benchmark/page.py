"""The files of a benchmark's score: score.csv, reliability.csv, the figure, the page."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from dtbacklash.benchmark.score import MIN_CERTAINTY, Bin, Score
from dtbacklash.benchmark.score import Figure as Counted
from dtbacklash.files import write_text
from dtbacklash.report.components import style
from dtbacklash.report.components.blocks import Block, Items, Table, Tiles
from dtbacklash.report.components.blocks import Figure as Shown
from dtbacklash.report.components.numbers import number, percent
from dtbacklash.report.components.page import SHARES, embedded, render

HEADS = ("figure", "value#", "count#", "95 % interval#")
RULES = [
    f"A name counts as said if its certainty is at least {MIN_CERTAINTY:g}. It is right if place and effect are. A name"
    " of a small thing that a lifelike machine has besides is neither right nor false.",
    f"Intervals of shares are Wilson's ({SHARES}). The interval of a median is that of order statistics.",
    "A prediction's error is the rms over time and channels, each channel in units of the true machine's error. "
    "A case without a prediction counts as infinite.",
]
RELIABILITY = "Names by their certainty: the share that is right, with 95 % intervals (Wilson)."
ON_THE_LINE = "Certainty is calibrated where the dots lie on the line; below it, a tool is surer than it is right."


def figures_table(score: Score, group: str) -> Table:
    """The figures of a group of cases."""
    rows = [(one.what, *_cells(one)) for one in score.figures if one.group == group]
    return Table(HEADS, rows, title=f"{score.tool}: {score.figure('no_false_name', group).of} cases")


def _cells(one: Counted) -> tuple[str, str, str]:
    if not one.of:
        return "-", "0", ""
    if one.right is None:
        return number(one.value), str(one.of), f"{number(one.low)} to {number(one.high)}"
    return percent(one.value), f"{one.right}/{one.of}", f"{percent(one.low)} to {percent(one.high)}"


@style.styled
def reliability_figure(bins: list[Bin]) -> Figure:
    """Share of right names over their certainty, in per cent."""
    figure = style.new_figure(4.0, 5.0)
    axes = figure.add_subplot()
    axes.plot([0, 100], [0, 100], color=style.MUTED, lw=1)
    for one in bins:
        low, high = one.interval
        x = 100 * one.certainty
        axes.plot([x, x], [100 * low, 100 * high], color=style.SERIES[0], lw=2)
        axes.plot([x], [100 * one.right / one.of], "o", color=style.SERIES[0])
    axes.set_xlabel("stated certainty (%)")
    axes.set_ylabel("names that are right (%)")
    axes.set_xlim(-2, 102)
    axes.set_ylim(-2, 102)
    return figure


def page(score: Score, reliability: Path) -> str:
    """The text of ``report.html``."""
    groups = dict.fromkeys(one.group for one in score.figures)
    named, false = score.figure("named"), score.figure("false_names")
    tiles = [
        (percent(named.value) if named.of else "-", f"named of {named.of} hidden things"),
        (percent(false.value) if false.of else "-", f"false of {false.of} names"),
        (str(score.cases), "cases"),
    ]
    by_group = [Block(group, [figures_table(score, group)], folded=True) for group in groups if group != "all"]
    lines = [(number(one.certainty), f"{one.right}/{one.of}") for one in score.bins]
    return render(f"Benchmark: {score.tool}", "Which physics is missing, where, and how much of it.", [
        Tiles(tiles),
        Block("Score", [figures_table(score, "all")]),
        Block("Calibration of certainty", [
            Shown(embedded(reliability), RELIABILITY, ON_THE_LINE),
            Table(("mean certainty#", "right#"), lines),
        ] if score.bins else ["No name was given."]),
        Block("Kinds of cases and machines", by_group),
        Block("Rows that were left out", [Items(score.problems)], folded=True),
        Block("Rules", RULES, folded=True),
    ])  # fmt: skip


def write(score: Score, folder: Path) -> None:
    """Write the score into a folder."""
    rows = pd.DataFrame([asdict(one) for one in score.figures])
    rows["right"] = rows["right"].astype("Int64")
    write_text(folder / "score.csv", rows.to_csv(index=False, float_format="%.6g"))
    bins = [(b.certainty, b.right, b.of, *b.interval) for b in score.bins]
    table = pd.DataFrame(bins, columns=["certainty", "right", "of", "low", "high"])
    write_text(folder / "reliability.csv", table.to_csv(index=False, float_format="%.6g"))
    image = style.save(reliability_figure(score.bins), folder / "figures" / "reliability.png")
    write_text(folder / "report.html", page(score, image))
