"""The paper's controllers beside what one would use instead: the same machine, wear, sensors and limit of the voltage.

Each runs the main scenario (the gap grows from 0 to 100 degrees while the reference is a square wave) with an encoder
and a noisy position sensor, and with the controller's voltage limited to LIMIT_V, once for each of SEEDS noises; and
once each of BESIDE, where a controller with a model of the gap knows it.
"""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path

import pandas as pd

from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_text
from dtbacklash.report.components.markdown import between, table
from dtbacklash.report.components.style import MARKERS, SERIES, letter, new_figure, save, styled
from studies.measure import Row

LIMIT_V = 12.0
SEEDS = range(5)
#: the row's name -> words of `dtb run`
CONTROLLERS = {
    "PID, two degrees of freedom": ("controller=pid",),
    "LQG (integral action)": ("controller=lqg",),
    "MPC (offset-free)": ("controller=mpc",),
    "offset state, bound 1": ("controller=offset",),
    "offset state, no bound": ("controller=offset", "controller.robust=null"),
    "IMC": ("controller=imc",),
    "NIMC, fixed gap of 50 degrees": ("controller=nimc_fixed",),
    "NIMC, twin, the paper's form": ("experiment=fig13",),
    "NIMC, twin": ("controller=nimc_twin",),
}
KNOWN_DEG = 60
#: another reference, and another noise, at a constant gap
BESIDE = {
    "trajectory": ("reference=trajectory", "reference.period_s=8", "duration_s=12"),
    "noisy": ("sensors.noise.q3_mm=0.05", "reference.period_s=8", "duration_s=12"),
}
PAGES, BEGIN, END = ("controller.md",), "<!-- controllers: begin -->", "<!-- controllers: end -->"
IMAGE = "images/controllers.png"
#: how far the figure goes: the fixed gap where there is none lies beyond
MOST_PCT, MOST_S = 16.0, 3.0


def run_controllers(law: Path | None = None) -> pd.DataFrame:
    """The moves of every controller and noise: `what`, `seed`, :func:`.metrics.move_table`, `gap_deg` at the begin.

    law : the file of one that is run beside them.
    """
    tables = []
    own = {law.stem: ("controller=state_space", f"controller.file={law}")} if law else {}
    for (name, words), seed in product((CONTROLLERS | own).items(), SEEDS):
        common = ("sensors=encoder", f"controller.limit_v={LIMIT_V:g}", f"seed={seed}")
        result = run_scenario(compose(*words, *common))
        gaps = result.trace.set_index("t_s")["gap_deg"]
        begins = gaps.iloc[gaps.index.searchsorted(result.moves["t_s"] - 1e-9)].to_numpy()
        rms = result.summary["tracking_rms_mm"]
        beside = _beside(*words) if seed == SEEDS[0] else {}
        margins = result.design.margins() if result.design else None
        tables.append(result.moves.assign(
            what=name, seed=seed, gap_deg=begins, rms_mm=rms, ms=margins.ms if margins else math.nan,
            small_gain=margins.small_gain if margins else math.nan, **beside,
        ))  # fmt: skip
    return pd.concat(tables, ignore_index=True)


def _beside(*words: str) -> dict[str, float]:
    """Largest overshoot and settling time in each of BESIDE, and the voltage at the rests between its moves, rms."""
    known = ("profile=constant", f"profile.start_deg={KNOWN_DEG}", "sensors=encoder", f"controller.limit_v={LIMIT_V}")
    if any("nimc" in word or "fig13" in word for word in words):
        form = ("controller.internal_model=bare",) if "experiment=fig13" in words else ()
        words = ("controller=nimc_fixed", *form, f"controller.gap_hat_deg={KNOWN_DEG}")
    found: dict[str, float] = {}
    for name, more in BESIDE.items():
        result = run_scenario(compose(*words, *known, *more))
        rest = result.trace["u_v"][result.trace["t_s"] % 4.0 > 3.0]
        found[f"{name}_pct"] = result.moves["overshoot_pct"].max()
        found[f"{name}_s"] = result.moves["settling_time_s"].max(skipna=False)
        found[f"{name}_v"] = float((rest**2).mean() ** 0.5)
    return found


def controller_rows(moves: pd.DataFrame) -> list[Row]:
    """A row a controller: its worst move with a gap below 1 degree and over all, and the margins of its design.

    Of the noises the median, and of the worst move the least and the largest as well.
    """
    rows: list[Row] = []
    for name, own in moves.groupby("what", sort=False):
        new, noises = own[own["gap_deg"] < 1.0].groupby("seed"), own.groupby("seed")
        row: Row = {"what": name, "unsettled": int(own["settling_time_s"].isna().sum()), "moves": len(own)}
        row["overshoot_new_pct"] = new["overshoot_pct"].max().median()
        row["settling_new_s"] = new["settling_time_s"].agg(lambda x: x.max(skipna=False)).median(skipna=False)
        for key, column in (("overshoot_pct", "overshoot_pct"), ("settling_s", "settling_time_s")):
            worst = noises[column].max()
            row |= {key: worst.median(), f"{key}_least": worst.min(), f"{key}_most": worst.max()}
        row |= {"peak_v": own["peak_voltage_v"].max(), "rms_mm": noises["rms_mm"].first().median(),
                "ms": own["ms"].iloc[0], "small_gain": own["small_gain"].iloc[0]}  # fmt: skip
        row |= {f"{name}_{what}": own[f"{name}_{what}"].iloc[0] for name in BESIDE for what in ("pct", "s", "v")}
        rows.append(row)
    return rows


def write_docs(moves: pd.DataFrame, rows: list[Row], folder: Path) -> None:
    """Bring the table into its page, and draw the figure."""
    heads = ["controller", "overshoot, settling without a gap", "largest overshoot [%]", "longest settling [s]",
             "peak [V]", "tracking error, rms [mm]", "largest sensitivity", "small-gain bound",
             f"1 s trajectory over {KNOWN_DEG}°", "50 µm of noise: overshoot, V at rest"]  # fmt: skip
    shown = [
        [str(r["what"]), f"{r['overshoot_new_pct']:.2f} %, " + (
            "does not" if math.isnan(r["settling_new_s"]) else f"{r['settling_new_s']:.2f} s"
         ), f"{r['overshoot_pct']:.2f} ({r['overshoot_pct_least']:.2f} to {r['overshoot_pct_most']:.2f})",
         f"{r['unsettled']} of {r['moves']} do not" if r["unsettled"] else
         f"{r['settling_s']:.2f} ({r['settling_s_least']:.2f} to {r['settling_s_most']:.2f})", f"{r['peak_v']:.1f}",
         f"{r['rms_mm']:.4f}", f"{r['ms']:.2f}", f"{r['small_gain']:.2f}",
         f"{r['trajectory_pct']:.2f} %, {r['trajectory_s']:.2f} s", f"{r['noisy_pct']:.1f} %, {r['noisy_v']:.2f} V"]
        for r in rows
    ]  # fmt: skip
    for page in PAGES:
        text = (folder / page).read_text(encoding="utf-8")
        write_text(folder / page, between(text, BEGIN, END, table(heads, shown)))
    draw(moves, folder / IMAGE)


@styled
def draw(moves: pd.DataFrame, path: Path) -> None:
    """Overshoot and settling time of each move over the gap at its beginning: the median of the noises, and all."""
    figure = new_figure(4.4)
    left, right = figure.subplots(1, 2)
    for i, (name, own) in enumerate(moves.groupby("what", sort=False)):
        colour, again = SERIES[i % len(SERIES)], i // len(SERIES)  # more of them than colours: those again, with dashes
        style = {"color": colour, "marker": MARKERS[(i + again) % len(MARKERS)], "ms": 5, "lw": 1.4, "label": name,
                 "ls": "--" if again else "-"}  # fmt: skip
        for ax, column in ((left, "overshoot_pct"), (right, "settling_time_s")):
            found = own.groupby("gap_deg")[column]
            ax.plot(found.median().index, found.median(), **style)
            ax.fill_between(found.median().index, found.min(), found.max(), color=colour, alpha=0.15, lw=0)
    left.set_ylabel("overshoot [% of the move]")
    right.set_ylabel("settling time, ±1 % [s]")
    for ax, most in ((left, MOST_PCT), (right, MOST_S)):
        ax.set_xlabel("half-gap at the move [deg]")
        ax.set_ylim(0.0, most)
    letter([left, right], ["overshoot", "settling time"])
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    save(figure, path)
