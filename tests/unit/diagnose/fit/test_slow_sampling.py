"""A machine that is sampled ten times a period, for a few hundred samples."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import effect_free, nominal_free
from dtbacklash.diagnose.fit.problem import Problem
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

STEP_S = 1.0 / 60.0
NOISE = 2e-3
FRICTION = ("mass", "ground_friction", {"force": 1.5})
STIFFENING = ("spring", "cubic_stiffness", {"k3": 2e5})
#: dry friction across a spring to the ground is friction against the ground
SAME = {"ground_friction": {"ground_friction", "dry_friction"}, "cubic_stiffness": {"cubic_stiffness"}}


@pytest.fixture(scope="module")
def oscillator() -> Rig:
    return nominal_rig("oscillator")


def recorded(truth: Rig, samples: int, seed: int) -> Record:
    """Position and speed under a multisine up to a sixth of the sampling rate."""
    rng = np.random.default_rng(seed)
    t, f = np.arange(samples) * STEP_S, np.arange(1, samples // 6) / (samples * STEP_S)
    u = np.cos(2.0 * np.pi * f[:, None] * t + rng.uniform(0.0, 2.0 * np.pi, len(f))[:, None]).sum(axis=0)
    u *= 2.0 / u.std() * np.minimum(1.0, np.arange(samples) / 20.0)
    shown = simulate(truth, u[:-1], STEP_S).sensors
    y = {name: values + rng.normal(0.0, NOISE * values.std(), samples) for name, values in shown.items()}
    train = np.arange(samples) < 0.6 * samples
    return Record(STEP_S, u, y, train, ~train)


@pytest.mark.parametrize("effect", [FRICTION, STIFFENING], ids=lambda effect: effect[1])
@pytest.mark.parametrize("off", [0.5, 1.5])
def test_a_fit_ends_where_the_truth_is(oscillator, effect, off):
    """Masses, springs and the law grow alike nearly unseen: differences that err by a hundredth creep along there."""
    place, name, values = effect
    evidence = Evidence.gather(oscillator, [recorded(oscillator.with_effect(*effect), 1200, 3)])
    began = {p: off * value for p, value in values.items()}
    base = oscillator.with_effect(place, name, began)
    found = fit(evidence, base, nominal_free(oscillator) + effect_free(base, place, name, began))
    assert evidence.rms(found.residuals) < 1.1
    assert found.rig.effect(place, name) == pytest.approx(values, rel=0.01)


def test_columns_of_dry_friction_are_those_of_precise_differences(oscillator):
    evidence = Evidence.gather(oscillator, [recorded(oscillator.with_effect(*FRICTION), 1200, 3)])
    base = oscillator.with_effect("mass", "ground_friction", {"force": 1.8})
    problem = Problem(
        evidence, base, nominal_free(oscillator) + effect_free(base, "mass", "ground_friction", {"force": 1.8})
    )
    x = np.zeros(len(problem.free))
    problem.weigh(problem.residuals(x))
    precise = problem.precise_jacobian(x)
    problem.finely()
    apart = np.linalg.norm(problem.jacobian(x) - precise, axis=0) / np.linalg.norm(precise, axis=0)
    assert apart.max() < 0.25


@pytest.mark.parametrize("samples", [300, 600, 1200])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.nightly
def test_a_short_recording_with_nothing_missing_is_consistent(oscillator, samples, seed):
    found = diagnose_records(oscillator, [recorded(oscillator, samples, seed)])
    assert found.verdict == "consistent"


@pytest.mark.parametrize("effect", [FRICTION, STIFFENING], ids=lambda effect: effect[1])
@pytest.mark.parametrize("samples", [600, 1200])
@pytest.mark.nightly
def test_the_law_of_a_short_recording_is_named_alone(oscillator, effect, samples):
    found = diagnose_records(oscillator, [recorded(oscillator.with_effect(*effect), samples, 1)])
    assert found.verdict == "missing_physics"
    (finding,) = found.findings
    assert finding.effect in SAME[effect[1]]
    (size,) = effect[2].values()
    (estimate,) = finding.parameters.values()
    assert estimate.ci95[0] <= size <= estimate.ci95[1]
