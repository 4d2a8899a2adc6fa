"""The guard: each reason for rejection, and a campaign of random buffers, noises, gaps and starts."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from dtbacklash.config.run import OptimizerConfig
from dtbacklash.twin.gap.estimate import Estimate, Problem, default_start, estimate_gap
from dtbacklash.twin.gap.guard import (
    Attempt,
    Guard,
    GuardSettings,
    Verdict,
    guarded_estimates,
    outcome,
    profile,
    warm_up,
)

from ..conftest import PAPER_TWIN, Move, experiment

TRUE_DEG = 50.0
CASES = 120


@pytest.fixture(scope="module")
def change() -> Problem:
    """The 1000 samples after a change from +180 to -180 deg, true gap 50 deg: all that a twin could wish."""
    moves = [Move(0.1, 180.0, 1 / 6), Move(3.0, -180.0, 1 / 6)]
    return experiment(moves, TRUE_DEG, 4.5).problem(3000, 1000, PAPER_TWIN)


def estimated(problem: Problem, gap_deg: float = TRUE_DEG) -> Estimate:
    return estimate_gap(problem, OptimizerConfig(), default_start(problem, np.radians(gap_deg)))


def test_a_good_estimate_passes_and_one_that_agrees_changes_nothing(change: Problem) -> None:
    estimate = estimated(change)
    verdict = Guard(change, np.radians(20.0)).judged(estimate).verdict
    assert (verdict.accepted, verdict.reason) == (True, "better than the present 20.0 deg")
    present = estimate.gap_rad + 2.0 * estimate.std_rad
    attempt = Guard(change, present).judged(estimate)
    assert (attempt.verdict.accepted, attempt.applied_rad) == (True, present)
    assert attempt.verdict.reason == "agrees with the present 50.0 deg"


def test_warm_up_runs_for_any_model() -> None:
    warm_up(PAPER_TWIN, OptimizerConfig())
    warm_up(replace(PAPER_TWIN, settle=0), OptimizerConfig("nelder_mead"))


def test_an_estimate_is_shaded_low_by_its_error(change: Problem) -> None:
    attempt = Guard(change, 0.0).judged(estimated(change))
    assert attempt.estimate.std_rad > 0.0
    assert attempt.applied_rad == pytest.approx(attempt.estimate.gap_rad - attempt.estimate.std_rad, rel=1e-12)
    wide = Guard(change, np.radians(150.0), GuardSettings(shading=1e9)).judged(estimated(change))
    assert wide.applied_rad == 0.0


@pytest.mark.parametrize(("changed", "said"), [
    *(({"gap_rad": np.radians(deg)}, "outside 0..180 deg") for deg in (432.0, 180.5, float("nan"), float("inf"))),
    ({"converged": False, "message": "gave up"}, "not converged: gave up"),
])  # fmt: skip
def test_outside_the_bounds_or_not_converged(change: Problem, changed: dict[str, Any], said: str) -> None:
    verdict = Guard(change, 0.0).judged(replace(estimated(change), **changed)).verdict
    assert not verdict.accepted
    assert said in verdict.reason


def test_no_motion_no_contact() -> None:
    problem = experiment([], 30.0, 1.5).problem(0, 1000, PAPER_TWIN)
    attempts = guarded_estimates(problem, OptimizerConfig(), np.radians(40.0))
    assert not attempts[-1].verdict.accepted
    assert {a.verdict.reason for a in attempts} == {"no contact seen in the buffer"}


def test_motion_within_the_gap() -> None:
    """The motor turns back by 90 of the 100 deg between the flanks: the other flank is not seen."""
    moves = [Move(0.1, 180.0, 1 / 6), Move(3.0, 90.0, 1 / 6)]
    problem = experiment(moves, TRUE_DEG, 4.5).problem(3000, 1000, PAPER_TWIN)
    for present_deg in (0.0, 20.0, TRUE_DEG, 120.0):
        assert not guarded_estimates(problem, OptimizerConfig(), np.radians(present_deg))[-1].verdict.accepted


def test_contact_before_the_cost_looks() -> None:
    """A move that is over long before sample 400 leaves a rest position: any larger gap explains it."""
    moves = [Move(0.1, 60.0, 0.02), Move(0.7, 61.0, 0.02)]
    problem = experiment(moves, 5.0, 2.0).problem(600, 1000, PAPER_TWIN)
    assert not guarded_estimates(problem, OptimizerConfig(), np.radians(40.0))[-1].verdict.accepted


def test_a_point_beside_the_valley(change: Problem) -> None:
    """A search that stopped early leaves a residual; explaining that leads into the valley, or nowhere."""
    wrong = np.radians(TRUE_DEG + 3.0)
    cost, start = profile(change, np.array([wrong]))
    estimate = replace(
        estimated(change), gap_rad=wrong, fit_gap_rad=wrong, theta_d0_rad=float(start[0]), cost_m2=float(cost[0])
    )
    attempt = Guard(change, 0.0).judged(estimate)
    error_deg = np.degrees(attempt.estimate.gap_rad) - TRUE_DEG
    assert abs(error_deg) < 4.0 * np.degrees(attempt.estimate.std_rad)


def test_a_false_valley(change: Problem) -> None:
    """If another gap explains the buffer better, even an estimate in a valley is refused."""
    guard = Guard(change, 0.0)
    guard.scan()[0][20] = 0.0
    verdict = guard.judged(estimated(change)).verdict
    assert (verdict.accepted, verdict.reason) == (False, "120 deg explains the buffer as well")


def test_no_better_than_the_present() -> None:
    """Where noise hides what may be wrong, a difference within the error is no reason to change the controller."""
    moves = [Move(0.1, 180.0, 1 / 6), Move(3.0, -180.0, 1 / 6)]
    measured = experiment(moves, TRUE_DEG, 4.5, q3_noise_m=20e-6, seed=3)
    problem = measured.problem(3000, 1000, PAPER_TWIN)
    judged = Guard(problem, np.radians(TRUE_DEG), GuardSettings(precise_deg=0.1)).judged(estimated(problem))
    assert not judged.verdict.accepted
    assert judged.verdict.reason.startswith("no better than the present 50.0 deg: +- ")
    # no other start can change that: the twin does not try again
    assert len(guarded_estimates(problem, OptimizerConfig(), np.radians(TRUE_DEG), GuardSettings(precise_deg=0.1))) == 1
    # an estimate that is precise enough confirms the present gap instead
    assert Guard(problem, np.radians(TRUE_DEG)).judged(estimated(problem)).verdict.agrees


def test_outcome_is_the_accepted_or_the_best_attempt(change: Problem) -> None:
    estimate = estimated(change)
    rejected, worse = (replace(estimate, cost_m2=c) for c in (1e-12, 1e-9))
    attempts = [Attempt(worse, Verdict(False, "b")), Attempt(rejected, Verdict(False, "a"))]
    assert outcome(attempts).verdict.reason == "a"
    attempts.append(Attempt(worse, Verdict(True, "c")))
    assert outcome(attempts).verdict.reason == "c"


def test_profile_is_the_least_cost_over_the_start(change: Problem) -> None:
    gaps = np.radians([10.0, 45.0, 50.0, 55.0, 120.0, 180.0])
    costs, starts = profile(change, gaps)
    for gap, cost, start in zip(gaps, costs, starts, strict=True):
        tried = [change.cost(gap, change.theta_m[0] + z) for z in np.linspace(-gap, gap, 2001)]
        assert cost <= min(tried) * (1 + 1e-6) + 1e-20
        assert change.cost(gap, start) == pytest.approx(cost, rel=1e-9)


def test_the_twin_tries_again(change: Problem) -> None:
    """From a start at which plain BFGS ends above 180 deg, a further attempt finds the gap."""
    bad = (np.radians(400.0), change.theta_m[0])
    attempts = guarded_estimates(change, OptimizerConfig(), np.radians(20.0), start=bad)
    assert not attempts[0].verdict.accepted
    assert np.degrees(attempts[0].estimate.fit_gap_rad) > 150.0
    assert attempts[-1].verdict.accepted
    assert np.degrees(attempts[-1].estimate.gap_rad) == pytest.approx(TRUE_DEG, abs=0.01)
    once = guarded_estimates(change, OptimizerConfig(), np.radians(20.0), GuardSettings(attempts=1), start=bad)
    assert [a.verdict.accepted for a in once] == [False]


@pytest.mark.parametrize("gap_deg", [0.0, 1.0, 17.0, 50.0, 85.0, 99.0, 100.0])
def test_the_changes_of_a_square_wave_are_all_accepted(gap_deg: float) -> None:
    for sign in (1.0, -1.0):
        to_deg = sign * (180.0 + gap_deg)  # the controller goes on until the screw has arrived
        moves = [Move(0.1, -to_deg, 1 / 6), Move(3.0, to_deg, 1 / 6)]
        problem = experiment(moves, gap_deg, 4.5).problem(3000, 1000, PAPER_TWIN)
        for present_deg in (max(gap_deg - 30.0, 0.0), gap_deg, gap_deg + 10.0):
            attempts = guarded_estimates(problem, OptimizerConfig(), np.radians(present_deg))
            assert attempts[-1].verdict.accepted
            assert np.degrees(attempts[-1].estimate.gap_rad) == pytest.approx(gap_deg, abs=0.02)


def test_no_gap_in_noise_is_accepted() -> None:
    """At gap zero, the bound, the cost has a corner in noise: what goes to the controller is 0, or nearly."""
    moves = [Move(0.1, 180.0, 1 / 6), Move(3.0, -180.0, 1 / 6)]
    for seed in range(20):
        measured = experiment(moves, 0.0, 4.5, q3_noise_m=20e-6, seed=seed)
        last = guarded_estimates(measured.problem(3000, 1000, PAPER_TWIN), OptimizerConfig(), np.radians(20.0))[-1]
        assert last.verdict.accepted
        assert np.degrees(last.applied_rad) < 0.6
        assert last.estimate.gap_rad < 4.0 * last.estimate.std_rad


@dataclass(frozen=True)
class Case:
    """One random case of the campaign, all angles in degrees."""

    true: float
    present: float
    plain: float
    attempts: list[Attempt]
    informative: bool

    @property
    def accepted(self) -> bool:
        return self.attempts[-1].verdict.accepted

    @property
    def harm(self) -> float:
        """How much farther from the truth the controller's gap is after the estimation than before."""
        after = float(np.degrees(self.attempts[-1].applied_rad)) if self.accepted else self.present
        return abs(after - self.true) - abs(self.present - self.true)


def random_case(seed: int) -> Case:
    """A random gap, buffer, noise and start; random moves, some outside the buffer or within the gap."""
    rng = np.random.default_rng([2024, seed])
    true = float(rng.choice([0.0, rng.uniform(0, 120)], p=[0.1, 0.9]))
    times = np.sort(rng.uniform(0.2, 5.0, rng.integers(1, 4)))
    size = rng.choice([20.0, 100.0, 360.0, 600.0])
    moves = [Move(float(t), float(rng.uniform(-size, size)), float(rng.uniform(0.05, 0.3))) for t in times]
    q3_noise, theta_noise = rng.integers(0, 2, 2) * rng.uniform(0, 1, 2) * [5e-6, 1e-3]
    length = int(rng.integers(600, 2001))
    first = int(1000 * times[-1]) if rng.random() < 0.6 else int(rng.integers(0, 5500))
    measured = experiment(moves, true, (first + length) / 1000, q3_noise, theta_noise, seed)
    problem = measured.problem(first, length, PAPER_TWIN)
    present = float(rng.choice([rng.uniform(0, 120), np.clip(true + 3 * rng.standard_normal(), 0, 180), true]))
    gap = np.radians(rng.uniform(0, 400))
    start = (gap, problem.theta_m[0] + rng.uniform(-1, 1) * gap)
    travel = np.sum(np.abs(np.diff(measured.theta_d_rad[first + PAPER_TWIN.settle : first + length])))
    return Case(
        true=true,
        present=present,
        plain=float(np.degrees(estimate_gap(problem, OptimizerConfig(), start).fit_gap_rad)),
        attempts=guarded_estimates(problem, OptimizerConfig(), np.radians(present), start=start),
        informative=bool(travel > np.radians(20.0)),
    )


@pytest.fixture(scope="module")
def campaign() -> list[Case]:
    return [random_case(seed) for seed in range(CASES)]


@pytest.mark.check
def test_campaign_no_accepted_estimate_makes_it_worse(campaign: list[Case]) -> None:
    assert max(case.harm for case in campaign) < 0.5


@pytest.mark.check
def test_campaign_plain_bfgs_fails(campaign: list[Case]) -> None:
    """The same starts without a guard: most make it worse, many are beyond any possible gap."""
    worse = [abs(case.plain - case.true) - abs(case.present - case.true) > 0.5 for case in campaign]
    assert np.mean(worse) > 0.5
    assert np.mean([case.plain > 180.0 for case in campaign]) > 0.25


@pytest.mark.check
def test_campaign_the_guard_is_not_timid_and_needs_its_further_attempts(campaign: list[Case]) -> None:
    informative = [case for case in campaign if case.informative]
    assert len(informative) > 0.15 * CASES
    assert np.mean([case.accepted for case in informative]) > 0.95
    accepted = [case for case in campaign if case.accepted]
    assert sum(len(case.attempts) > 1 for case in accepted) > 0.2 * len(accepted)
