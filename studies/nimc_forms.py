"""The forms of the internal model beside each other: wrong estimates of the gap, friction on the motor, sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from dtbacklash.config.compose import compose
from dtbacklash.config.run import RunConfig
from dtbacklash.control import laws
from dtbacklash.experiment import run
from dtbacklash.experiment.run import RunResult, run_scenario
from dtbacklash.files import write_text
from dtbacklash.report.components.markdown import between, table
from dtbacklash.report.components.style import MARKERS, MUTED, SERIES, letter, new_figure, save, styled
from studies.measure import Row

FORMS = ("bare", "measured", "inner_loop", "inverse")
IMC_FORMS = ("bare", "measured", "inner_loop", "exact")
FRICTIONS_N_M = (0.0, 0.02, 0.05)
SENSORS = ("ideal", "encoder")
TRUE_DEG = (0.5, 20.0, 80.0)
ERRORS_PCT = (-100, -50, -20, 0, 20, 50, 100)
#: estimates that are too large by so much that a share of the true gap says nothing: (true, believed), deg
ABSOLUTE_DEG = ((0.0, 10.0), (0.0, 50.0), (0.5, 10.0), (0.5, 50.0), (0.5, 100.0), (0.5, 150.0), (20.0, 100.0))
#: moves of a tenth, which a large gap makes hard: (true, believed), deg
SMALL_MOVES_DEG = ((20.0, 20.0), (80.0, 40.0), (80.0, 80.0), (80.0, 100.0), (0.5, 50.0))
RATIOS = (1.0, 2.0, 3.0, 4.0, 6.0, 10.0)
PERIOD_S, DURATION_S = 20.0, 40.0
#: the end of a run over which its oscillation is taken
TAIL_S = 3.0
PAGE, FIGURE = "theory.md", "images/png"
BEGIN, END = "<!-- forms: begin, made by python -m studies nimc_forms -->", "<!-- forms: end -->"


@lru_cache(maxsize=64)
def _config(structure: str, form: str, friction_n_m: float, sensors: str, amplitude_mm: float) -> RunConfig:
    """What the runs of one form share; the gaps come later."""
    return compose(
        f"controller={structure}", f"controller.internal_model={form}", f"sensors={sensors}", "profile=constant",
        f"reference.period_s={PERIOD_S}", f"reference.amplitude_mm={amplitude_mm}", f"duration_s={DURATION_S}",
        f"rig.effects.motor_bearing.coulomb_friction.torque={friction_n_m}",
    )  # fmt: skip


def one(
    structure: str, form: str, true_deg: float, believed_deg: float, friction_n_m: float, sensors: str,
    amplitude_mm: float = 1.0,
) -> RunResult:  # fmt: skip
    """One run with a constant gap and a fixed estimate, both deg."""
    config = _config(structure, form, friction_n_m, sensors, amplitude_mm)
    profile = replace(config.profile, start_deg=true_deg, end_deg=true_deg)
    return run_scenario(
        replace(config, profile=profile, controller=replace(config.controller, gap_hat_deg=believed_deg))
    )


def judged(result: RunResult) -> dict[str, Any]:
    """Overshoot and settling of the worst move, moves that never settle, and what q3 does at the end of the run.

    ``cycle_um``: half of what lies between the highest and the lowest q3 of the last seconds.
    """
    moves, t_s = result.moves, result.trace["t_s"].to_numpy()
    # the last sample has the next reference; the structure's position itself, not what the sensor shows of it
    tail_mm = result.trace["q3_mm"].to_numpy()[(t_s > t_s[-1] - TAIL_S) & (t_s < t_s[-1])]
    return {
        "overshoot_pct": float(moves["overshoot_pct"].max()),
        "settling_s": float(moves["settling_time_s"].max()) if moves["settling_time_s"].notna().any() else math.nan,
        "unsettled": int(moves["settling_time_s"].isna().sum()),
        "moves": len(moves),
        "cycle_um": 500.0 * float(np.ptp(tail_mm)),
        "peak_v": float(moves["peak_voltage_v"].max()),
    }


def _cases() -> Iterator[tuple[str, float, float, float]]:
    """(kind of error, true and believed gap deg, amplitude mm)."""
    for error, true in product(ERRORS_PCT, TRUE_DEG):
        yield f"{error:+d} %" if error else "0 %", true, true * (1 + error / 100), 1.0
    for true, believed in ABSOLUTE_DEG:
        yield f"{believed:g}° at {true:g}°", true, believed, 1.0
    for true, believed in SMALL_MOVES_DEG:
        yield f"0.1 mm, {believed:g}° at {true:g}°", true, believed, 0.1


def run_grid(progress: Callable[[str], None] | None = None) -> pd.DataFrame:
    """Every form, NIMC, on every case, friction and set of sensors; and IMC, which has no estimate. A row a run."""
    rows = []
    for form, friction, sensors in product(FORMS, FRICTIONS_N_M, SENSORS):
        for error, true, believed, amplitude in _cases():
            found = judged(one("nimc_fixed", form, true, believed, friction, sensors, amplitude))
            about = ("nimc", form, friction, sensors, error, true, believed, amplitude)
            rows.append(dict(zip(ABOUT, about, strict=True)) | found)
        if progress:
            progress(f"nimc {form}, {friction:g} N m, {sensors}")
    for form, friction, sensors, true in product(IMC_FORMS, FRICTIONS_N_M, SENSORS, TRUE_DEG):
        found = judged(one("imc", form, true, 0.0, friction, sensors))
        about = ("imc", form, friction, sensors, "no estimate", true, 0.0, 1.0)
        rows.append(dict(zip(ABOUT, about, strict=True)) | found)
    return pd.DataFrame(rows)


ABOUT = ("structure", "form", "friction_n_m", "sensors", "error", "true_deg", "believed_deg", "amplitude_mm")


def ratio_rows() -> list[Row]:
    """The inverse with other ratios of crossing: the right gap, too large ones, and the voltage."""
    usual, rows = laws.CROSSING_RATIO, []
    for ratio in RATIOS:
        with patch.object(run, "build_controller", partial(_built_with, ratio)):
            found = {
                name: judged(one("nimc_fixed", "inverse", true, believed, 0.0, "ideal"))
                for name, (true, believed) in RATIO_CASES.items()
            }
        row: Row = {"what": f"ratio {ratio:g}" + (" (used)" if ratio == usual else "")}
        row |= {f"{name}_pct": one_found["overshoot_pct"] for name, one_found in found.items()}
        rows.append(row | {"peak_v": max(one_found["peak_v"] for one_found in found.values())})
    return rows


def _built_with(ratio: float, *designed: Any) -> laws.Controller:
    """The controller as a run builds it, with another ratio of crossing."""
    return laws.build_controller(*designed)._replace(crossing_ratio=ratio)


def in_words(row: Row) -> str:
    """A row of :func:`ratio_rows` as a line."""
    return ", ".join(f"{key.replace('_', ' ')} {value:.3g}" if key != "what" else value for key, value in row.items())


RATIO_CASES = {"50_at_50": (50.0, 50.0), "100_at_100": (100.0, 100.0), "40_at_80": (80.0, 40.0),
               "50_at_0.5": (0.5, 50.0), "160_at_80": (80.0, 160.0)}  # fmt: skip


def form_rows(grid: pd.DataFrame) -> list[Row]:
    """A row a structure, form and friction: the worst of all gaps, errors and sensors."""
    rows: list[Row] = []
    for (structure, form, friction), part in grid.groupby(["structure", "form", "friction_n_m"], sort=False):
        large = part[part["amplitude_mm"] == 1.0]
        small = part[part["amplitude_mm"] < 1.0]
        rows.append({
            "what": f"{structure} {form}, {friction:g} N m", "runs": len(large),
            "do_not_settle": int((large["unsettled"] > 0).sum()), "overshoot_pct": large["overshoot_pct"].max(),
            "settling_s": large["settling_s"].max(), "cycle_um": large["cycle_um"].max(),
            "peak_v": large["peak_v"].max(), "small_moves": len(small) or None,
            "small_do_not_settle": int((small["unsettled"] > 0).sum()) if len(small) else None,
        })  # fmt: skip
    return rows


def _summary(grid: pd.DataFrame) -> str:
    """A row a form of NIMC over all frictions and sensors."""
    rows = []
    for form, part in grid[grid["structure"] == "nimc"].groupby("form", sort=False):
        large, small = part[part["amplitude_mm"] == 1.0], part[part["amplitude_mm"] < 1.0]
        restless, tiny = int((large["unsettled"] > 0).sum()), int((small["unsettled"] > 0).sum())
        right = large[large["error"] == "0 %"]
        rows.append([
            f"`{form}`", f"{restless} of {len(large)}", f"{large['overshoot_pct'].max():.1f}",
            f"{large['cycle_um'].max():.3g}", f"{right['overshoot_pct'].max():.1f}", f"{tiny} of {len(small)}",
            f"{large['peak_v'].max():.0f}",
        ])  # fmt: skip
    heads = ("form", "runs that do not settle", "largest overshoot %", "oscillation at the end µm",
             "overshoot with the right gap %", "runs with moves of 0.1 mm that do not settle", "peak V")  # fmt: skip
    return table(heads, rows)


def write_docs(grid: pd.DataFrame, folder: Path) -> None:
    """Bring the summary into its page, and draw the figure."""
    draw(grid, folder / FIGURE)
    page = folder / PAGE
    write_text(page, between(page.read_text(encoding="utf-8"), BEGIN, END, _summary(grid)))


#: the left panel: true and believed gap, deg; friction, N m; sensors; until, s
SHOWN, UNTIL_S = (0.0, 50.0, 0.0, "encoder"), 6.0
#: the right panel: true gap, deg
DRAWN_DEG = 20.0
#: overshoots above are drawn here, %
HIGHEST_PCT = 100.0


def _response(ax: Axes) -> None:
    """q3 of three forms over the first move; `measured` does as `inner_loop`."""
    ax.axhline(1.0, color=MUTED, lw=1.0)
    for form, colour in zip(FORMS, SERIES, strict=False):
        if form == "measured":
            continue
        trace = one("nimc_fixed", form, *SHOWN).trace
        early, front = trace["t_s"] < UNTIL_S, form == "inverse"
        ax.plot(trace["t_s"][early], trace["q3_mm"][early], color=colour, lw=2.0 if front else 1.0,
                zorder=3 if front else 2)  # fmt: skip
    ax.set_xlabel("time [s]")
    ax.set_ylabel("q3 [mm]")


def _errors(ax: Axes, grid: pd.DataFrame) -> None:
    """Largest overshoot over the error of the estimate; hollow where moves never settle."""
    part = grid[(grid["structure"] == "nimc") & (grid["true_deg"] == DRAWN_DEG) & (grid["amplitude_mm"] == 1.0)]
    part = part.assign(error_pct=(100 * (part["believed_deg"] / DRAWN_DEG - 1)).round())
    part = part[part["error_pct"].abs() <= 100]
    for form, colour, marker in zip(FORMS, SERIES, MARKERS, strict=False):
        worst = part[part["form"] == form].groupby("error_pct").agg({"overshoot_pct": "max", "unsettled": "sum"})
        y = worst["overshoot_pct"].clip(lower=0.1, upper=HIGHEST_PCT)
        ax.plot(worst.index, y, color=colour, lw=1.4, label=form)
        for settles, fill in ((True, colour), (False, "white")):
            of = (worst["unsettled"] == 0) == settles
            ax.plot(worst.index[of], y[of], marker, color=colour, mfc=fill, ms=7, zorder=4)
    ax.set_yscale("log")
    ax.set_xlabel("error of the estimate [%]")
    ax.set_ylabel("largest overshoot [%]")


@styled
def draw(grid: pd.DataFrame, path: Path) -> None:
    """Draw both panels."""
    figure = new_figure(3.9, 9.0)
    left, right = figure.subplots(1, 2)
    _response(left)
    _errors(right, grid)
    true, believed, friction, sensors = SHOWN
    letter([left, right], [
        f"gap {true:g}°, believed {believed:g}°", f"gap {DRAWN_DEG:g}°; hollow: not all settle",
    ])  # fmt: skip
    figure.legend(
        *right.get_legend_handles_labels(), loc="outside lower center", ncols=4,
        title=f"(a) friction {friction:g} N m, {sensors}; (b) worst of 0, 0.02 and 0.05 N m, ideal and encoder",
    )  # fmt: skip
    save(figure, path)
