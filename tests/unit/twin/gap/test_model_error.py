"""What a wrong model does to an estimate: the twin believes the paper's structure, the buffer is of another."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtbacklash.config.run import OptimizerConfig
from dtbacklash.control.chain import StructureParameters
from dtbacklash.errors import UserError
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.estimate import Problem, default_start, estimate_gap
from dtbacklash.twin.gap.guard import Explanation, Guard, guarded_estimates
from dtbacklash.twin.gap.model_error import Tolerances, model_terms
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
    start = default_start(problem, np.radians(TRUE_DEG))
    return Guard(problem, 0.0).explained(estimate_gap(problem, OptimizerConfig(), start))


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


def test_the_explaining_model_is_the_fit(buffer: Any) -> None:
    """The twin's cost with the model that explains the buffer is that of the explanation."""
    found = explanation(*buffer(), believing(softer(PAPER, 0.8)))
    rows = found.problem.rows(found.estimate.gap_rad, found.estimate.theta_d0_rad, found.estimate.growth_rad_s)
    assert np.mean(rows[0] ** 2) == pytest.approx(found.estimate.cost_m2, rel=1e-6, abs=1e-20)
    assert found.cost_m2 > found.estimate.cost_m2


@pytest.mark.parametrize("ground", [(), (2e3, 0.0, 5e2)])
@pytest.mark.parametrize("n", [1, 3])
def test_the_terms_make_the_paths_of_any_stiffness_and_damping(n: int, ground: tuple[float, ...]) -> None:
    structure = StructureParameters((5.0, 3.0, 4.0)[:n], (1e4, 2e4, 9e3)[:n], (30.0, 20.0, 9.0)[:n], 3e-4, ground[:n],
                                    tuple(0.01 * k for k in ground[:n]))  # fmt: skip
    psi = np.append([0.1, -0.3, 0.02], np.zeros(2 + n))
    other = replace(softer(structure, np.exp(psi[0])), pitch_m_per_rad=1.02 * structure.pitch_m_per_rad,
                    dampings_n_s_per_m=tuple(np.exp(psi[1]) * c for c in structure.dampings_n_s_per_m))  # fmt: skip
    v = np.zeros((4, 2 * n + 1))
    for (of, soft, damped, pitch, factor), term in model_terms(believing(structure)).items():
        if factor < 0:
            v[of] += np.exp(soft * psi[0] + damped * psi[1]) * (1.0 + psi[2]) ** pitch * term
    u, lags, wanted = np.sin(np.arange(1000.0) / 50.0), believing(structure).lags, believing(other)
    for part, path in ((v[0], wanted.from_q3), (v[1], wanted.from_theta_d)):
        made = observer.Path(lags.phi, part @ lags.b_of, float(part @ lags.d_of), part @ lags.start_of)
        direct = observer.filtered(u, path)
        assert observer.filtered(u, made) == pytest.approx(direct, abs=1e-9 * np.abs(direct).max())


def test_a_twin_of_more_masses_than_the_core_takes_is_refused() -> None:
    with pytest.raises(UserError, match="9 masses"):
        believing(StructureParameters((5.0,) * 9, (1e4,) * 9, (30.0,) * 9, 3e-4))
