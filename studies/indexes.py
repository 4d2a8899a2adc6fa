"""The novelty indexes on faults of each subsystem: what they show, and what their alarms speak for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief, Beliefs
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_text
from dtbacklash.physics.rig import build_rig
from dtbacklash.report.components.markdown import between, table
from studies.measure import Row

PAGE = "theory.md"
BEGIN, END = "<!-- indexes: begin, made by python -m studies indexes -->", "<!-- indexes: end -->"
BASE = (
    "controller=nimc_fixed", "controller.gap_hat_deg=0", "controller.internal_model=inner_loop", "profile=constant",
    "sensors=encoder", "duration_s=60", "figures=false", "twin.indexes=[frequency,motor,structure]",
)  # fmt: skip
#: what is changed -> the settings that change it, the subsystem that should be named (empty: none)
FAULTS: dict[str, tuple[str, str]] = {
    "nothing": ("profile.start_deg=0", ""),
    "k -20 %": ("rig.parameters.k.value=8000", "structure"),
    "k -10 %": ("rig.parameters.k.value=9000", "structure"),
    "k +20 %": ("rig.parameters.k.value=12000", "structure"),
    "gap 5 deg": ("profile.start_deg=5", "gap or structure"),
    "gap 20 deg": ("profile.start_deg=20", "gap or structure"),
    "gap 60 deg": ("profile.start_deg=60", "gap or structure"),
    "ground friction 0.2 N": ("rig.effects.mass_3.ground_friction.force=0.2", "gap or structure"),
    "compliance 1e-5 m/N": ("rig.effects.screw.compliance.compliance=1e-5", "structure"),
    "Coulomb 0.03 N m": ("rig.effects.motor_bearing.coulomb_friction.torque=0.03", "motor"),
    "cogging 0.03 N m": ("rig.effects.motor_bearing.cogging.torque=0.03", "motor"),
    "load 0.02 N m": ("rig.effects.motor_bearing.constant_load.torque=0.02", "motor"),
}


def index_rows() -> list[Row]:
    """A row a fault: the indexes, the subsystems that were named, and whether the right one is among them alone."""
    believed = Belief(build_rig(compose().rig))
    rows: list[Row] = []
    for name, (changed, subsystem) in FAULTS.items():
        start = () if changed.startswith("profile") else ("profile.start_deg=0",)
        result = run_scenario(compose(*BASE, *start, changed), beliefs=Beliefs(believed, believed))
        ratio = result.trace["frequency_ratio"]
        named = sorted({alarm["subsystem"] for alarm in result.summary["alarms"]})
        rows.append({
            "what": name, "frequency_ratio": float(np.nanmedian(ratio)) if ratio.notna().any() else None,
            "motor_n_m": float(result.trace["motor_torque_n_m"].max()),
            "structure_mm": float(result.trace["structure_mm"].max()),
            "named": ", ".join(named) or "none", "meant": subsystem or "none",
        })  # fmt: skip
    return rows


def write_docs(rows: list[Row], folder: Path) -> None:
    """Bring the table into the page, between its marks."""
    text = (folder / PAGE).read_text(encoding="utf-8")
    shown = [
        [str(r["what"]), "-" if r["frequency_ratio"] is None else f"{r['frequency_ratio']:.3f}",
         f"{r['motor_n_m']:.4f}", f"{r['structure_mm']:.4f}", str(r["named"])]
        for r in rows
    ]  # fmt: skip
    heads = ["changed", "frequency over ω_d", "motor [N·m]", "structure [mm]", "alarms name"]
    write_text(folder / PAGE, between(text, BEGIN, END, table(heads, shown)))
