"""Synthetic results that look like the real ones: closed-form responses, no simulation."""

import math
from types import SimpleNamespace

import numpy as np
import pandas as pd

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.config.run import RunConfig, SensorsConfig
from dtbacklash.experiment.metrics import tracking_rms_mm

OMEGA, DECAY, TAU = 27.07, 1.35, 1 / 6
DURATION, PERIOD, T_S = 200.0, 20.0, 0.001


def s_curve(t: np.ndarray, end_deg: float = 100.0) -> np.ndarray:
    x = np.clip((t - 25.0) / 150.0, 0.0, 1.0)
    return end_deg * (10 * x**3 - 15 * x**4 + 6 * x**5)


def estimates_table(rejected: bool = True) -> pd.DataFrame:
    event = np.arange(PERIOD, DURATION, PERIOD)
    true = s_curve(event + 0.5)
    rows = pd.DataFrame(
        {
            "t_event_s": event + 1.0, "t_applied_s": event + 5.0, "gap_deg": true + 0.1 * np.cos(event),
            "true_gap_deg": true, "accepted": True, "reason": "", "cost": 1e-9, "evaluations": 64, "wall_s": 0.011,
        }
    )  # fmt: skip
    if rejected:
        rows.loc[[3, 6], "accepted"] = False
        rows.loc[[3, 6], "t_applied_s"] = np.nan
        rows.loc[3, ["gap_deg", "reason"]] = [432.1, "432.1 deg lies outside the physical bounds [0, 180] deg"]
        rows.loc[6, ["gap_deg", "reason"]] = [71.0, "no contact on the left side in the buffer <b>& so on</b>"]
    return rows


def trace_table(estimates: pd.DataFrame | None, guess_deg: float = 0.0, seed: int = 0) -> pd.DataFrame:
    t = np.arange(int(DURATION / T_S) + 1) * T_S
    gap, guess = s_curve(t), np.full(t.size, guess_deg)
    if estimates is not None:
        for row in estimates[estimates["accepted"]].itertuples():
            guess[t >= row.t_applied_s] = row.gap_deg
    r = np.where((t // PERIOD) % 2 == 0, 1.0, -1.0)
    q3, u, novelty = np.zeros(t.size), np.zeros(t.size), np.zeros(t.size)
    step = int(PERIOD / T_S)
    for begin in range(0, t.size, step):
        now = slice(begin, min(begin + step, t.size))
        since, start = t[now] - t[begin], (0.0 if begin == 0 else r[begin - 1])
        size, wrong = r[begin] - start, abs(gap[begin] - guess[begin]) / 100
        ring = np.exp(-DECAY * since) * np.sin(OMEGA * since)
        q3[now] = start + size * (1 - np.exp(-since / TAU) + 0.12 * wrong * ring)
        u[now] = size * (2.2 * np.exp(-since / 0.05) * np.cos(40 * since) + 1.5 * wrong * ring)
        novelty[now] = 0.35 * wrong * np.exp(-DECAY * since) * (1 - np.exp(-since * 6))
    noise = np.random.default_rng(seed).normal(0, 1e-4, t.size)
    motor = np.pi * q3 + np.radians(gap) * np.sign(r)
    return pd.DataFrame(
        {
            "t_s": t, "r_mm": r, "q3_mm": q3 + noise, "u_v": u, "theta_m_rad": motor, "theta_d_rad": np.pi * q3,
            "gap_deg": gap, "gap_hat_deg": guess, "eps_mm": noise, "novelty_mm": novelty, "i_m_a": u / 12,
        }
    )  # fmt: skip


def config(**changes: object) -> RunConfig:
    rig = RigConfig(
        name="lead_screw",
        description="motor, worm gear, lead screw, three masses",
        parameters={"m": ParameterConfig(5.2, "kg", 0.05, "mass of one platform")},
        elements={"motor_bearing": {"kind": "rotor"}, "gear": {"kind": "gear"}},
        effects={"motor_bearing": {"coulomb_friction": {"torque": 0.02}}},
        sensors={"q3": {"of": "mass_3", "quantity": "position"}},
    )
    sensors = SensorsConfig(noise={"q3_mm": 0.0001})
    return RunConfig(**({"rig": rig, "sensors": sensors} | changes))


def run_result(**changes: object) -> SimpleNamespace:
    estimates = estimates_table()
    trace = trace_table(estimates)
    summary = {
        "controller": "nimc_twin", "n_estimations": len(estimates), "n_attempts": len(estimates),
        "n_accepted": int(estimates["accepted"].sum()), "tracking_rms_mm": tracking_rms_mm(trace),
        "overshoot_pct_max": 3.1, "settling_time_s_max": 1.9, "peak_voltage_v": 8.4, "seconds_simulated": DURATION,
        "wall_s": {"simulate": 0.05, "estimate": 0.1, "total": 0.6}, "seed": 0,
        "versions": {"dtbacklash": "0.1.0", "python": "3.11.6", "numpy": "2.4.6"},
    }  # fmt: skip
    return SimpleNamespace(config=config(**changes), trace=trace, estimates=estimates, summary=summary, design=None)


def step_response(overshoot: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A 1 mm step: times [s], position [mm], voltage [V]."""
    t = np.arange(0, 5.0 if overshoot else 2.0, T_S)
    if overshoot:
        return t, 1 - np.exp(-DECAY * t) * np.cos(OMEGA * t), 47.1 * np.exp(-t / 0.006)
    return t, 1 - np.exp(-t / TAU), 4.5 * np.exp(-t / 0.04) * np.cos(60 * t)


def play(gap_deg: float = 20.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], motor and screw angle [deg] of a play of half-width `gap_deg` under a growing sine."""
    t = np.arange(0, 10, 0.002)
    motor = np.degrees((1 + t / 10) * np.sin(2 * np.pi * t))
    screw = np.zeros(t.size)
    for i in range(1, t.size):
        screw[i] = min(max(screw[i - 1], motor[i] - gap_deg), motor[i] + gap_deg)
    return t, motor, screw


def sweep_table(axes: dict[str, list], seed: int = 0) -> pd.DataFrame:
    """One row a job: the axes' values, the figures a summary holds, and a few failed jobs."""
    index = pd.MultiIndex.from_product(list(axes.values()), names=list(axes))
    table = index.to_frame(index=False)
    random = np.random.default_rng(seed)
    n = len(table)
    table["status"] = "done"
    table["overshoot_pct_max"] = random.gamma(2.0, 2.0, n)
    table["settling_time_s_max"] = 0.8 + random.gamma(2.0, 0.4, n)
    table["n_estimations"] = random.integers(0, 10, n)
    table["peak_voltage_v"] = random.gamma(4.0, 2.0, n)
    if n > 3:
        table["error"] = ""
        table.loc[2, ["overshoot_pct_max", "settling_time_s_max", "n_estimations", "peak_voltage_v"]] = math.nan
        table.loc[2, ["status", "error"]] = ["failed", "controller.k_theta_v_per_rad=900: the loop diverged"]
    return table


def claims_table() -> pd.DataFrame:
    rows = [
        (
            "peak voltage of the unfiltered step", "2.2, Fig. 4", "47 V", 47.12, "±0.5 V", True,
            "the paper prints two digits",
        ),
        (
            "overshoot of the unfiltered step", "2.2, Fig. 4", "almost 100 %", 97.1, "90 … 100 %", True,
            '"almost" read as at least nine tenths',
        ),
        (
            "settling time with the prefilter", "2.2.1, Fig. 6", "0.8 s", 0.802, "±0.05 s", True,
            "one digit in the paper: half a unit of it",
        ),
        ("largest lag of the play is 2θ_b", "3.1, Fig. 7", "40°", 40.0, "±0.01°", True, "exact by construction"),
        (
            "estimates are unbiased", "4.1, Fig. 13", "0°", 0.62, "±0.5°", False,
            "mean error over nine estimates; half of what the figure shows <script>alert(1)</script>",
        ),
        ("events of the novelty index", "4.2, Fig. 14", "3", 3, "0", True, "a count"),
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=["claim", "section", "paper", "ours", "tolerance", "pass", "reason"])
