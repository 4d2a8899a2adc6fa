"""The twin that simulates finds the gap where a linear one is misled by effects behind the gear."""

import numpy as np
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief
from dtbacklash.experiment.run import run_scenario
from dtbacklash.physics.rig import build_rig
from dtbacklash.twin.gap.estimate import Problem, default_start, estimate_gap
from dtbacklash.twin.gap.observer import twin_model
from dtbacklash.twin.gap.simulated import SimulatedProblem, Structure, corrected

GAP_DEG = 30.0
LOOP = ("controller=nimc_fixed", f"controller.gap_hat_deg={GAP_DEG:g}", "profile=constant",
        f"profile.start_deg={GAP_DEG:g}", "duration_s=22", "figures=false")  # fmt: skip


def problem(*effects: str, believed: bool = True) -> SimulatedProblem:
    """The buffer after the change of the reference at 20 s; ``believed`` : whether the twin knows of the effects."""
    run = run_scenario(compose(*LOOP, *effects))
    rig = build_rig(compose(*(effects if believed else ())).rig)
    model = twin_model(Belief(rig).linear().structure, 40.0, 1e-3, 400)
    structures = [Structure.of(rig, rig.sensors["q3"], 1e-3, linear) for linear in (False, True)]
    theta_m, q3 = (run.seen[name][20_000:21_000] for name in ("theta_m", "q3"))
    return SimulatedProblem(theta_m, q3, model, *structures)


def gap_deg(one: Problem) -> float:
    return float(np.degrees(estimate_gap(one, compose().optimizer, default_start(one, np.radians(20.0))).gap_rad))


EFFECTS = [
    "rig.effects.mass_3.ground_friction.force=0.2",
    "rig.effects.screw.pitch_error.amplitude=5e-5",
    "rig.effects.link_1.cubic_stiffness.k3=1e9",
]


@pytest.mark.parametrize("effect", EFFECTS)
def test_what_is_known_does_not_mislead_it(effect):
    assert gap_deg(problem(effect)) == pytest.approx(GAP_DEG, abs=0.05)


@pytest.mark.parametrize("effect", EFFECTS[:2])
def test_what_is_not_known_does(effect):
    assert abs(gap_deg(problem(effect, believed=False)) - GAP_DEG) > 2.0


def test_without_effects_both_twins_say_the_same():
    simulated = problem()
    plain = Problem(simulated.theta_m, simulated.q3, simulated.model)
    assert gap_deg(simulated) == pytest.approx(gap_deg(plain), abs=1e-3)
    point = np.radians(25.0), simulated.theta_m[0] - np.radians(10.0), 0.01
    apart, scale = np.abs(simulated.rows(*point) - plain.rows(*point)), np.abs(plain.rows(*point))
    # where the screw rested is forgotten after the first contact: there both derivatives are next to nothing
    assert np.all(apart.max(axis=1) < 1e-3 * scale.max(axis=1) + 1e-7)


def test_the_gradient_is_that_of_the_cost():
    simulated = problem(EFFECTS[0])
    x, h = np.array([22.0, -3.0]), np.array([0.5, 0.0])
    value, slope = simulated.gradient(x)
    rad = np.pi / 180.0

    def cost(at):
        return simulated.cost(at[0] * rad, simulated.theta_m[0] + at[1] * rad) / simulated.unit_m2

    assert value == pytest.approx(cost(x), rel=1e-9)
    assert slope[0] == pytest.approx(cost(x + h) - cost(x - h), rel=0.02)


def test_the_guard_sees_the_buffer_without_what_the_effects_change():
    plain = corrected(problem(EFFECTS[0]), compose().optimizer, np.radians(5.0))
    assert type(plain) is Problem
    assert gap_deg(plain) == pytest.approx(GAP_DEG, abs=0.05)
