"""A ring-down and a swing, integrated by SciPy and recorded without a command, are diagnosed by their names."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

STEP_S = 2e-3
EXACT = {"rtol": 1e-11, "atol": 1e-13, "method": "DOP853"}


def ring_down(seconds):
    """The shipped oscillator with a cubic spring, let go from 20 mm. m."""
    m, k, c, k3 = 1.2, 1900.0, 2.0, 3e6
    t = STEP_S * np.arange(round(seconds / STEP_S))

    def rates(_, s):
        return [s[1], -(k * s[0] + c * s[1] + k3 * s[0] ** 3) / m]

    return t, solve_ivp(rates, (0.0, t[-1]), [0.02, 0.0], t_eval=t, **EXACT).y[0]


def swing(seconds):
    """The shipped pendulum, off centre and with dry friction, let go from 1.5 rad, a reversal at a time. rad."""
    J, load, dry = 0.02, 0.5, 0.01
    t = STEP_S * np.arange(round(seconds / STEP_S))
    theta, at, first = np.zeros(len(t)), 0.0, 1.5

    def reverses(_, s):
        return s[1] if s[1] else -np.sign(first)

    reverses.terminal = True
    while at < t[-1] and abs(load * np.sin(first)) > dry:
        towards = -np.sign(first)
        part = solve_ivp(
            lambda _, s, towards=towards: [s[1], -(load * np.sin(s[0]) + dry * towards) / J],
            (at, t[-1]), [first, 1e-12 * towards], events=reverses, dense_output=True, **EXACT,
        )  # fmt: skip
        theta[t >= at] = part.sol(t[t >= at])[0]
        at, first = part.t[-1], part.y[0, -1]
        theta[t >= at] = first
    return t, theta


@pytest.mark.check
@pytest.mark.parametrize(
    ("motion", "rig", "column", "noise", "named"),
    [
        (ring_down(12.0), "oscillator", "x [mm]", 5e-6, {("spring", "cubic_stiffness"): ("k3", 3e6)}),
        (swing(25.0), "pendulum", "theta [deg]", 1e-4,
         {("disk", "gravity"): ("torque", 0.5), ("disk", "coulomb_friction"): ("torque", 0.01)}),
    ],
)  # fmt: skip
def test_a_free_motion_is_diagnosed(motion, rig, column, noise, named, process, tmp_path):
    t, seen = motion
    seen = seen + noise * np.random.default_rng(3).standard_normal(len(t))
    per_si = 1e3 if "mm" in column else 180.0 / np.pi
    pd.DataFrame({"t": t, column: per_si * seen}).to_csv(tmp_path / "free.csv", index=False)
    done = process("diagnose", "recording=free.csv", "recording.command=none", f"rig={rig}", "out=found")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    found = {(f["location"], f["effect"]): f for f in document["findings"]}
    assert set(found) == set(named)
    for key, (parameter, value) in named.items():
        low, high = found[key]["parameters"][parameter]["ci95"]
        assert found[key]["confidence"] == "sure"
        assert low < value < high
    assert any(note.startswith("Nothing was commanded") for note in document["notes"])
