"""What a diagnosis costs: recordings of 15 to 60 s at 1 kHz with one effect each, two threads."""

from __future__ import annotations

import resource
import time

import numpy as np
import pandas as pd

import dtbacklash as dtb
from dtbacklash.config.compose import compose
from dtbacklash.diagnosis import Record, diagnose_records
from dtbacklash.experiment.run import run_scenario
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.simulate import simulate
from studies.measure import Row, verdict

SECONDS_MAX, MEMORY_MAX_MB = 30.0, 1000.0
#: time per recorded second of the longest recording over that of the shortest
LINEARITY_MAX = 1.5
LENGTHS_S = (15.0, 30.0, 60.0)
JOBS = 2
#: what several recordings of a stage hide, and its parameters over those of the nominal rig
FRICTION_N, OFF = 0.428, {"m_c": 1.02, "m_t": 0.97, "k": 1.03}
EFFECTS = (
    "motor_bearing.coulomb_friction.torque=0.02", "gear.backlash.half_gap=0.05", "link_1.cubic_stiffness.k3=1e10",
)  # fmt: skip
MOTION = (
    "controller=open_loop", "reference=multisine", "reference.rms_v=2", "reference.f_max_hz=10", "sensors=encoder",
    "profile=constant", "profile.start_deg=0", "rig.parameters.m.value=5.3", "rig.parameters.R.value=12.2",
)  # fmt: skip


def diagnosis_rows() -> list[Row]:
    """Time of whole diagnoses against length, and the memory at its highest."""
    rig = build_rig(compose("rig=lead_screw").rig)
    diagnose_records(rig, [_record(rig, EFFECTS[0], 3.0)], jobs=JOBS)  # loads
    rows: list[Row] = []
    for effect in EFFECTS:
        per_second = []
        for seconds in LENGTHS_S:
            record = _record(rig, effect, seconds)
            begin = time.perf_counter()
            found = diagnose_records(rig, [record], jobs=JOBS)
            wall_s = time.perf_counter() - begin
            per_second.append(wall_s / seconds)
            row: Row = {
                "what": f"{effect.partition('=')[0].rpartition('.')[0]}, {seconds:g} s", "wall_s": wall_s,
                "ratio": per_second[-1] / per_second[0],
                "named": ", ".join(f"{f.location}.{f.effect}" for f in found.findings),
            }  # fmt: skip
            if seconds == 30.0:
                row |= {"limit": SECONDS_MAX, "pass": verdict(wall_s, SECONDS_MAX)}
            if seconds == LENGTHS_S[-1]:
                row |= {"limit": LINEARITY_MAX, "pass": verdict(row["ratio"], LINEARITY_MAX)}
            rows.append(row)
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    rows.append({
        "what": "memory at its highest, MB", "memory_mb": memory_mb, "limit": MEMORY_MAX_MB,
        "pass": verdict(memory_mb, MEMORY_MAX_MB),
    })  # fmt: skip
    return rows


def several_rows(n: int) -> list[Row]:
    """One recording and n of a two-mass stage in one diagnosis: 30 s at 1 kHz, another motion and noise in each."""
    nominal = build_rig(compose("rig=two_mass_stage").rig)
    wrong = {name: factor * nominal.config.parameters[name].value for name, factor in OFF.items()}
    true = nominal.with_parameters(wrong).with_effect("carriage", "coulomb_friction", {"force": FRICTION_N})
    recordings = [_of_stage(true, k) for k in range(n)]
    rows: list[Row] = []
    for count in sorted({1, n}):
        begin, wall = time.process_time(), time.perf_counter()
        found = dtb.diagnose(recordings[:count], nominal, trust_units=True, jobs=JOBS).diagnosis
        seconds, memory_mb = time.process_time() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        said = [
            f"{f.location}.{f.effect} {next(iter(f.parameters.values())).value:.4g} ({f.confidence})"
            for f in found.findings
        ]
        rows.append({
            "what": f"{count} recordings", "cpu_s": seconds, "wall_s": time.perf_counter() - wall,
            "memory_mb": memory_mb, "named": ", ".join(said),
        })  # fmt: skip
    return rows


def _of_stage(rig: Rig, seed: int) -> pd.DataFrame:
    """30 s of sums of sines that differ by their seed, with a noise of 1 um."""
    rng, t = np.random.default_rng(seed), 1e-3 * np.arange(30_000)
    lines = np.geomspace(0.3, 20.0, 12)
    u = np.sum([np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.3)) for f in lines * rng.uniform(0.9, 1.1, 12)], axis=0)
    shown = simulate(rig, u, 1e-3, substeps=8).sensors
    return pd.DataFrame(
        {"t": t, "u": u} | {c: v[: len(t)] + 1e-6 * rng.standard_normal(len(t)) for c, v in shown.items()}
    )


def _record(rig: Rig, effect: str, seconds: float) -> Record:
    """A recording of the rig with an effect and two wrong parameters, from an encoder and a laser sensor."""
    config = compose(*MOTION, f"duration_s={seconds:g}", f"rig.effects.{effect}")
    seen = run_scenario(config).seen
    u = seen["u"]
    train = np.arange(u.size) < round(0.7 * u.size)
    return Record(config.sample_time_s, u, {name: seen[name] for name in ("theta_m", "q3")}, train, ~train)
