"""PID and LQG: their laws beside python-control's, and what they do on the rig without a gap."""

import control
import numpy as np
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.control import rivals
from dtbacklash.control.belief import beliefs_of
from dtbacklash.control.design import reduced_structure
from dtbacklash.experiment.run import run_scenario

CONFIG = compose("controller=imc")
LINEAR = beliefs_of(CONFIG).design.linear()
K_THETA, TAU_R, STEP = 15.0, 1 / 6, 1e-3


def free(law):
    """The law within its limit: u from (r, theta_m, q3), as a system of python-control."""
    return control.ss(law.A + np.outer(law.E, law.C), law.B + np.outer(law.E, law.D), law.C[None], law.D[None], STEP)


def test_the_pid_is_the_sampled_controller_of_its_rules():
    pole = reduced_structure(LINEAR.structure).poles()[0]
    tau, zeta = 1 / abs(pole), -pole.real / abs(pole)
    p = LINEAR.structure.pitch_m_per_rad
    s = control.tf("s")
    gain, ti, td = 2 * zeta * tau / (p * TAU_R), 2 * zeta * tau, tau / (2 * zeta)
    wanted = control.c2d(gain * (1 + 1 / (ti * s) + td * s) / (0.1 * td * s + 1), STEP, "zoh")
    law = free(rivals.pid_law(LINEAR.structure, K_THETA, TAU_R, STEP))
    omega = np.geomspace(0.1, 1000, 50)
    found = control.frequency_response(law, omega).complex
    assert found[0, 0] == pytest.approx(K_THETA * wanted(np.exp(1j * omega * STEP)), rel=1e-6)
    assert found[0, 2] == pytest.approx(-found[0, 0], rel=1e-9)


def test_the_lqg_feeds_back_the_gain_of_python_control_and_its_loop_is_stable():
    law = rivals.lqg_law(LINEAR.motor, LINEAR.structure, TAU_R, STEP)
    a, b, c = rivals.plant(LINEAR.motor, LINEAR.structure, STEP)
    n = b.size
    wide = np.block([[a, np.zeros((n, 1))], [-STEP * c[1:], np.ones((1, 1))]])
    cost = np.zeros((n + 1, n + 1))
    cost[:n, :n] = np.outer(c[1], c[1]) / rivals.ERROR_M**2
    cost[n, n] = 1 / (rivals.ERROR_M * TAU_R) ** 2
    gain, _, poles = control.dlqr(wide, np.append(b, 0.0)[:, None], cost, [[1 / rivals.EFFORT_V**2]])
    assert pytest.approx(-gain[0], rel=1e-4) == law.C
    own = free(law)
    loop = np.block([[a, np.outer(b, law.C)], [np.asarray(own.B)[:, 1:] @ c, own.A]])
    found = np.linalg.eigvals(loop)
    assert np.abs(found).max() < 1.0
    for pole in poles:  # separation: the poles of the feedback are among those of the loop
        assert np.abs(found - pole).min() < 1e-5


@pytest.mark.parametrize(("name", "limit_v", "settles_s"), [("pid", 12, 0.65), ("pid", 6, 1.2), ("lqg", 12, 0.9),
                                                             ("lqg", 1.5, 1.2)])  # fmt: skip
def test_without_a_gap_they_settle_also_at_a_limit_that_they_reach(name, limit_v, settles_s):
    words = ("profile=constant", "profile.start_deg=0", "reference.period_s=6", "duration_s=6")
    result = run_scenario(compose(f"controller={name}", f"controller.limit_v={limit_v}", *words))
    assert result.summary["overshoot_pct_max"] < 2.0
    assert result.summary["settling_time_s_max"] < settles_s
    assert result.summary["peak_voltage_v"] <= limit_v
    assert result.summary["margins"]["small_gain"] < 1.0
