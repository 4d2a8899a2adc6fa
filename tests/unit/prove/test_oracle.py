"""The oracle on short recordings of the tool's own simulation: what it sees, and the rule by which it sees clearly."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate
from dtbacklash.prove.oracle import Seen, described, look, rebuilt

STEP_S, SECONDS = 1e-3, 5.0
COUNT, NOISE = 2 * np.pi / 4096, 1e-6
BACKLASH = {"location": "gear", "effect": "backlash", "parameters": {"half_gap": 0.3}}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return nominal_rig("lead_screw")


def evidence(nominal: Rig, truth: Rig) -> Evidence:
    """What an encoder and a noisy position sensor show of the true rig, open loop."""
    rng = np.random.default_rng(3)
    n = round(SECONDS / STEP_S) + 1
    t = np.arange(n) * STEP_S
    f = np.arange(1, 100) * 0.15
    u = np.sin(2 * np.pi * f[:, None] * t + rng.uniform(0, 2 * np.pi, len(f))[:, None]).sum(axis=0)
    u *= 2.0 / u.std()
    shown = simulate(truth, u[:-1], STEP_S).sensors
    y = {"theta_m": COUNT * np.round(shown["theta_m"] / COUNT), "q3": shown["q3"] + rng.normal(0, NOISE, n)}
    train = np.arange(n) < 0.7 * n
    return Evidence.gather(nominal, [Record(STEP_S, u, y, train, ~train)])


def secret(kind: str, *effects: dict, **parameters: float) -> dict:
    return {"kind": kind, "effects": list(effects), "parameters": parameters}


def test_it_sees_what_is_large_and_reaches_the_floor(rig):
    truth = rig.with_parameters({"k": 9300.0}).with_effect("gear", "backlash", {"half_gap": 0.3})
    given = evidence(rig, truth)
    seen = look(given, secret("single", BACKLASH, k=9300.0), truth)
    assert seen["clear"] == {"gear.backlash": True}
    held = seen["held_out"]
    assert held["oracle"] < 1.25 < held["recalibrated"] < held["nominal"]
    assert held["extended"] == pytest.approx(held["oracle"], rel=0.05)
    assert look(given, secret("single", BACKLASH, k=9300.0), None)["held_out"]["extended"] != held["extended"]


def test_it_is_not_stuck_where_the_diagnosis_was_not(rig):
    """From a number of teeth that is far off, no fit finds the right one; from the diagnosed rig's it does."""
    there = {"torque": 0.01, "periods": 14.0, "phase": 0.3}
    truth = rig.with_effect("motor_bearing", "cogging", there)
    given = evidence(rig, truth)
    astray = {"location": "motor_bearing", "effect": "cogging", "parameters": {**there, "periods": 10.0}}
    alone, beside = (look(given, secret("single", astray), found)["held_out"]["oracle"] for found in (None, truth))
    assert beside < 1.3 < alone


def test_it_is_fitted_to_as_much_as_the_diagnosis_is_in_the_end(rig):
    """What the diagnosis chooses by, it is fitted to before it is judged; its rig is held against one that is, too."""
    truth = rig.with_parameters({"k": 9300.0})
    (record,) = evidence(rig, truth).records
    part = np.arange(record.samples) / record.samples
    train, judge = part < 0.1, part >= 0.85
    given = Evidence.gather(rig, [replace(record, train=train, held=~train, judge=judge)])
    all_before = Evidence.gather(rig, [replace(record, train=~judge, held=judge)])
    seen, whole = (look(e, secret("parameters", k=9300.0), None)["held_out"] for e in (given, all_before))
    assert seen == pytest.approx(whole, rel=1e-3, nan_ok=True)
    assert whole["recalibrated"] < 1.2


def test_it_does_not_see_what_is_not_there(rig):
    small = {**BACKLASH, "parameters": {"half_gap": 1e-7}}
    seen = look(evidence(rig, rig), secret("single", small), rig)
    assert seen["clear"] == {"gear.backlash": False}


def test_each_of_two_effects_is_left_out_in_turn(rig):
    small = {"location": "link_1", "effect": "cubic_stiffness", "parameters": {"k3": 1.0}}
    truth = rig.with_effect("gear", "backlash", {"half_gap": 0.3}).with_effect("link_1", "cubic_stiffness", {"k3": 1.0})
    seen = look(evidence(rig, truth), secret("several", BACKLASH, small), truth)
    assert seen["clear"] == {"gear.backlash": True, "link_1.cubic_stiffness": False}


def test_a_wrong_parameter_is_clear_where_no_other_can_stand_for_it(rig):
    values = {"k_B": 0.108, "m": 5.25}
    seen = look(evidence(rig, rig.with_parameters(values)), secret("parameters", **values), None)
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
    assert Seen(without, with_it, t).clear is clear


def test_a_rig_survives_its_description(rig):
    changed = rig.with_parameters({"k": 9000.0}).with_effect("link_2", "bumper", {"stiffness": 2e3, "clearance": 1e-4})
    again = rebuilt(rig, described(changed))
    assert again.effects == changed.effects
    assert again.elements == changed.elements


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
    train = np.arange(n) < 0.7 * n
    given = Evidence.gather(rig, [Record(STEP_S, u, run.seen, train, ~train)])
    return look(given, secret("unknown"), rig, run.truth)


def test_the_true_law_beats_the_catalogue_or_does_not():
    """A spring that stiffens with its rate is none of the catalogue's; too small to be seen, it beats nothing."""
    from dtbacklash.prove.simulator.given import Unknown

    rig = nominal_rig("oscillator")
    large, small = (seen_of_unknown(rig, Unknown("spring", "speed_stiffening", s, 0.1)) for s in (0.3, 1e-7))
    assert large["unlisted_clear"]
    ((best, figures),) = large["seen"].items()
    assert best not in ("recalibrated", "diagnosed")
    assert figures["without"] > 1.1 > figures["with"]
    assert not small["unlisted_clear"]
