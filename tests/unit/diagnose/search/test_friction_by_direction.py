"""Friction that differs by direction is one finding, on recordings of a plain integration of such a law."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.named import Alternative
from dtbacklash.diagnose.result import Diagnosis
from dtbacklash.diagnose.search.objections import distance, unseen
from dtbacklash.physics.effects.body import SAME_AS_LOAD
from dtbacklash.physics.rig import Rig, build_rig

STEP_S, SUBSTEPS, MASS, GAIN, CREEP = 2e-3, 16, 12.0, 25.0, 2e-4
ASYMMETRIC = ("slide", "asymmetric_friction")
FRICTION = {("slide", "viscous_friction"), ("slide", "coulomb_friction")}


@njit
def _rate(v, u, up, down, load):
    """Acceleration of a mass with friction by direction; up, down : (Coulomb level, viscous coefficient)."""
    dry, viscous = up if v > 0.0 else down
    return (GAIN * u - dry * math.tanh(v / CREEP) - viscous * v + load) / MASS


@njit
def _run(r, extra, up, down, load):
    """Position and command of a closed loop, the law integrated by Runge and Kutta's rule."""
    kp, kd, ki = MASS * 900.0 / GAIN, MASS * 42.0 / GAIN, MASS * 5400.0 / GAIN
    x, v, total, last = 0.0, 0.0, 0.0, r[0]
    xs, us, h = np.empty(len(r)), np.empty(len(r)), STEP_S / SUBSTEPS
    for k in range(len(r)):
        e = r[k] - x
        total += ki * e * STEP_S
        xs[k], us[k] = x, kp * e + kd * (e - last) / STEP_S + total + extra[k]
        last = e
        for _ in range(SUBSTEPS):
            a = _rate(v, us[k], up, down, load)
            b = _rate(v + h / 2 * a, us[k], up, down, load)
            c = _rate(v + h / 2 * b, us[k], up, down, load)
            d = _rate(v + h * c, us[k], up, down, load)
            x += h * (v + h / 6 * (a + b + c))
            v += h / 6 * (a + 2 * b + 2 * c + d)
    return xs, us


def recorded(up: tuple, down: tuple, load: float = 0.0, seconds: float = 20.0, seed: int = 41) -> Record:
    """Moves from point to point, some with a pause, beside sines up to 30 Hz; an encoder of a micrometre."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds / STEP_S)) * STEP_S
    r, at, k = np.zeros(len(t)), 0.0, 0
    while k < len(t):
        n, pause = (round(rng.uniform(*span) / STEP_S) for span in ((0.3, 1.0), (0.05, 0.3)))
        to = rng.uniform(-0.15, 0.15)
        s = np.minimum(np.arange(n + pause) / n, 1.0)
        r[k : k + n + pause] = (at + (to - at) * (10 * s**3 - 15 * s**4 + 6 * s**5))[: len(t) - k]
        at, k = to, k + n + pause
    f = rng.uniform(0.5, 30.0, 60)
    extra = np.sin(2 * np.pi * f[:, None] * t + rng.uniform(0, 2 * np.pi, 60)[:, None]).sum(axis=0)
    x, u = _run(r, 0.15 * extra / extra.std(), up, down, load)
    train = np.arange(len(t)) < 0.7 * len(t)
    return Record(STEP_S, u, {"x": 1e-6 * np.round(x / 1e-6)}, train, ~train)


@pytest.fixture(scope="module")
def slide() -> Rig:
    elements = {
        "amplifier": {"kind": "amplifier", "drives": "motor"},
        "motor": {"kind": "actuator", "gain": "K", "drives": "slide"},
        "slide": {"kind": "carriage", "mass": "m"},
    }
    parameters = {"K": ParameterConfig(GAIN, "N/V", 0.03), "m": ParameterConfig(MASS, "kg", 0.03)}
    sensors = {"x": {"of": "slide", "quantity": "position"}}
    return build_rig(RigConfig("gantry", parameters=parameters, elements=elements, sensors=sensors))


def named(found: Diagnosis) -> dict:
    return {(f.location, f.effect): f for f in found.findings}


@pytest.mark.nightly
def test_levels_and_coefficients_that_differ_are_one_finding(slide):
    found = named(diagnose_records(slide, [recorded((14.0, 40.0), (9.0, 25.0))]))
    assert set(found) == {*FRICTION, ASYMMETRIC}
    finding = found[ASYMMETRIC]
    assert finding.parameters["coulomb_difference"].value == pytest.approx(2.5, rel=0.05)
    assert finding.parameters["viscous_difference"].value == pytest.approx(7.5, rel=0.05)
    assert finding.parameters["coulomb_difference"].unit == "N"
    assert finding.sentence.startswith("Friction at the slide is higher by 2.")
    assert finding.sentence.endswith("N s/m in the positive direction and lower by as much in the other.")
    assert ("slide", "constant_force") not in {(a.location, a.effect) for a in finding.also_fits}
    assert found["slide", "coulomb_friction"].parameters["force"].value == pytest.approx(11.5, rel=0.05)


@pytest.mark.nightly
def test_levels_that_differ_alone_may_be_a_load_as_well(slide):
    diagnosis = diagnose_records(slide, [recorded((13.0, 32.0), (10.0, 32.0))])
    found = named(diagnosis)
    assert set(found) == {*FRICTION, ASYMMETRIC}
    finding = found[ASYMMETRIC]
    assert finding.parameters["coulomb_difference"].value == pytest.approx(1.5, rel=0.05)
    assert Alternative("slide", "constant_force", SAME_AS_LOAD) in finding.also_fits
    assert finding.to_json()["also_fits"][-1]["reason"] == SAME_AS_LOAD
    assert finding.sentence.startswith("Dry (Coulomb) friction at the slide is higher by 1.5")
    assert f"constant force at the slide ({SAME_AS_LOAD})" in diagnosis.summary
    (row,) = [c for c in diagnosis.candidates if (c.location, c.effect) == ("slide", "constant_force")]
    assert row.verdict == f"is called asymmetric friction: {SAME_AS_LOAD}"


@pytest.mark.nightly
def test_a_load_that_is_larger_than_the_friction_stays_a_load(slide):
    found = named(diagnose_records(slide, [recorded((2.0, 30.0), (2.0, 30.0), load=-20.0)]))
    assert set(found) == {*FRICTION, ("slide", "constant_force")}
    assert found["slide", "constant_force"].parameters["force"].value == pytest.approx(-20.0, rel=0.02)


def test_one_of_two_differences_is_enough_and_the_other_is_not_spoken_of(slide):
    rig = slide.with_effect(*ASYMMETRIC, {"coulomb_difference": 2.0, "viscous_difference": 0.1})
    evidence = SimpleNamespace(records=[], nominal=slide)
    sure, unsure = (*ASYMMETRIC, "coulomb_difference"), (*ASYMMETRIC, "viscous_difference")
    assert distance(evidence, rig, ASYMMETRIC, {sure: 0.1, unsure: 1.0}) == pytest.approx(20.0)
    assert unseen(evidence, rig, ASYMMETRIC, {sure: 0.1, unsure: 1.0}) == {"viscous_difference"}
    assert unseen(evidence, rig, ASYMMETRIC, {sure: 3.0, unsure: 1.0}) == set()
    assert math.isnan(distance(evidence, rig, ASYMMETRIC, {}))
