"""The predictive controller: its moves beside exact solvers', its gain beside python-control's, and what it does."""

import control
import numpy as np
import pytest
from scipy import optimize

from dtbacklash.config.compose import compose
from dtbacklash.control import observer, predictive, rivals
from dtbacklash.control.belief import beliefs_of, design_for, settled
from dtbacklash.control.laws import build_controller, control_step, new_controller_state
from dtbacklash.experiment.run import run_scenario

BELIEFS = beliefs_of(compose("controller=mpc"))
CONFIG = settled(compose("controller=mpc", "controller.limit_v=3"), BELIEFS)
BELIEF = BELIEFS.design
LINEAR, STEP, LIMIT_V = BELIEF.linear(), 1e-3, 3.0


def moves(x):
    """Of the compiled controller in the state x: the whole plan, V."""
    controller = build_controller(CONFIG.controller, design_for(CONFIG, BELIEF))
    state = new_controller_state(controller)
    state.law[:] = x
    control_step(controller, state, 0.0, 0.0, 0.0, 0.0)
    return controller, state.moves[0].copy()


def states():
    """Twenty states of motor and structure from which the limit binds in a part of the moves."""
    rng = np.random.default_rng(3)
    law = predictive.mpc_law(LINEAR.motor, LINEAR.structure, 1 / 6, STEP, (0.0, 0.0))
    for _ in range(20):
        x = np.zeros(law.C.size)
        x[-1], x[-2], x[1] = rng.normal(0.0, 3e-4), rng.normal(0.0, 0.3), rng.normal(0.0, 20.0)
        yield x


def test_the_moves_are_those_of_an_active_set_solver():
    bound = 0
    for x in states():
        controller, found = moves(x)
        root = np.linalg.cholesky(controller.lh).T
        wanted = optimize.lsq_linear(
            root, -np.linalg.solve(root.T, controller.lf @ x), (-LIMIT_V, LIMIT_V), "bvls", tol=1e-14
        ).x
        assert found == pytest.approx(wanted, abs=1e-6)
        bound += int(0 < np.sum(np.abs(wanted) > LIMIT_V - 1e-9) < wanted.size)
    assert bound > 5


def test_the_moves_are_those_of_osqp():
    osqp = pytest.importorskip("osqp")
    sparse = pytest.importorskip("scipy.sparse")
    for x in states():
        controller, found = moves(x)
        unit = controller.search[0]  # scaled to a largest curvature of 1
        solver = osqp.OSQP()
        n = len(found)
        solver.setup(
            sparse.csc_matrix(np.triu(unit * controller.lh)), unit * controller.lf @ x,
            sparse.identity(n, format="csc"), np.full(n, -LIMIT_V), np.full(n, LIMIT_V), verbose=False,
            eps_abs=1e-9, eps_rel=1e-9, max_iter=20000,
        )  # fmt: skip
        assert found == pytest.approx(solver.solve().x, abs=1e-5)


def test_without_a_limit_it_is_the_feedback_of_python_control(monkeypatch):
    monkeypatch.setattr(predictive, "SAMPLES", 1)
    a, b, c = observer.plant(LINEAR.motor, LINEAR.structure, STEP)
    law = predictive.mpc_law(LINEAR.motor, LINEAR.structure, 1 / 6, STEP, (0.0, 0.0))
    gain, _, _ = control.dlqr(a, b[:, None], np.outer(c[1], c[1]) / rivals.ERROR_M**2, [[1 / rivals.EFFORT_V**2]])
    assert law.C[: b.size] == pytest.approx(-gain[0], rel=1e-4)
    assert law.C[b.size] == pytest.approx(-gain[0] @ c[0], rel=1e-4)  # an offset is a turn of the motor


@pytest.mark.parametrize(("gap_deg", "limit_v"), [(0, 12), (0, 1.5), (100, 12)])
def test_it_settles_without_overshoot_within_its_limit_and_nothing_is_left_over(gap_deg, limit_v):
    words = ("profile=constant", f"profile.start_deg={gap_deg}", "reference.period_s=8", "duration_s=11")
    result = run_scenario(compose("controller=mpc", f"controller.limit_v={limit_v}", *words))
    assert result.summary["overshoot_pct_max"] < (3.0 if limit_v < 2 else 0.3)
    assert result.summary["settling_time_s_max"] < (1.3 if limit_v < 2 else 0.9)
    assert result.summary["peak_voltage_v"] <= limit_v
    assert abs(result.trace["q3_mm"].iloc[-1] - result.trace["r_mm"].iloc[-1]) < 1e-4
