"""How fast the gap in force goes on growing between two answers."""

import math

import pytest

from dtbacklash.config.compose import compose
from dtbacklash.core.library import lib
from dtbacklash.experiment.run import run_scenario
from dtbacklash.experiment.settling import HalfGap, answer_struct
from dtbacklash.twin.gap.estimate import Estimate
from dtbacklash.twin.gap.guard import Attempt, Verdict
from dtbacklash.twin.link.service import Answer


def answer(gap: float, growth: float, std: float = 0.0, growth_std: float = 0.0) -> Answer:
    estimate = Estimate(gap, gap, 0.0, 0.0, std, growth, growth_std, 1, True, "", 0.0)
    return Answer((Attempt(estimate, Verdict(True, ""), gap),), True, 0.0)


@pytest.mark.parametrize(
    ("now", "before", "rate"),
    [
        (answer(1.2, 0.012), answer(1.0, 0.0), 0.012),  # 0.01 rad/s since
        (answer(1.2, 0.05), answer(1.0, 0.0), 0.02),  # at most twice that
        (answer(1.2, 0.012, growth_std=0.004), answer(1.0, 0.0), (0.16 * 0.01 + 0.012) / 1.16),  # weighted
        (answer(1.2, 0.012, growth_std=0.02), answer(1.0, 0.0), (4.0 * 0.01 + 0.012) / 5.0),
        (answer(1.2, 0.007), answer(1.0, 0.0), 0.004),  # it has slowed by 0.003 in 10 s, and goes on
        (answer(1.2, 0.004), answer(1.0, 0.0), 0.0),
        (answer(1.2, 0.05, std=0.1), answer(1.0, 0.0), 0.01),  # 0.01 - 0.005, twice
        (answer(0.9, 0.012), answer(1.0, 0.0), 0.0),
        (answer(0.9, -0.012), answer(1.0, 0.0), -0.01),
        (answer(1.2, 0.012, growth_std=math.inf), answer(1.0, 0.0), 0.0),
    ],
)
def test_it_is_what_the_buffer_and_the_answers_both_show(now, before, rate):
    assert lib.dtb_growth_ahead(answer_struct(now, 20), answer_struct(before, 0), 20.0) == pytest.approx(rate)
    in_force = HalfGap(0.0, 1e-3, 20.0, 3.0)
    assert in_force.put(now, 0, 10)
    assert in_force.segment == (now.gap_rad, 0.0, 10)  # without an answer before it does not grow


def test_it_is_a_ramp_from_the_estimate_to_its_end():
    ramp = ("profile.start_deg=10", "profile.end_deg=80", "profile.t_start_s=0", "profile.t_end_s=100")
    words = ("controller=nimc_twin", "profile=ramp", "duration_s=70", *ramp)
    result = run_scenario(compose(*words, "twin.growth_s=15"))
    trace = result.trace.set_index("t_s")
    believed = trace["gap_hat_deg"]
    rate = (believed[50.0] - believed[48.0]) / 2.0
    assert rate == pytest.approx(0.7, abs=0.03)
    assert believed[50.0] == pytest.approx(trace["gap_deg"][50.0], abs=0.6)
    assert believed[59.0] == believed[56.0]  # 15 s after the middle of the buffer, at 55.5 s
    still = run_scenario(compose(*words, "twin.growth_s=0")).trace["gap_hat_deg"]
    assert still.nunique() == 1 + 3  # before the first answer, and three answers
