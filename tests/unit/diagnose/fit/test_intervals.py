"""Standard errors: directions that the data do not see are as wide as the priors, the others as narrow as the data."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import all_free, apply, nominal_free, standing
from dtbacklash.diagnose.fit.intervals import polished, standard_errors
from dtbacklash.diagnose.fit.problem import Problem
from dtbacklash.diagnose.fit.refit import QUICK, Rounds, fit
from dtbacklash.diagnose.propose.delays import delay_grid
from dtbacklash.diagnose.propose.locate import Bank
from dtbacklash.diagnose.search.grow import scores_about
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.physics.effects.declare import FORMULATION_ERROR
from dtbacklash.physics.simulate import simulate

from ..conftest import STEP_S, command, recorded


def test_masses_and_springs_that_grow_alike_cannot_be_seen(rig):
    evidence = Evidence.gather(rig, [recorded(rig)])
    errors = standard_errors(evidence, fit(evidence, rig, nominal_free(rig)))
    relative = {name: errors["", "", name] / p.value for name, p in rig.config.parameters.items() if p.tolerance}
    # one direction in (m, k, c) is known by the priors of 5, 10 and 20 % only
    expected = 1.0 / np.sqrt(1 / 0.05**2 + 1 / 0.1**2 + 1 / 0.2**2)
    for name in ("m", "k", "c"):
        assert relative[name] == pytest.approx(expected, rel=0.25)
    assert relative["p"] < 1e-4


def test_a_torque_is_known_as_well_as_the_torque_constant(rig):
    """All torques, the inertia and the torque constant may grow alike: the angle shows none of it."""
    truth = rig.with_effect("motor_bearing", "cogging", {"torque": 0.03, "periods": 14.0, "phase": 0.3})
    evidence = Evidence.gather(rig, [recorded(truth)])
    nominal = fit(evidence, rig, nominal_free(rig))
    there = {"torque": 0.03, "periods": 14.0, "phase": 0.3}
    fitted = refit_with(evidence, nominal, [(("motor_bearing", "cogging"), there)])
    errors = standard_errors(evidence, fitted)
    assert errors["motor_bearing", "cogging", "torque"] > 0.01 * 0.03
    assert errors["motor_bearing", "cogging", "periods"] < 1e-3 * 14.0


@pytest.mark.parametrize(("force", "speed"), [(1.0, 0.01), (2.0, 0.01), (1.0, 0.002)])
def test_friction_with_a_corner_does_not_make_a_mass_known_that_only_its_prior_knows(force, speed):
    """By differences of single parameters the force and the masses were known three times better than they can be."""
    stage, there = nominal_rig("two_mass_stage"), {"force": force, "speed": speed}
    truth = stage.with_effect("carriage", "stribeck_friction", there)
    u, rng = 2.0 / force * command(6.0, 1), np.random.default_rng(1)
    shown = simulate(truth, u[:-1], STEP_S).sensors
    train = np.arange(len(u)) < 0.7 * len(u)
    y = {name: shown[name] + rng.normal(0.0, 1e-6, len(u)) for name in ("x_c", "x_t")}
    evidence = Evidence.gather(stage, [Record(STEP_S, u, y, train, ~train)])
    fitted = refit_with(
        evidence, fit(evidence, stage, nominal_free(stage)), [(("carriage", "stribeck_friction"), there)]
    )
    errors, tolerances = standard_errors(evidence, fitted), stage.config.parameters
    expected = 1.0 / np.sqrt(sum(1.0 / tolerances[n].tolerance ** 2 for n in ("K_f", "m_c", "m_t", "k", "c")))
    for name in ("K_f", "m_c", "m_t", "k"):
        assert errors["", "", name] / tolerances[name].value == pytest.approx(expected, rel=0.1)


def test_what_only_the_priors_know_ends_in_their_middle(rig):
    """A fit stops anywhere along the direction in which masses, springs and dampers grow alike."""
    evidence = Evidence.gather(rig, [recorded(rig)])
    free = nominal_free(rig)
    grown = rig.with_parameters({n: 1.04 * rig.config.parameters[n].value for n in ("m", "k", "c")})
    away = fit(evidence, grown, free, np.array([standing(f, grown) for f in free]), rounds=Rounds(0, 0))
    better, about = polished(evidence, away)
    assert better.penalty < 0.2 < away.penalty
    assert all(abs(standing(f, better.rig)) < 0.3 for f in free if f.name in ("m", "k", "c"))
    assert np.array_equal(about.x, better.x)


def test_the_law_is_one_formulation_of_several(rig):
    truth = rig.with_effect("sensor_q3", "offset", {"offset": 1e-3})
    evidence = Evidence.gather(rig, [recorded(truth)])
    nominal = fit(evidence, rig, nominal_free(rig))
    fitted = refit_with(evidence, nominal, [(("sensor_q3", "offset"), {"offset": 1e-3})])
    error = standard_errors(evidence, fitted)["sensor_q3", "offset", "offset"]
    assert error >= FORMULATION_ERROR * 1e-3


def test_a_simulation_that_runs_away_beside_the_fit_leaves_an_interval(rig, monkeypatch):
    evidence = Evidence.gather(rig, [recorded(rig, seconds=4.0)])
    fitted = fit(evidence, rig, nominal_free(rig), rounds=QUICK)
    plain = Problem.precise_jacobian

    def runs_away(problem, x):
        jacobian = plain(problem, x)
        jacobian[3, 0], jacobian[5, 1] = np.nan, np.inf
        return jacobian

    usual = standard_errors(evidence, fitted)
    monkeypatch.setattr(Problem, "precise_jacobian", runs_away)
    for key, error in standard_errors(evidence, fitted).items():
        assert error == pytest.approx(usual[key], rel=0.05)


def test_a_gap_is_known_to_a_fraction_of_itself(rig):
    truth = rig.with_effect("gear", "backlash", {"half_gap": 0.35})
    evidence = Evidence.gather(rig, [recorded(truth)])
    fitted = refit_with(evidence, fit(evidence, rig, nominal_free(rig)), [(("gear", "backlash"), {"half_gap": 0.3})])
    error = standard_errors(evidence, fitted)["gear", "backlash", "half_gap"]
    assert fitted.effects["gear", "backlash"]["half_gap"] == pytest.approx(0.35, abs=max(4 * error, 2e-4))
    assert 0.0 < error < 0.01


@pytest.mark.parametrize("place", ["amplifier", "sensor_q3"])
def test_a_delay_of_a_fiftieth_of_a_sample_has_an_error(rig, place):
    """It is moved by many of the ticks that it is rounded to: else nothing would change."""
    truth = rig.with_effect(place, "delay", {"time": 2e-5})
    evidence = Evidence.gather(rig, [recorded(truth, seconds=6.0)])
    free, x = all_free(evidence, truth)
    problem = Problem(evidence, truth, free)
    problem.weigh(problem.residuals(x))
    column = [f.effect for f in free].index("delay")
    slow, fast = np.linalg.norm(problem.precise_jacobian(x), axis=0), np.linalg.norm(problem.jacobian(x), axis=0)
    assert slow[column] > 0.0
    assert fast[column] == pytest.approx(slow[column], rel=0.1)


def test_a_sensors_delay_starts_at_the_right_sample(rig):
    truth = rig.with_effect("sensor_q3", "delay", {"time": 0.006})
    evidence = Evidence.gather(rig, [recorded(truth)])
    fitted = fit(evidence, rig, nominal_free(rig))
    best = scores_about(Model(evidence, fitted, fitted), Log())[0]
    assert best.candidate.key == ("sensor_q3", "delay")
    starts = delay_grid(best.candidate, Bank(evidence, fitted))
    ends = [refit_with(evidence, fitted, [(best.candidate.key, s)]).effects[best.candidate.key] for s in starts]
    assert min(abs(e["time"] - 0.006) for e in ends) < 2e-5


def test_the_floor_of_a_rough_signal_is_lowered_by_what_a_model_leaves(rig):
    """A current that follows a stepping voltage looks like noise; the residual shows that it is not."""
    record = recorded(rig)
    rng = np.random.default_rng(4)
    command = np.repeat(rng.uniform(-3, 3, record.samples // 3 + 1), 3)[: record.samples]
    shown = simulate(rig, command[:-1], record.sample_time_s).sensors
    measured = {"theta_m": shown["theta_m"], "i_m": shown["i_m"] + rng.normal(0, 1e-4, record.samples)}
    evidence = Evidence.gather(rig, [Record(record.sample_time_s, command, measured, record.train, record.held)])
    assert evidence.noise["i_m"][0] > 5e-4
    quieter = evidence.quieter(fit(evidence, rig, nominal_free(rig)).residuals)
    assert quieter.noise["i_m"][0] == pytest.approx(1e-4, rel=0.15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_last_step_leaves_an_effect_that_it_would_take_away(rig, monkeypatch, sign):
    """At nothing it would be gone from the rig, and what asks for its size would not find it."""
    evidence = Evidence.gather(rig, [recorded(rig, seconds=4.0)])
    key = ("link_1", "quadratic_damping")
    with_it = rig.with_effect(*key, {"c2": 1e-3})
    fitted = fit(evidence, with_it, *all_free(evidence, with_it), rounds=QUICK)
    monkeypatch.setattr(
        "dtbacklash.diagnose.fit.intervals.inverse", lambda jacobian: sign * 1e9 * np.eye(jacobian.shape[1])
    )
    tried = []
    plain = Problem.residuals
    monkeypatch.setattr(Problem, "residuals", lambda problem, x: tried.append(x) or plain(problem, x))
    polished(evidence, fitted)
    free, _ = all_free(evidence, fitted.rig)
    assert len(tried) >= 2
    assert all(apply(fitted.rig, free, x).effect(*key) is not None for x in tried)
