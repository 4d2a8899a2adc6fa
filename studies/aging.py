"""A machine that ages, ``experiment=aging``: the paper's twin beside the one that asks the bank, in one figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from dtbacklash.config.compose import compose
from dtbacklash.experiment.result import RunResult
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_text
from dtbacklash.report.components.markdown import between, table
from dtbacklash.report.components.style import INK, MUTED, SERIES, letter, new_figure, save, styled
from studies.measure import Row

PAGE, IMAGE = "bank.md", "images/aging.png"
BEGIN, END = "<!-- aging: begin, made by python -m studies aging -->", "<!-- aging: end -->"
TWINS = {"estimate": "the paper's twin: the gap alone", "bank": "a twin that asks the bank"}
COLOURS = {"estimate": SERIES[1], "bank": SERIES[0]}
#: what the machine goes through: name, from, to [s]
AGES = (("the gap grows", 10.0, 110.0), ("the springs are softer", 130.0, 300.0), ("the bearing rubs", 210.0, 300.0))
#: moves that are shown [s], and for how long
SHOWN, SHOWN_S = (180.0, 280.0), 4.0


def run_both() -> dict[str, RunResult]:
    """The same life with both twins."""
    return {twin: run_scenario(compose("experiment=aging", f"twin.on_alarm={twin}", "figures=false")) for twin in TWINS}


def aging_rows(results: dict[str, RunResult]) -> list[Row]:
    """A row a twin and an age: overshoot and settling of the moves after the twin could have answered."""
    rows: list[Row] = []
    for twin, result in results.items():
        moves = result.moves
        for name, first, last in (("gap", 20.0, 125.0), ("gap, springs", 155.0, 205.0),
                                  ("gap, springs, bearing", 235.0, 300.0)):  # fmt: skip
            some = moves[(moves["t_s"] > first) & (moves["t_s"] < last)]
            rows.append({
                "what": TWINS[twin], "changed": name, "moves": len(some),
                "overshoot_max_pct": float(some["overshoot_pct"].max()),
                "settling_max_s": float(some["settling_time_s"].max(skipna=False)),
                "named": "; ".join(_named(result, first - 20.0, last)) or "-",
            })  # fmt: skip
    return rows


def _named(result: RunResult, first: float, last: float) -> list[str]:
    if "found" not in result.estimates:
        return []
    found = result.estimates[result.estimates["t_event_s"].between(first, last)]["found"]
    return [text for text in dict.fromkeys(found) if text not in ("", "gap", "nothing")]


def _ages(ax: Axes) -> None:
    for name, first, last in AGES:
        ax.axvspan(first, last, color=MUTED, alpha=0.12, lw=0)
        ax.annotate(name, (first + 2.0, 1.0), xycoords=("data", "axes fraction"), va="top", fontsize=8, color=INK,
                    xytext=(0, -3 - 11 * (name == AGES[-1][0])), textcoords="offset points")  # fmt: skip


def _overshoots(ax: Axes, results: dict[str, RunResult]) -> None:
    for shift, (twin, result) in zip((-3.0, 3.0), results.items(), strict=True):
        ax.bar(result.moves["t_s"] + shift, result.moves["overshoot_pct"], width=5.6, color=COLOURS[twin],
               label=TWINS[twin])  # fmt: skip
    highest = max(float(r.moves["overshoot_pct"].max()) for r in results.values())
    ax.set_ylim(0.0, 1.35 * highest)
    ax.set_ylabel("overshoot [%]")
    _ages(ax)


def _gaps(ax: Axes, results: dict[str, RunResult]) -> None:
    trace = results["bank"].trace.iloc[::200]
    ax.plot(trace["t_s"], trace["gap_deg"], color=INK, lw=1.2, label="true")
    for twin, result in results.items():
        seen: pd.DataFrame = result.trace.iloc[::200]
        ax.plot(seen["t_s"], seen["gap_hat_deg"], color=COLOURS[twin], lw=1.4)
    ax.set_ylim(-3.0, 102.0)
    heights, blue = iter((80.0, 92.0, 80.0, 92.0)), COLOURS["bank"]
    for row in results["bank"].estimates.to_dict("records"):
        said = row["found"]  # what the twin goes on with is labelled
        if said and not said.startswith(("gap", "nothing", "unknown", "ambiguous")) and "(not sure)" not in said:
            high = next(heights, 80.0)
            text = said.replace("motor_bearing", "of the bearing").replace("stiffness all", "stiffness of all")
            ax.annotate(text, (row["t_applied_s"], 62.0), xytext=(row["t_applied_s"] + 8.0, high), ha="right",
                        fontsize=8, color=blue, arrowprops={"arrowstyle": "->", "color": blue})  # fmt: skip
    ax.set_ylabel("gap [deg]")
    ax.set_xlabel("time [s]")


def _move(ax: Axes, results: dict[str, RunResult], begin_s: float) -> None:
    for twin, result in results.items():
        trace = result.trace
        part = trace[trace["t_s"].between(begin_s - 0.2, begin_s + SHOWN_S)]
        ax.plot(part["t_s"] - begin_s, part["q3_mm"], color=COLOURS[twin], lw=1.4)
    target = float(part["r_mm"].iloc[-1])
    ax.axhline(target, color=MUTED, lw=1.0)
    side = 1.0 if target > 0 else -1.0
    ax.set_ylim(*sorted((target - side * 0.12, target + side * 0.2)))
    ax.set_ylabel("q3 [mm]")


@styled
def draw(results: dict[str, RunResult], path: Path) -> None:
    """Overshoot of every move and the gap on the left; the end of two moves on the right."""
    figure = new_figure(5.2, 11.0)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.9, 1.0])
    left = [figure.add_subplot(grid[i, 0]) for i in range(2)]
    right = [figure.add_subplot(grid[i, 1]) for i in range(2)]
    _overshoots(left[0], results)
    _gaps(left[1], results)
    left[0].sharex(left[1])
    for ax, begin_s in zip(right, SHOWN, strict=True):
        _move(ax, results, begin_s)
    right[1].set_xlabel("time since the move began [s]")
    letter([*left, *right], [
        "overshoot of every move", "gap: true (black), believed, and what else was named",
        f"softer springs ({SHOWN[0]:g} s)", f"and friction ({SHOWN[1]:g} s)",
    ])  # fmt: skip
    figure.legend(*left[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    save(figure, path)


def write_docs(results: dict[str, RunResult], rows: list[Row], folder: Path) -> None:
    """Bring table and figure into the page."""
    draw(results, folder / IMAGE)
    text = (folder / PAGE).read_text(encoding="utf-8")
    heads = ["twin", "changed", "moves", "largest overshoot [%]", "longest settling [s]", "named"]
    write_text(folder / PAGE, between(text, BEGIN, END, table(heads, [_shown(row) for row in rows])))


def _shown(row: Row) -> list[str]:
    def cell(value: Any) -> str:
        return f"{value:.2f}" if isinstance(value, float) else str(value)

    return [cell(value) for value in row.values()]
