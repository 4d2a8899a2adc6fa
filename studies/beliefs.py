"""Whether what is known of a machine helps its controller: twelve machines, and three beliefs of each.

Each machine differs from the nominal rig in one thing. The loop of ``controller=nimc_twin`` runs on it through an
encoder and a noisy position sensor while the gap grows to END_DEG, and controller and twin believe in

- the nominal rig;
- what the bank says of one buffer of that loop (the nominal rig, where it names nothing);
- the true machine.

A belief that is nearer to the truth is *worse* if its least overshoot of all noises exceeds the largest of the nominal
one by more than NOISE_PCT of the move.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import pandas as pd

from dtbacklash.config.compose import compose
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import Belief, Beliefs
from dtbacklash.errors import Diverged
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_text
from dtbacklash.physics.rig import build_rig
from dtbacklash.report.components.markdown import between, table
from dtbacklash.twin.bank.bank import Buffer, diagnose_buffers
from studies.measure import Row

MOTOR = "rig.effects.motor_bearing"
MACHINES = {
    "nominal": (),
    "k -20 %": ("rig.parameters.k.value=8000",),
    "k +20 %": ("rig.parameters.k.value=12000",),
    "c +22 %": ("rig.parameters.c.value=45",),
    "m -10 %": ("rig.parameters.m.value=4.68",),
    "screw compliance 1e-5 m/N": ("rig.effects.screw.compliance.compliance=1e-5",),
    "ground friction 0.2 N on mass_3": ("rig.effects.mass_3.ground_friction.force=0.2",),
    "hysteresis of link_1, 0.2 N": ("rig.effects.link_1.hysteresis={force:0.2,displacement:2e-5}",),
    "Coulomb friction 0.03 N m": (f"{MOTOR}.coulomb_friction.torque=0.03",),
    "viscous friction 1e-3 N m s": (f"{MOTOR}.viscous_friction.coefficient=1e-3",),
    "constant load 0.02 N m": (f"{MOTOR}.constant_load.torque=0.02",),
    "amplifier late by 3 ms": ("rig.effects.amplifier.delay.time=3e-3",),
}  # fmt: skip
BELIEFS = ("nominal", "bank", "truth")
END_DEG, LIFE_S, BUFFER_S, SEEDS = 60.0, 120.0, 60.0, range(3)
NOISE_PCT = 0.3
PAGE, BEGIN, END = "closing.md", "<!-- beliefs: begin, made by python -m studies beliefs -->", "<!-- beliefs: end -->"


def run_machine(machine: str) -> list[Row]:
    """A row a belief and a noise: largest overshoot [%] and settling time [s] of its moves, and what the bank said."""
    words = (f"profile.end_deg={END_DEG:g}", "profile.t_start_s=10", f"profile.t_end_s={LIFE_S - 10:g}")
    config = compose("sensors=encoder", f"duration_s={LIFE_S:g}", *words, *MACHINES[machine])
    nominal, truth = Belief(build_rig(compose().rig)), Belief(build_rig(config.rig))
    found, said = _by_the_bank(config, nominal)
    rows: list[Row] = []
    for name, belief in zip(BELIEFS, (nominal, found, truth), strict=True):
        for seed in SEEDS:
            overshoot, settling = math.inf, math.inf
            try:
                moves = run_scenario(replace(config, seed=seed), beliefs=Beliefs(belief, belief)).moves
                overshoot = float(moves["overshoot_pct"].max())
                settling = float(moves["settling_time_s"].fillna(math.inf).max())
            except Diverged:
                pass
            rows.append({"machine": machine, "belief": name, "seed": seed, "said": said,
                         "overshoot_pct": overshoot, "settling_s": settling})  # fmt: skip
    return rows


def _by_the_bank(config: RunConfig, nominal: Belief) -> tuple[Belief, str]:
    """What the bank makes of the nominal belief by the move at BUFFER_S, and its words."""
    run = run_scenario(config, beliefs=Beliefs(nominal, nominal))
    first = round(BUFFER_S / config.sample_time_s) - config.twin.bank_rest
    part = slice(first, first + config.twin.bank_buffer)
    read = {name: run.seen[name][part].copy() for name in ("theta_m", "q3")}
    gap = math.radians(float(run.trace["gap_hat_deg"].iloc[first]))
    said = diagnose_buffers(nominal, [Buffer(run.seen["u"][part].copy(), read, config.sample_time_s)], [gap])
    return said.belief, said.found


def run_beliefs() -> pd.DataFrame:
    """All machines; see :func:`run_machine`."""
    with ProcessPoolExecutor(2) as pool:
        return pd.DataFrame([row for rows in pool.map(run_machine, MACHINES) for row in rows])


def belief_rows(runs: pd.DataFrame) -> list[Row]:
    """A row a machine: median of the noises of each belief, and which beliefs are worse than the nominal one."""
    rows: list[Row] = []
    for machine, own in runs.groupby("machine", sort=False):
        by = dict(iter(own.groupby("belief")))
        row: Row = {"what": machine, "said": own["said"].iloc[0]}
        for name in BELIEFS:
            row |= {f"overshoot_{name}_pct": by[name]["overshoot_pct"].median(),
                    f"settling_{name}_s": by[name]["settling_s"].median()}  # fmt: skip
        most = by["nominal"]["overshoot_pct"].max() + NOISE_PCT
        worse = [name for name in BELIEFS[1:] if by[name]["overshoot_pct"].min() > most]
        rows.append(row | {"worse": " ".join(worse), "pass": "no" if worse else "yes"})
    return rows


def write_docs(rows: list[Row], folder: Path) -> None:
    """Bring the table into its page."""
    heads = ["machine", "the bank says", *(f"{name}: overshoot, settling" for name in BELIEFS), "worse than nominal"]
    shown = [
        [str(r["what"]), str(r["said"]),
         *(f"{r[f'overshoot_{b}_pct']:.2f} %, {r[f'settling_{b}_s']:.2f} s" for b in BELIEFS), r["worse"] or "-"]
        for r in rows
    ]  # fmt: skip
    text = (folder / PAGE).read_text(encoding="utf-8")
    write_text(folder / PAGE, between(text, BEGIN, END, table(heads, shown)))
