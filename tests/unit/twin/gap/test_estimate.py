"""Estimation of the gap by every optimiser, from data whose truth is known."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from dtbacklash.config.choices import OPTIMIZERS as CONFIGURED
from dtbacklash.errors import UserError
from dtbacklash.twin.gap.estimate import OPTIMIZERS, Problem, default_start, estimate_gap

from ..conftest import PAPER_TWIN, Move, experiment


@dataclass
class Optimizer:
    name: str = "bfgs"
    max_evaluations: int = 200
    tolerance: float = 1e-6


@pytest.fixture(scope="module")
def moved() -> Callable[..., Any]:
    """A buffer after a change from +180 to -180 deg, for a gap and noise."""

    def build(gap_deg: Any, **noise: float) -> Any:
        return experiment([Move(0.1, 180.0, 1 / 6), Move(3.0, -180.0, 1 / 6)], gap_deg, 4.5, **noise)

    return build


def test_registry_offers_what_the_config_allows() -> None:
    assert set(OPTIMIZERS) == set(CONFIGURED)


@pytest.mark.parametrize("name", list(OPTIMIZERS))
@pytest.mark.parametrize("gap_deg", [0.0, 3.0, 50.0, 80.0])
def test_every_optimizer_finds_the_gap(moved: Callable[..., Any], name: str, gap_deg: float) -> None:
    problem = moved(gap_deg).problem(3000, 1000, PAPER_TWIN)
    settings = Optimizer(name, 2000 if "_" in name else 200)
    estimate = estimate_gap(problem, settings, default_start(problem, np.radians(30.0)))
    assert estimate.converged
    assert np.degrees(estimate.gap_rad) == pytest.approx(gap_deg, abs=0.02)
    assert estimate.evaluations <= settings.max_evaluations
    assert estimate.gap_rad >= 0.0


@pytest.mark.parametrize("start_deg", [5.0, 30.0, 120.0])
def test_bfgs_takes_the_steps_of_scipy(moved: Callable[..., Any], start_deg: float) -> None:
    problem = moved(50.0, q3_noise_m=5e-6, seed=1).problem(3000, 1000, PAPER_TWIN)
    start = default_start(problem, np.radians(start_deg))
    found = estimate_gap(problem, Optimizer(), start)
    x0 = np.degrees([start[0], start[1] - problem.theta_m[0]])
    theirs = minimize(problem.gradient, x0, jac=True, method="BFGS", options={"gtol": 1e-6})
    assert np.degrees(found.fit_gap_rad) == pytest.approx(abs(theirs.x[0]), abs=1e-6)
    assert found.evaluations == theirs.nfev
    assert found.message.startswith("no element") == theirs.success


def test_global_methods_are_repeatable_and_need_no_good_start(moved: Callable[..., Any]) -> None:
    problem = moved(70.0).problem(3000, 1000, PAPER_TWIN)
    for name in ("differential_evolution", "dual_annealing"):
        runs = [
            estimate_gap(problem, Optimizer(name, 1000), (3.0, problem.theta_m[0] - 2.9), np.random.default_rng(4))
            for _ in range(2)
        ]
        assert runs[0].gap_rad == runs[1].gap_rad
        assert np.degrees(runs[0].gap_rad) == pytest.approx(70.0, abs=0.05)


@pytest.mark.parametrize("gap_deg", [0.0, 17.0, 51.0, 84.0])
def test_a_growing_gap_is_estimated_without_bias(moved: Callable[..., Any], gap_deg: float) -> None:
    """At the fastest growth of the paper's profile the estimate is the gap in the middle of the buffer."""
    measured = moved(lambda t: gap_deg + np.clip(1.875 * (t - 3.0), 0.0, None))
    estimate = estimate_gap(measured.problem(3000, 1000, PAPER_TWIN), Optimizer(), (np.radians(gap_deg), 0.0))
    truth = float(np.degrees(measured.gap_rad[3500]))
    assert np.degrees(estimate.gap_rad) == pytest.approx(truth, abs=0.05)
    assert np.degrees(estimate.growth_rad_s) == pytest.approx(1.875, abs=0.1)
    # without the correction it would be that of a tenth of a second later
    assert np.degrees(estimate.fit_gap_rad) - truth == pytest.approx(0.19, abs=0.06)


def test_standard_error_covers_the_scatter(moved: Callable[..., Any]) -> None:
    errors, stds = [], []
    for seed in range(30):
        measured = moved(40.0, q3_noise_m=5e-6, seed=seed)
        estimate = estimate_gap(measured.problem(3000, 1000, PAPER_TWIN), Optimizer(), (0.6, -2.0))
        errors.append(np.degrees(estimate.fit_gap_rad) - 40.0)
        stds.append(np.degrees(estimate.std_rad))
    assert abs(np.mean(errors)) < 3 * np.std(errors) / np.sqrt(30) + 1e-3
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) / np.median(stds) < 1.5
    assert np.median(stds) < 0.1


def test_blind_data_have_no_standard_error() -> None:
    problem = experiment([], 30.0, 1.5).problem(0, 1000, PAPER_TWIN)
    assert np.isinf(estimate_gap(problem, Optimizer(), (0.5, 0.0)).std_rad)


def test_spent_evaluations_are_reported(moved: Callable[..., Any]) -> None:
    problem = moved(50.0).problem(3000, 1000, PAPER_TWIN)
    estimate = estimate_gap(problem, Optimizer(max_evaluations=3), (np.radians(5.0), problem.theta_m[0]))
    assert estimate.evaluations == 3
    assert not estimate.converged
    assert "3 evaluations" in estimate.message


def test_default_start_reads_the_rest_position(moved: Callable[..., Any]) -> None:
    problem = moved(50.0).problem(3000, 1000, PAPER_TWIN)
    gap, theta_d0 = default_start(problem, 0.0)
    assert np.degrees(gap) == pytest.approx(50.0, abs=1.0)
    assert np.degrees(problem.theta_m[0] - theta_d0) == pytest.approx(50.0, abs=1.0)
    assert default_start(problem, 2.0)[0] == 2.0


def test_bad_buffers_are_refused(moved: Callable[..., Any]) -> None:
    good = np.zeros(1000)
    bad = good.copy()
    bad[10] = np.nan
    for theta_m, q3 in ((good, good[:-1]), (good[:400], good[:400]), (good, bad), (bad, good)):
        with pytest.raises(UserError, match=r"twin\.buffer"):
            Problem(theta_m, q3, PAPER_TWIN)
    with pytest.raises(UserError, match=r"optimizer\.name=simplex"):
        estimate_gap(Problem(good, good, PAPER_TWIN), Optimizer("simplex"), (0.0, 0.0))
