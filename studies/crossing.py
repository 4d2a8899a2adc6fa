"""What the twin's controller does beside the paper's on random machines that it does not know.

The machines are those of :mod:`studies.wrong_models`: structure, friction, compliance, pitch error, sensors, reference
and gap are drawn, and controller and twin believe the nominal rig. Each life of 100 s is run once for each row of
:data:`WAYS`; the moves that begin after the first answer count.

The new controller is *worse than the gap kept* if a move overshoots more than with the old gap kept, by the measure of
:mod:`studies.wrong_models`: by more than ``WORSE_PCT`` of the move and ``SCATTER`` times what other noise does.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import pandas as pd

from dtbacklash.config.compose import compose
from dtbacklash.config.run import ProfileConfig, RunConfig
from dtbacklash.control.belief import Belief, Beliefs
from dtbacklash.errors import Diverged
from dtbacklash.experiment.run import run_scenario
from dtbacklash.physics.rig import Rig, build_rig
from studies.measure import Row
from studies.wrong_models import LIFE_S, MOVE_S, PROCESSES, REPEATS, SCATTER, WORSE_PCT, random_case

#: way -> internal model (or words of `dtb run`), crossing, whether the twin is asked, in words; `new` is the default
WAYS: dict[str, tuple[str, str, bool, str]] = {
    "kept": ("inverse", "hold", False, "`inverse`, held, old gap kept"),
    "paper": ("bare", "run", True, "`bare`, the paper's"),
    "inner_loop": ("inner_loop", "run", True, "`inner_loop`, reference runs on"),
    "new": ("inverse", "hold", True, "`inverse`, held, growing: the default"),
    "offset": ("controller=offset", "run", False, "`controller=offset`, small-gain bound 1"),
    "unbound": ("controller=offset controller.robust=null", "run", False, "`controller=offset`, without a bound"),
    "pid": ("controller=pid", "run", False, "`controller=pid`"),
    "lqg": ("controller=lqg", "run", False, "`controller=lqg`"),
    "mpc": ("controller=mpc", "run", False, "`controller=mpc`"),
    "no_gap": ("controller=imc", "run", False, "`controller=imc` on the machine without its gap"),
}
LIMIT_V = 12.0
#: an overshoot above this is as bad as no control, % of the move
WILD_PCT = 20.0


def live(config: RunConfig, believed: Rig, way: str) -> tuple[float, float, float]:
    """Largest overshoot [% of the move], longest settling time [s] and voltage [V] of the moves after the first answer.

    Infinite where the loop diverges, and the settling time where a move does not settle.
    """
    form, crossing, asks, _ = WAYS[way]
    if form.startswith("controller="):
        controller = compose(*form.split()).controller
    else:
        controller = replace(config.controller, internal_model=form, crossing=crossing)
    if way == "no_gap":
        config = replace(config, profile=ProfileConfig("constant", end_deg=0.0))
    if not asks:
        controller = replace(controller, reconfigure="never")
    config = replace(config, controller=replace(controller, limit_v=LIMIT_V))
    beliefs = Beliefs(Belief(believed), Belief(believed))
    try:
        moves = run_scenario(config, beliefs=beliefs).moves
    except Diverged:
        return math.inf, math.inf, math.inf
    after = moves[moves["t_s"] >= 2.0 * MOVE_S - 1e-6]
    settling = after["settling_time_s"].fillna(math.inf)
    return float(after["overshoot_pct"].max()), float(settling.max()), float(after["peak_voltage_v"].max())


def run_case(base: RunConfig, believed: Rig, seed: int, number: int) -> dict[str, Any]:
    """One row of the table; see :func:`run_crossing`."""
    case = random_case(base, seed, number)
    config = case.config
    row: dict[str, Any] = {"case": number, **case.drawn, "profile": config.profile.kind}
    for way in WAYS:
        found = live(config, believed, way)
        row |= dict(zip((f"overshoot_{way}_pct", f"settling_{way}_s", f"peak_{way}_v"), found, strict=True))
    old, new = row["overshoot_kept_pct"], row["overshoot_new_pct"]
    scatter = 0.0
    if new > old + WORSE_PCT and any(size > 0.0 for size in config.sensors.noise.values()):
        others = [live(replace(config, seed=config.seed + 1 + i), believed, "kept")[0] for i in range(REPEATS)]
        scatter = max((abs(o - old) for o in others if math.isfinite(o)), default=0.0)
    row["worse"] = new > old + WORSE_PCT + SCATTER * scatter
    return row


def run_crossing(n: int, seed: int) -> pd.DataFrame:
    """Run n random machines, a row each: what was drawn; overshoot, settling and peak of each way; ``worse``."""
    base = compose("controller=nimc_twin", "profile=constant", f"duration_s={LIFE_S:g}")
    work = partial(run_case, base, build_rig(base.rig), seed)
    with ProcessPoolExecutor(PROCESSES) as pool:
        return pd.DataFrame(list(pool.map(work, range(n), chunksize=5)))


def crossing_rows(table: pd.DataFrame) -> list[Row]:
    """A row a way: medians, 90th percentiles, and how many loops leave a move unsettled or diverge."""
    rows: list[Row] = []
    for way, (*_, words) in WAYS.items():
        overshoot, settling = table[f"overshoot_{way}_pct"], table[f"settling_{way}_s"]
        rows.append({
            "what": words, "loops": len(table),
            "overshoot_median_pct": overshoot.median(), "overshoot_p90_pct": overshoot.quantile(0.9),
            "settling_median_s": settling.median(), "settling_p90_s": settling.quantile(0.9),
            "unsettled": int((~settling.map(math.isfinite)).sum()),
            "diverged": int((~overshoot.map(math.isfinite)).sum()), "wild": int((overshoot > WILD_PCT).sum()),
            "peak_median_v": table[f"peak_{way}_v"].median(),
        })  # fmt: skip
        if way == "new":
            rows[-1]["worse_than_kept"] = int(table["worse"].sum())
    return rows


def crossing_words(table: pd.DataFrame, seed: int) -> list[str]:
    """Sentences below the table."""
    worse = table[table["worse"]]
    rubs = int(((worse["mass_2.ground_friction"] > 0) | (worse["mass_3.ground_friction"] > 0)).sum())
    lost = table["overshoot_new_pct"] > table["overshoot_paper_pct"] + WORSE_PCT
    return [
        f"seed {seed}; worse than with the gap kept: {len(worse)} of {len(table)}, in {rubs} of them a mass rubs on "
        f"the ground; worse than the paper's form by more than {WORSE_PCT:g} % of the move: {int(lost.sum())}.",
    ]
