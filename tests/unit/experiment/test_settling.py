"""A gap that is too large is taken back before the loop has gone round in it for long."""

import math

import numpy as np
import pytest
from steady_twin import SteadyTwin

from dtbacklash.config.compose import compose
from dtbacklash.experiment.run import run_scenario
from dtbacklash.experiment.settling import HalfGap

WORDS = ("controller=nimc_twin", "controller.internal_model=inner_loop", "profile=constant", "profile.start_deg=5",
         "controller.gap_hat_deg=5", "reference.period_s=20", "duration_s=19", "twin.delay_s=0.5")  # fmt: skip


def test_a_gap_in_which_the_loop_goes_round_is_taken_back():
    result = run_scenario(compose(*WORDS), service=SteadyTwin(math.radians(60)))
    believed = result.trace.set_index("t_s")["gap_hat_deg"]
    assert believed[13.0] == pytest.approx(60.0)  # in force from 11.5 s on
    assert believed[15.0] == pytest.approx(5.0)
    assert "taken back at 14.50 s" in result.estimates["reason"].iloc[0]
    q3 = result.trace["q3_mm"].to_numpy()
    assert np.ptp(q3[13500:14500]) > 0.1
    assert np.ptp(q3[-500:]) < 0.02


def test_a_gap_that_was_taken_back_is_not_believed_again():
    result = run_scenario(
        compose(*WORDS[:-2], "twin.delay_s=0.5", "duration_s=39"), service=SteadyTwin(math.radians(60))
    )
    believed = result.trace.set_index("t_s")["gap_hat_deg"]
    assert np.allclose(believed[15.0:], 5.0)
    assert "taken back" in result.estimates["reason"].iloc[0]
    assert "not put in force: the loop went round in 60.0 deg" in result.estimates["reason"].iloc[1]
    assert math.isnan(result.estimates["applied_deg"].iloc[1])


def test_a_gap_with_which_it_rests_is_kept():
    result = run_scenario(compose(*WORDS), service=SteadyTwin(math.radians(6)))
    assert result.trace["gap_hat_deg"].iloc[-1] == pytest.approx(6.0)
    assert result.estimates["reason"].iloc[0] == "sure"


@pytest.mark.parametrize(("size", "decay", "gap", "cycle"), [(1.2, 0, 1.0, 1), (1.2, 2, 1.0, 0), (0.02, 0, 0.001, 0)])
def test_what_decays_is_no_cycle(size, decay, gap, cycle):
    t = np.arange(2000) * 1e-3
    assert HalfGap(gap, 1e-3, 0.0, 3.0).take_back(2000, size * np.exp(-decay * t) * np.sin(40 * t)) == cycle
