"""A servo that is told an angle, integrated by SciPy and recorded in degrees, is diagnosed from its position alone."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

STEP_S = 2e-3


def told(seconds):
    """Random angles, each held for a third to nine tenths of a second. (N,) rad."""
    rng, u = np.random.default_rng(3), np.zeros(round(seconds / STEP_S))
    at = 0
    while at < len(u):
        length = round(rng.uniform(0.3, 0.9) / STEP_S)
        u[at : at + length] = rng.uniform(-1.2, 1.2)
        at += length
    return u


def moved(u, fastest):
    """The arm of `dtb rig new servo`, whose drive asks for no more than a speed. (N,) rad."""
    hold, brake, inertia = 8.0, 0.25, 0.02
    state, theta = np.zeros(2), np.zeros(len(u))
    for k in range(len(u) - 1):

        def rates(_, s, target=u[k]):
            asked = np.clip(hold / brake * (target - s[0]), -fastest, fastest)
            return [s[1], brake * (asked - s[1]) / inertia]

        state = solve_ivp(rates, (0.0, STEP_S), state, rtol=1e-9, atol=1e-11).y[:, -1]
        theta[k + 1] = state[0]
    return theta


@pytest.mark.check
def test_the_limit_of_the_speed_is_named_and_what_cannot_be_told_is_said_first(process, tmp_path):
    assert process("rig", "new", "servo", "arm.yaml").returncode == 0
    assert "in proportion only" in process("rig", "check", "arm.yaml").stdout
    u = told(15.0)
    theta = np.degrees(moved(u, 4.0))
    frame = {"t": STEP_S * np.arange(len(u)), "u [deg]": np.degrees(u), "theta": np.round(theta / 0.05) * 0.05}
    pd.DataFrame(frame).to_csv(tmp_path / "arm.csv", index=False)
    done = process("diagnose", "recording=arm.csv", "rig=arm.yaml", "out=found", "-v")
    assert done.returncode == 0, done.stderr
    assert done.stderr.index("in proportion only") < done.stderr.index("recalibrating the rig")
    document = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    (finding,) = document["findings"]
    assert (finding["location"], finding["effect"], finding["confidence"]) == ("servo", "speed_limit", "sure")
    low, high = finding["parameters"]["speed"]["ci95"]
    assert low < 4.0 < high
    assert document["units"] == {"t": "s (assumed)", "u": "deg (header)", "theta": "deg (declared by the rig)"}
