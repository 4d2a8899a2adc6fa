"""What a wrong model does to an estimate: the twin believes the paper's structure, the buffer is of another."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtbacklash.config.run import OptimizerConfig
from dtbacklash.control.chain import StructureParameters
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.estimate import Problem, default_start, estimate_gap
from dtbacklash.twin.gap.guard import guarded_estimates
from dtbacklash.twin.gap.model_error import STEPS, Explanation, Tolerances, _Fit, explained
from dtbacklash.twin.gap.observer import TwinModel, twin_model

from ..conftest import PAPER, PAPER_TWIN, Move, experiment

TRUE_DEG = 50.0


@pytest.fixture
def buffer() -> Callable[..., tuple[Any, Any]]:
    """theta_m and q3 of the 1000 samples after a move, on the paper's rig."""

    def measured(noise_m: float = 0.0) -> tuple[Any, Any]:
        moves = [Move(0.1, 230.0, 1 / 6), Move(3.0, -230.0, 1 / 6)]
        m = experiment(moves, TRUE_DEG, 4.5, q3_noise_m=noise_m)
        return m.theta_m_rad[3000:4000], m.q3_m[3000:4000]

    return measured


def believing(structure: StructureParameters) -> TwinModel:
    return twin_model(structure, 40.0, 1e-3, 400)


def softer(structure: StructureParameters, share: float) -> StructureParameters:
    return replace(structure, stiffnesses_n_per_m=tuple(share * k for k in structure.stiffnesses_n_per_m))


def explanation(theta_m: Any, q3: Any, model: TwinModel) -> Explanation:
    problem = Problem(theta_m, q3, model)
    return explained(
        problem, estimate_gap(problem, OptimizerConfig(), default_start(problem, np.radians(TRUE_DEG))), Tolerances()
    )


def test_the_right_model_is_left_as_it_is(buffer: Any) -> None:
    found = explanation(*buffer(), PAPER_TWIN)
    assert not found.doubted
    assert np.degrees(found.estimate.std_rad) < 0.1


@pytest.mark.parametrize("share", [0.75, 1.25])
def test_a_wrong_stiffness_costs_the_gap_nothing(buffer: Any, share: float) -> None:
    found = explanation(*buffer(), believing(softer(PAPER, share)))
    error_deg = np.degrees(found.estimate.gap_rad) - TRUE_DEG
    assert found.doubted
    assert abs(error_deg) < 0.1
    assert abs(error_deg) < np.degrees(found.estimate.std_rad) < 2.0
    # and the guard takes it, where the residual of the believed model is 10 um and more
    last = guarded_estimates(Problem(*buffer(), believing(softer(PAPER, share))), OptimizerConfig(), 0.0)[-1]
    assert last.verdict.accepted


def test_what_looks_like_a_gap_is_not_taken_for_one(buffer: Any) -> None:
    """An offset between the sensors moves the gap by as much as its standard error says, not beyond."""
    theta_m, q3 = buffer(1e-6)
    offset_m = Tolerances().offset_m
    found = explanation(theta_m, q3 + offset_m, PAPER_TWIN)
    assert found.doubted
    moved = offset_m / PAPER_TWIN.pitch_m_per_rad
    assert found.estimate.std_rad > 0.9 * moved
    assert abs(found.estimate.gap_rad - np.radians(TRUE_DEG)) < 2.0 * found.estimate.std_rad


def test_the_derivatives_are_those_of_the_error(buffer: Any) -> None:
    fit = _Fit(Problem(*buffer(), PAPER_TWIN), Tolerances())
    x = np.array([0.9, -3.0, 0.01, 0.1, -0.1, 0.003, 0.01, 2e-6, 5e-6, 1e-5])
    error, jacobian = fit.linearised(x)
    assert np.array_equal(error, fit.error(x))
    for i, size in enumerate([1e-6, None, 1e-6, 1e-5, 1e-5, 1e-6, 1e-5, 1e-9, 1e-9, 1e-9]):
        if size is None:  # theta_d0 is forgotten after the contact
            assert np.abs(jacobian[i]).max() < 1e-9
            continue
        step = np.zeros(x.size)
        step[i] = size
        numeric = (fit.error(x + step) - fit.error(x - step)) / (2.0 * size)
        assert jacobian[i] == pytest.approx(numeric, abs=1e-3 * np.abs(numeric).max())


def test_the_explaining_model_is_the_fit(buffer: Any) -> None:
    """The twin's cost with the model that explains the buffer is that of the explanation."""
    found = explanation(*buffer(), believing(softer(PAPER, 0.8)))
    rows = found.problem.rows(found.estimate.gap_rad, found.estimate.theta_d0_rad, found.estimate.growth_rad_s)
    assert np.mean(rows[0] ** 2) == pytest.approx(found.estimate.cost_m2, rel=1e-6, abs=1e-20)
    assert found.cost_m2 > found.estimate.cost_m2


def test_any_number_of_masses() -> None:
    rng = np.random.default_rng(0)
    theta_m = np.cumsum(rng.normal(0.0, 0.01, 1000))
    for n in (1, 3):
        model = believing(StructureParameters((5.0,) * n, (1e4,) * n, (30.0,) * n, 3e-4))
        fit = _Fit(Problem(theta_m, 3e-4 * theta_m, model), Tolerances())
        x = np.append([0.01, 0.0, 0.0], np.full(5 + n, 1e-6))
        error, jacobian = fit.linearised(x)
        assert np.all(np.isfinite(error))
        assert jacobian.shape == (8 + n, 600)
        assert STEPS > 1


def test_the_lags_are_those_of_the_paths() -> None:
    fit = _Fit(Problem(np.linspace(0, 1, 1000), np.linspace(0, 3e-4, 1000), PAPER_TWIN), Tolerances())
    v = fit.coefficients(np.zeros(7))
    u = np.sin(np.arange(1000.0) / 50.0)
    lagged = np.array([observer.filtered(u, path) for path in PAPER_TWIN.lags])
    for part, path in ((v[:5], PAPER_TWIN.from_q3), (v[5:10], PAPER_TWIN.from_theta_d)):
        direct = observer.filtered(u, path)
        assert part @ lagged == pytest.approx(direct, abs=1e-9 * np.abs(direct).max())
