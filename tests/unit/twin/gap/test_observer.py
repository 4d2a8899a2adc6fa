"""The twin's simulation: backlash, observer, cost and derivatives."""

from itertools import pairwise

import control
import numpy as np
import pytest

from dtbacklash.control import chain
from dtbacklash.control.chain import StructureParameters
from dtbacklash.errors import UserError
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.observer import twin_model

from ..conftest import PAPER, PAPER_TWIN, Move, experiment


def slow_play(theta_m: np.ndarray, gap: float, start: float) -> np.ndarray:
    """Eqs (16)-(17) literally: g is 1 only when pushing at a flank, and there theta_d moves with theta_m."""
    out = [start]
    for before, now in pairwise(theta_m):
        sigma, remaining = np.sign(now - before), abs(now - before)
        free = gap - sigma * (before - out[-1])  # way to go before the flank in this direction
        out.append(out[-1] + sigma * max(remaining - max(free, 0.0), 0.0))
    return np.array(out)


@pytest.mark.parametrize("gap", [0.0, 0.1, np.radians(20), 3.0])
def test_play_is_equations_16_and_17(gap: float) -> None:
    t = np.linspace(0, 10, 4001)
    theta_m = (1 + t / 10) * np.sin(2 * np.pi * t)
    assert observer.play(theta_m, gap, 0.0, 0.0) == pytest.approx(slow_play(theta_m, gap, 0.0), abs=1e-12)


def test_play_follows_with_half_the_constant_lag_and_pushes_a_bad_start() -> None:
    theta_m = np.concatenate([np.linspace(0, 5, 100), np.linspace(5, -5, 200)])
    theta_d = observer.play(theta_m, 0.5, 7.0, 0.0)
    assert theta_d[0] == 0.5
    assert theta_d[99] == 4.5
    assert theta_d[-1] == -4.5


def test_play_with_growth_refers_to_the_middle_of_the_buffer() -> None:
    theta_m = np.linspace(0, 10, 101)
    theta_d = observer.play(theta_m, 1.0, -2.0, 0.01)
    assert theta_m[60:] - theta_d[60:] == pytest.approx(1.0 + 0.01 * (np.arange(60, 101) - 50))


def test_output_error_is_that_of_an_observer_with_the_wanted_poles() -> None:
    """Against a Luenberger observer whose gain python-control places, simulated ten times finer."""
    system, fine, n = chain.structure_ss(PAPER), 10, 1500
    gain = np.reshape(control.acker(system.A.T, system.C.T, [-40.0] * 4), (4, 1))
    t = np.arange(n * fine) * 1e-3 / fine
    theta_d, q3 = np.sin(7 * t) + 0.2 * np.sin(31 * t), 1e-3 * np.sin(5 * t)
    closed = control.ss(system.A - gain @ system.C, np.hstack([system.B, gain]), system.C, [[0.0, 0.0]])
    estimated = control.forced_response(closed, t, np.vstack([theta_d, q3])).outputs
    expected = np.array(q3 - np.squeeze(estimated))[::fine]
    model = twin_model(PAPER, 40.0, 1e-3, 0)
    paths = ((q3, model.from_q3), (theta_d, model.from_theta_d))
    actual = sum(observer.filtered(u[::fine].copy(), path) for u, path in paths)
    # from 0.6 s on: until then both forget that they start differently
    assert actual[600:] == pytest.approx(expected[600:], abs=1e-6 * float(np.max(np.abs(expected))) + 2e-8)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_error_vanishes_at_rest_for_any_chain(count: int) -> None:
    structure = StructureParameters((3.0,) * count, (1e4,) * count, (30.0,) * count, 4e-4)
    model = twin_model(structure, 40.0, 1e-3, 0)
    theta_d = np.full(500, 2.0)
    total = observer.filtered(theta_d * 4e-4, model.from_q3) + observer.filtered(theta_d, model.from_theta_d)
    assert np.max(np.abs(total)) < 1e-12
    assert model.from_q3.b.size == 2 * count


def test_true_parameters_leave_nanometres() -> None:
    measured = experiment([Move(0.1, 180.0, 0.2), Move(1.0, -150.0, 0.2)], 40.0, 2.5)
    problem = measured.problem(1000, 1000, PAPER_TWIN)
    rms = np.sqrt(problem.cost(np.radians(40.0), measured.theta_d_rad[1000]))
    assert rms < 5e-9
    assert np.sqrt(problem.cost(np.radians(41.0), measured.theta_d_rad[1000])) > 1e-6


def test_initial_vibration_is_forgotten() -> None:
    """A buffer that opens in mid-swing: the observer needs no initial condition."""
    measured = experiment([Move(0.1, 300.0, 0.02), Move(0.5, 100.0, 0.2)], 10.0, 2.0)
    problem = measured.problem(450, 1000, PAPER_TWIN)
    rows = problem.rows(np.radians(10.0), measured.theta_d_rad[450])
    assert np.max(np.abs(rows[0])) < 5e-7


def test_derivatives_agree_with_differences() -> None:
    measured = experiment([Move(0.1, 180.0, 0.2), Move(1.0, -150.0, 0.3)], 60.0, 2.5)
    problem = measured.problem(1000, 1000, PAPER_TWIN)
    point = np.array([1.0, measured.theta_d_rad[1000] + 0.2, 0.2])
    rows = problem.rows(*point)
    for i in range(3):
        step = np.eye(3)[i] * 1e-6
        difference = (problem.rows(*(point + step))[0] - problem.rows(*(point - step))[0]) / 2e-6
        assert rows[i + 1] == pytest.approx(difference, abs=2e-3 * float(np.max(np.abs(rows[i + 1]))) + 1e-12)
        assert np.max(np.abs(rows[i + 1])) > 1e-6
    path, settle = PAPER_TWIN.from_theta_d, PAPER_TWIN.settle
    value, by_gap, by_start = observer.cost_and_gradient(
        problem.theta_m, problem.eps_q, point[0], point[1], path, settle
    )
    assert value == pytest.approx(problem.cost(point[0], point[1]), rel=1e-10)
    for derivative, step in ((by_gap, (1e-6, 0.0)), (by_start, (0.0, 1e-6))):
        high = problem.cost(point[0] + step[0], point[1] + step[1])
        low = problem.cost(point[0] - step[0], point[1] - step[1])
        assert derivative == pytest.approx((high - low) / 2e-6, rel=1e-3)


def test_cost_is_even_in_the_gap() -> None:
    problem = experiment([Move(0.1, 100.0, 0.2)], 5.0, 1.5).problem(100, 1000, PAPER_TWIN)
    assert problem.cost(-0.3, 0.1) == problem.cost(0.3, 0.1)
    plus, minus = problem.gradient(np.array([20.0, 3.0])), problem.gradient(np.array([-20.0, 3.0]))
    assert plus[0] == minus[0]
    assert plus[1][0] == pytest.approx(-minus[1][0])


def test_wrong_pole_is_named() -> None:
    with pytest.raises(UserError, match="observer_pole_rad_s=0"):
        twin_model(PAPER, 0.0, 1e-3, 400)
