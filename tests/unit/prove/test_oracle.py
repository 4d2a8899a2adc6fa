"""The oracle on short recordings of the tool's own simulation: what it sees, and the rule by which it sees clearly."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.records import Record
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.prove.oracle import HELD_OUT, Oracle, Sight, better, compared, look

STEP_S, SECONDS = 1e-3, 3.0
COUNT, NOISE = 2 * np.pi / 4096, 1e-6
BACKLASH = {"location": "gear", "effect": "backlash", "parameters": {"half_gap": 0.3}}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return nominal_rig("lead_screw")


def recorded(truth: Rig) -> Record:
    """What an encoder and a noisy position sensor show of a rig, open loop."""
    rng = np.random.default_rng(3)
    n = round(SECONDS / STEP_S) + 1
    t = np.arange(n) * STEP_S
    f = np.arange(1, 100) * 0.15
    u = np.sin(2 * np.pi * f[:, None] * t + rng.uniform(0, 2 * np.pi, len(f))[:, None]).sum(axis=0)
    u *= 2.0 / u.std()
    shown = simulate(truth, u[:-1], STEP_S).sensors
    y = {"theta_m": COUNT * np.round(shown["theta_m"] / COUNT), "q3": shown["q3"] + rng.normal(0, NOISE, n)}
    train = np.arange(n) < 0.7 * n
    return Record(STEP_S, u, y, train, ~train)


def secret(kind: str, *effects: dict, **parameters: float) -> dict:
    return {"kind": kind, "effects": list(effects), "parameters": parameters}


def test_it_sees_what_is_large_and_leaves_the_noise(rig):
    truth = rig.with_parameters({"k": 9300.0}).with_effect("gear", "backlash", {"half_gap": 0.3})
    given, hidden = recorded(truth), secret("single", BACKLASH, k=9300.0)
    seen = look(rig, given, hidden, truth)
    assert seen["clear"] == {"gear.backlash": True}
    held = seen["held_out"]
    assert held["oracle"] < 1.25 < held["recalibrated"] < held["nominal"]
    assert held["extended"] == pytest.approx(held["oracle"], rel=0.05)
    assert np.isnan(look(rig, given, hidden, None)["held_out"]["extended"])


def test_it_is_not_stuck_where_the_diagnosis_was_not(rig):
    """From a number of teeth that is far off, no fit finds the right one; from the diagnosed rig's it does."""
    there = {"torque": 0.01, "periods": 14.0, "phase": 0.3}
    truth = rig.with_effect("motor_bearing", "cogging", there)
    oracle, key = Oracle(rig, recorded(truth)), ("motor_bearing", "cogging")
    stuck = oracle.fit(rig.with_effect(*key, {**there, "periods": 10.0}), [key])
    found = better(oracle, stuck, truth)
    assert found.score < stuck.score - 1000.0
    assert found.rig.effect(*key)["periods"] == pytest.approx(14.0, rel=1e-2)
    assert better(oracle, stuck, None) is better(oracle, stuck, rig) is stuck


def test_what_is_held_out_is_not_fitted_to(rig):
    given = recorded(rig.with_parameters({"k": 9300.0}))
    last = np.arange(given.samples) >= (1.0 - HELD_OUT) * given.samples + 5
    astray = replace(given, y={**given.y, "q3": given.y["q3"] + 1e-3 * last})
    oracles = [Oracle(rig, record) for record in (given, astray)]
    assert np.array_equal(*(o.segments.predictors[0].readings.y for o in oracles))
    model = oracles[0].fit(rig, ())
    errors = [o.held_out(model.rig, model.noise_levels) for o in oracles]
    assert errors[0] < 1.2 < errors[1]


def test_it_does_not_see_what_is_not_there(rig):
    small = {**BACKLASH, "parameters": {"half_gap": 1e-7}}
    assert look(rig, recorded(rig), secret("single", small), rig)["clear"] == {"gear.backlash": False}


def test_each_of_two_effects_is_left_out_in_turn(rig):
    small = {"location": "link_1", "effect": "cubic_stiffness", "parameters": {"k3": 1.0}}
    truth = rig.with_effect("gear", "backlash", {"half_gap": 0.3}).with_effect("link_1", "cubic_stiffness", {"k3": 1.0})
    seen = look(rig, recorded(truth), secret("several", BACKLASH, small), truth)
    assert seen["clear"] == {"gear.backlash": True, "link_1.cubic_stiffness": False}


def test_what_adds_states_is_left_out_with_its_gains():
    """An absorber is a body more: the rig without it has other gains at the same sizes."""
    rig = nominal_rig("lead_screw")
    hidden = {
        "location": "mass_3",
        "effect": "absorber",
        "parameters": {"mass": 1.0, "frequency": 8.0, "damping_ratio": 0.02},
    }
    truth = rig.with_effect("mass_3", "absorber", hidden["parameters"])
    seen = look(rig, recorded(truth), secret("single", hidden), None)
    assert seen["clear"] == {"mass_3.absorber": True}
    assert seen["seen"]["mass_3.absorber"]["without"] < 1e6


def test_a_wrong_parameter_is_clear_where_no_other_can_stand_for_it(rig):
    values = {"k_B": 0.108, "m": 5.25}
    seen = look(rig, recorded(rig.with_parameters(values)), secret("parameters", **values), None)
    assert seen["clear_parameters"] == {"k_B": True, "m": False}
    assert seen["clear"] == {}


@pytest.mark.parametrize(
    ("without", "with_it", "t", "clear"),
    [
        (3.0, 2.0, 3.0, True), (3.0, 2.01, 3.0, False), (3.0, 1.0, 2.9, False), (1.1, 0.9, 5.0, True),
        (0.9, 0.8, 9.0, False),
    ],
)  # fmt: skip
def test_the_rule_of_clear(without, with_it, t, clear):
    assert Sight(without, with_it, t).clear is clear
    assert not Sight(without, with_it, t, to_spare=-1.0).clear


def test_one_channel_is_enough_and_what_is_read_in_counts_may_leave_less_than_white_noise_does():
    rng = np.random.default_rng(0)
    best = rng.normal(0.0, (1.0, 0.2), (12_000, 2))
    found = compared(best * (1.0, 2.0), best)
    assert found.clear
    assert found.with_it == pytest.approx(1.0)
    assert found.without == pytest.approx(4.0, rel=1e-6)
    assert not compared(best, best * (1.0, 2.0)).clear


def seen_of_unknown(rig, truth):
    """What the oracle says of physics beyond the catalogue, on short recordings of the second simulator."""
    from dtbacklash.prove.simulator.given import Errors, Loop
    from dtbacklash.prove.simulator.rig import simulate_other

    rng, n = np.random.default_rng(3), round(SECONDS / STEP_S) + 1
    t = np.arange(n) * STEP_S
    u = np.sin(2 * np.pi * np.outer(np.arange(1, 40) * 0.3, t) + rng.uniform(0, 6.3, 39)[:, None]).sum(axis=0)
    u *= 1.0 / u.std()
    noise = {"x": 1e-6, "v": 1e-4}
    loop = Loop(False, u, np.zeros(n), np.zeros(n))
    run = simulate_other(rig, loop, STEP_S, Errors(noise, {}, rng.standard_normal((n, 2))), truth)
    return look(rig, Record(STEP_S, u, run.seen, t < 2.0, t >= 2.0), secret("unknown"), rig, run.truth)


def test_the_true_law_beats_the_catalogue_or_does_not():
    """A spring that stiffens with its rate is none of the catalogue's; too small to be seen, it beats nothing."""
    from dtbacklash.prove.simulator.given import Unlisted

    rig = nominal_rig("oscillator")
    large, small = (seen_of_unknown(rig, Unlisted("spring", "speed_stiffening", s, 0.1)) for s in (0.3, 1e-7))
    assert large["unlisted_clear"]
    ((best, figures),) = large["seen"].items()
    assert best not in ("recalibrated", "diagnosed")
    assert figures["without"] > 1.1 > figures["with"]
    assert not small["unlisted_clear"]
