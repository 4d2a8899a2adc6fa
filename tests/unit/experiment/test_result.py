"""What a run hands over: arrays in SI, tables in their units, times that add up."""

import numpy as np
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.experiment.estimation import ESTIMATE_COLUMNS
from dtbacklash.experiment.run import run_scenario

SHOWN = {"rad": "rad", "m": "mm", "rad/s": "rad_s", "m/s": "mm_s", "A": "a"}


@pytest.fixture(scope="module")
def result():
    return run_scenario(compose("controller=nimc_twin", "sensors=encoder", "duration_s=45"))


def test_what_was_seen_is_in_si_and_the_trace_is_the_truth(result):
    assert result.units == {"r": "m", "u": "V", "theta_m": "rad", "q3": "m", "i_m": "A", "q2": "m"}
    assert set(result.seen) == set(result.units)
    assert all(values.shape == (45_001,) for values in result.seen.values())
    assert np.array_equal(result.seen["u"], result.trace["u_v"])
    off_mm = 1e3 * result.seen["q3"] - result.trace["q3_mm"]
    assert 0.5e-3 < np.std(off_mm) < 2e-3  # the encoder's noise and counts
    assert np.ptp(result.seen["r"]) == pytest.approx(2e-3)


def test_in_open_loop_the_reference_is_a_voltage():
    opened = run_scenario(compose("controller=open_loop", "duration_s=1"))
    assert opened.units["r"] == "V"
    assert np.array_equal(opened.seen["r"], opened.seen["u"])


#: rig -> the columns of its trace in open loop
CHANNELS = {
    "pendulum": ["t_s", "u_v", "theta_rad", "omega_rad_s"],
    "servo_arm": ["t_s", "u_rad", "theta_rad", "omega_rad_s"],
    "emps": ["t_s", "qm_mm", "u_v"],
    "lead_screw": ["t_s", "q3_mm", "u_v", "theta_m_rad", "theta_d_rad", "gap_deg", "i_m_a", "q2_mm"],
}


@pytest.mark.parametrize("rig", CHANNELS)
def test_a_rig_has_its_own_channels_and_no_others(rig):
    run = run_scenario(compose("controller=open_loop", f"rig={rig}", "reference=multisine", "duration_s=1"))
    assert list(run.channels) == CHANNELS[rig]
    assert not run.channels.isna().any(axis=None)
    (command, *sensors), table = run.summary["signals"], run.channels
    units = {name: unit for name, unit in run.units.items() if name not in ("r", "u")}
    assert [s["column"] for s in sensors] == [f"{name}_{SHOWN[unit]}" for name, unit in units.items()]
    for signal in (command, *sensors):
        assert table[signal["column"]].max() == pytest.approx(signal["highest"])
    assert run.units["u"] == ("rad" if rig == "servo_arm" else "V")


def test_a_closed_loop_has_the_reference_and_the_twin_s_columns(result):
    assert list(result.channels) == [
        "t_s", "r_mm", "q3_mm", "u_v", "theta_m_rad", "theta_d_rad", "gap_deg", "gap_hat_deg", "eps_mm", "novelty_mm",
        "i_m_a", "q2_mm",
    ]  # fmt: skip


def test_a_row_an_attempt(result):
    assert list(result.estimates.columns) == ESTIMATE_COLUMNS
    assert result.summary["n_attempts"] == len(result.estimates) == 2
    assert result.estimates["t_event_s"].tolist() == [20.0, 40.0]


def test_times_add_up(result):
    wall = result.summary["wall_s"]
    assert set(wall) == {"simulate", "estimate", "total"}
    assert min(wall.values()) >= 0.0
    assert wall["simulate"] + wall["estimate"] <= wall["total"]


def test_progress_goes_from_nothing_to_all():
    told = []
    run_scenario(compose("controller=imc", "duration_s=12"), told.append)
    assert told[0] == 0.0
    assert told == sorted(told)
    assert told[-1] == 1.0
