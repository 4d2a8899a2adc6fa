"""A drive whose effort lags behind its command, made by the concealing simulator, is named so and not as a delay."""

import numpy as np
import pandas as pd
import pytest
from nominal import nominal_rig

import dtbacklash as dtb
from dtbacklash.prove.excitation import multisine
from dtbacklash.prove.simulator.given import Loop
from dtbacklash.prove.simulator.rig import simulate_other

STEP_S, LAG_S = 1e-3, 5e-3


@pytest.mark.check
def test_a_lag_is_told_from_a_delay():
    rig, rng = nominal_rig("oscillator"), np.random.default_rng(100)
    t = STEP_S * np.arange(12001)
    u = multisine(rng, t, 0.3, 15.0)
    lags = rig.with_effect("shaker", "lag", {"time": LAG_S})
    x = simulate_other(lags, Loop(False, u, 0.0 * u, 0.0 * u), STEP_S).truth["x"]
    frame = pd.DataFrame({"t": t, "u": u, "x": x + 3e-6 * rng.standard_normal(len(t))})
    found = dtb.diagnose(dtb.Recording.from_frame(frame, rig=rig), rig)
    (finding,) = found.diagnosis.findings
    assert (finding.location, finding.effect) == ("shaker", "lag")
    # a low-pass of the only sensor does the same
    assert {(other.location, other.effect) for other in finding.also_fits} == {("sensor_x", "low_pass")}
    low, high = finding.parameters["time"].ci95
    assert low < LAG_S < high
