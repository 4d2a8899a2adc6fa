"""Speed as ratios within one process; absolute times are measured by ``python -m studies``."""

import math
import statistics

import numpy as np
import pytest

from dtbacklash.twin.gap.estimate import Problem, default_start, estimate_gap
from dtbacklash.twin.gap.observer import twin_model
from studies.hand_written import HandWritten
from studies.measure import interleaved_s
from studies.scenario import PAPER, SHORT, Scenario, ours, prepare

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def paper() -> Scenario:
    return prepare(*PAPER)


def test_the_contestants_solve_the_same_problem(paper: Scenario) -> None:
    assert np.max(np.abs(ours(paper) - paper.q3_m)) < 1e-10
    for everything in (False, True):
        assert np.max(np.abs(HandWritten(paper, everything)() - paper.q3_m)) < 1e-10
    own = ("duration_s", "reference.period_s")
    short = prepare(*(word for word in SHORT if not word.startswith(own)), *(f"{key}=0.5" for key in own))
    assert np.max(np.abs(HandWritten(short)() - short.q3_m)) < 1e-10


def test_at_most_twelve_times_the_time_of_a_hand_written_loop_that_records_as_much(paper: Scenario) -> None:
    """About seven times (``python -m studies loop``); what a neighbour on the machine takes varies."""
    ours_s, hand_s = interleaved_s([lambda: ours(paper), HandWritten(paper, everything=True)], 25)
    assert ours_s < 12.0 * hand_s


def test_a_long_rest_costs_no_more_than_motion(paper: Scenario) -> None:
    """Time is linear in the length: a motor that creeps to rest on a flank must not be chased by the event search."""
    longer = prepare(*PAPER, "duration_s=400")
    short_s, long_s = interleaved_s([lambda: ours(paper), lambda: ours(longer)], 9)
    assert long_s / short_s < 2.0 * 1.5


def test_an_estimate_costs_less_than_a_run(paper: Scenario) -> None:
    """20 ms where the loop takes 30 ms; the bound of the ratio is the same for any machine."""
    config, trace = paper.config, paper.result.trace
    model = twin_model(paper.structure, config.twin.observer_pole_rad_s, config.sample_time_s, config.twin.settle)
    first = 120_000
    window = slice(first, first + config.twin.buffer)
    buffer = trace["theta_m_rad"].to_numpy()[window], trace["q3_mm"].to_numpy()[window] * 1e-3

    def estimate() -> None:
        problem = Problem(*buffer, model)
        estimate_gap(problem, config.optimizer, default_start(problem, math.radians(20.0)))

    rounds = [interleaved_s([estimate, lambda: ours(paper)], 1) for _ in range(7)]
    assert statistics.median(one / run for one, run in rounds) < 20.0 / 30.0
