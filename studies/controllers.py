"""The paper's controllers beside what one would use instead: the same machine, wear, sensors and limit of the voltage.

Each runs the main scenario (the gap grows from 0 to 100 degrees while the reference is a square wave) with an encoder
and a noisy position sensor, and with the controller's voltage limited to LIMIT_V.
"""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd

from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_text
from dtbacklash.report.kit.markdown import between, table
from dtbacklash.report.kit.style import MARKERS, SERIES, letter, new_figure, save, styled
from studies.measure import Row

LIMIT_V = 12.0
#: the row's name -> words of `dtb run`
CONTROLLERS = {
    "PID (cascade, IMC rules)": ("controller=pid",),
    "LQG (integral action)": ("controller=lqg",),
    "IMC": ("controller=imc",),
    "NIMC, fixed gap of 50 degrees": ("controller=nimc_fixed",),
    "NIMC, twin, the paper's form": ("experiment=fig13",),
    "NIMC, twin": ("controller=nimc_twin",),
}
PAGES, BEGIN, END = ("controller.md",), "<!-- controllers: begin -->", "<!-- controllers: end -->"
IMAGE = "images/controllers.png"
#: how far the figure goes: the fixed gap where there is none lies beyond
MOST_PCT, MOST_S = 16.0, 3.0


def run_controllers() -> pd.DataFrame:
    """The moves of every controller: those of :func:`.metrics.move_table`, `what`, and `gap_deg` when it begins."""
    tables = []
    for name, words in CONTROLLERS.items():
        common = ("sensors=encoder", f"controller.limit_v={LIMIT_V:g}")
        result = run_scenario(compose(*words, *common))
        gaps = result.trace.set_index("t_s")["gap_deg"]
        begins = gaps.iloc[gaps.index.searchsorted(result.moves["t_s"] - 1e-9)].to_numpy()
        rms = result.summary["tracking_rms_mm"]
        margins = result.design.margins() if result.design else None
        tables.append(result.moves.assign(
            what=name, gap_deg=begins, rms_mm=rms, ms=margins.ms if margins else math.nan,
            small_gain=margins.small_gain if margins else math.nan,
        ))  # fmt: skip
    return pd.concat(tables, ignore_index=True)


def controller_rows(moves: pd.DataFrame) -> list[Row]:
    """A row a controller: its worst move with a gap below 1 degree and over all, and the margins of its design."""
    rows: list[Row] = []
    for name, own in moves.groupby("what", sort=False):
        new = own[own["gap_deg"] < 1.0]
        rows.append({
            "what": name, "overshoot_new_pct": float(new["overshoot_pct"].max()),
            "settling_new_s": float(new["settling_time_s"].max(skipna=False)),
            "overshoot_pct": float(own["overshoot_pct"].max()),
            "settling_s": float(own["settling_time_s"].max(skipna=False)),
            "unsettled": int(own["settling_time_s"].isna().sum()), "peak_v": float(own["peak_voltage_v"].max()),
            "rms_mm": float(own["rms_mm"].iloc[0]), "ms": float(own["ms"].iloc[0]),
            "small_gain": float(own["small_gain"].iloc[0]),
        })  # fmt: skip
    return rows


def write_docs(moves: pd.DataFrame, rows: list[Row], folder: Path) -> None:
    """Bring the table into its page, and draw the figure."""
    heads = ["controller", "overshoot, settling without a gap", "overshoot at most [%]", "settling at most [s]",
             "peak [V]", "tracking error, rms [mm]", "largest sensitivity", "small-gain bound"]  # fmt: skip
    shown = [
        [str(r["what"]), f"{r['overshoot_new_pct']:.2f} %, " + (
            "does not" if math.isnan(r["settling_new_s"]) else f"{r['settling_new_s']:.2f} s"
         ), f"{r['overshoot_pct']:.2f}",
         f"{r['unsettled']} of 10 do not" if r["unsettled"] else f"{r['settling_s']:.2f}", f"{r['peak_v']:.1f}",
         f"{r['rms_mm']:.4f}", f"{r['ms']:.2f}", f"{r['small_gain']:.2f}"]
        for r in rows
    ]  # fmt: skip
    for page in PAGES:
        text = (folder / page).read_text(encoding="utf-8")
        write_text(folder / page, between(text, BEGIN, END, table(heads, shown)))
    draw(moves, folder / IMAGE)


@styled
def draw(moves: pd.DataFrame, path: Path) -> None:
    """Overshoot and settling time of each move over the gap at its beginning."""
    figure = new_figure(4.4)
    left, right = figure.subplots(1, 2)
    for (name, own), colour, marker in zip(moves.groupby("what", sort=False), SERIES, MARKERS, strict=False):
        style = {"color": colour, "marker": marker, "ms": 5, "lw": 1.4, "label": name}
        left.plot(own["gap_deg"], own["overshoot_pct"], **style)
        right.plot(own["gap_deg"], own["settling_time_s"], **style)
    left.set_ylabel("overshoot [% of the move]")
    right.set_ylabel("settling time, ±1 % [s]")
    for ax, most in ((left, MOST_PCT), (right, MOST_S)):
        ax.set_xlabel("half-gap at the move [deg]")
        ax.set_ylim(0.0, most)
    letter([left, right], ["overshoot", "settling time"])
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    save(figure, path)
