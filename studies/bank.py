"""The bank in the loop: twelve changes, with the twin that estimates the gap alone and with the bank.

The changes and the run are those of :mod:`.beliefs`; each is there from the beginning, while controller and twin
believe in the nominal rig. With the bank a run is *worse* if its largest overshoot is by more than NOISE_PCT of the
move above that without.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from dtbacklash.config.compose import compose
from dtbacklash.errors import Diverged
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_text
from dtbacklash.report.components.markdown import between, table
from studies.beliefs import END_DEG, LIFE_S, MACHINES, NOISE_PCT
from studies.measure import Row

TWINS = {"without": "estimate", "with": "bank"}
PAGE, BEGIN, END = "bank.md", "<!-- bank: begin, made by python -m studies bank -->", "<!-- bank: end -->"


def run_change(seed: int, machine: str) -> Row:
    """Largest overshoot [%] without and with the bank; what it named in the loop, and when that was in force [s]."""
    row: Row = {"what": machine}
    for name, on_alarm in TWINS.items():
        config = compose(
            "controller=nimc_twin", f"twin.on_alarm={on_alarm}", "model=lead_screw", "sensors=encoder",
            f"duration_s={LIFE_S:g}", "profile.t_start_s=10", f"profile.t_end_s={LIFE_S - 10:g}",
            f"profile.end_deg={END_DEG:g}", "figures=false", f"seed={seed}", *MACHINES[machine],
        )  # fmt: skip
        row[f"overshoot_{name}_pct"] = math.inf
        try:
            run = run_scenario(config)
        except Diverged:
            continue
        row[f"overshoot_{name}_pct"] = float(run.moves["overshoot_pct"].max())
        if on_alarm == "bank":
            rows = run.estimates
            said = rows["found"].to_list()
            named = rows[rows["found"].str.contains(": ") & ~rows["found"].str.contains("ambiguous|not sure")]
            row["named"] = "; ".join(named["found"]) or max(said, key=said.count)
            row["at"] = ", ".join(f"{t:.1f} s" for t in named["t_applied_s"] if np.isfinite(t)) or "-"
    row["pass"] = "yes" if row["overshoot_with_pct"] <= row["overshoot_without_pct"] + NOISE_PCT else "no"
    return row


def bank_rows(seed: int) -> list[Row]:
    """A row a change, with the noise of a seed; see :func:`run_change`."""
    with ProcessPoolExecutor(2) as pool:
        return list(pool.map(partial(run_change, seed), MACHINES))


def write_docs(rows: list[Row], folder: Path) -> None:
    """Bring the table into its page."""
    heads = ["change", "named", "in force at", "overshoot without [%]", "with [%]", "worse"]
    shown = [
        [str(r["what"]), str(r.get("named", "diverged")), str(r.get("at", "-")), f"{r['overshoot_without_pct']:.2f}",
         f"{r['overshoot_with_pct']:.2f}", "-" if r["pass"] == "yes" else "yes"]
        for r in rows
    ]  # fmt: skip
    text = (folder / PAGE).read_text(encoding="utf-8")
    write_text(folder / PAGE, between(text, BEGIN, END, table(heads, shown)))
