"""The least-squares problem of a fit, and when it ends."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import effect_free, nominal_free
from dtbacklash.diagnose.fit.problem import Problem
from dtbacklash.diagnose.fit.refit import QUICK, fit
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

from ..conftest import recorded


@pytest.fixture(scope="module")
def evidence(rig) -> Evidence:
    stiffening = rig.with_effect("link_1", "cubic_stiffness", {"k3": 4e9})
    return Evidence.gather(rig, [recorded(stiffening, 4.0)])


@pytest.fixture
def simulations(monkeypatch) -> list[str]:
    """How finely each simulation of the evidence was made."""
    made: list[str] = []
    plain = Evidence.residuals

    def counted(self, rig, known=None, places=None, steps="fine"):
        made.append(steps)
        return plain(self, rig, known, places, steps)

    monkeypatch.setattr(Evidence, "residuals", counted)
    return made


def test_columns_that_are_kept_take_the_weights_of_the_next_round(evidence):
    rig = evidence.nominal
    free, x = nominal_free(rig), np.zeros(len(nominal_free(rig)))
    left = evidence.residuals(rig)
    kept, fresh = Problem(evidence, rig, free), Problem(evidence, rig, free)
    kept.weigh(left)
    before = kept.jacobian(x)
    less = {name: [0.1 * values for values in there] for name, there in left.items()}
    kept.weigh(less)
    fresh.weigh(less)
    assert not np.allclose(before, fresh.jacobian(x))
    assert np.allclose(kept.jacobian(x), fresh.jacobian(x), rtol=1e-12)


def test_a_fit_finds_what_is_twice_as_large_as_where_it_begins(evidence):
    rig = evidence.nominal.with_effect("link_1", "cubic_stiffness", {"k3": 2e9})
    free = nominal_free(rig) + effect_free(rig, "link_1", "cubic_stiffness", {"k3": 2e9})
    found = fit(evidence, rig, free, rounds=QUICK).rig.effect("link_1", "cubic_stiffness")
    assert found["k3"] == pytest.approx(4e9, rel=0.05)


@pytest.mark.parametrize("times", [3.0, 30.0])
def test_a_fit_comes_back_from_far_too_large_an_effect(times):
    """Its parameters are off as well, since they have stood in for the law: the trust region has to shrink in both."""
    rig, stiffening = nominal_rig("oscillator"), {"k3": 2e6}
    evidence = Evidence.gather(rig, [shaken(rig.with_effect("spring", "cubic_stiffness", stiffening))])
    began = {"k3": times * stiffening["k3"]}
    base = fit(evidence, rig, nominal_free(rig)).rig.with_effect("spring", "cubic_stiffness", began)
    found = fit(evidence, base, nominal_free(rig, rig=base) + effect_free(base, "spring", "cubic_stiffness", began))
    assert evidence.rms(found.residuals) < 1.1
    assert found.rig.effect("spring", "cubic_stiffness") == pytest.approx(stiffening, rel=0.01)


def shaken(truth: Rig) -> Record:
    """15 s of the oscillator under a multisine, 100 samples a second."""
    rng, step, samples = np.random.default_rng(1), 0.01, 1500
    t, f = step * np.arange(samples), np.arange(1, samples // 12) / (samples * step)
    u = np.cos(2.0 * np.pi * f[:, None] * t + rng.uniform(0.0, 2.0 * np.pi, len(f))[:, None]).sum(axis=0)
    u *= 2.0 / u.std() * np.minimum(1.0, np.arange(samples) / 20.0)
    shown = simulate(truth, u[:-1], step).sensors
    y = {name: values + rng.normal(0.0, 2e-3 * values.std(), samples) for name, values in shown.items()}
    train = np.arange(samples) < 0.6 * samples
    return Record(step, u, y, train, ~train)


def test_a_fit_comes_near_by_coarse_steps_and_ends_by_fine_ones(evidence, simulations):
    rig = evidence.nominal.with_effect("link_1", "cubic_stiffness", {"k3": 2e9})
    free = effect_free(rig, "link_1", "cubic_stiffness", {"k3": 2e9})
    ended = fit(evidence, rig, free)
    first_fine = simulations.index("fine")
    assert set(simulations[:first_fine]) == {"coarse"}
    assert first_fine >= 3
    fine = evidence.residuals(ended.rig)
    assert all(np.array_equal(ended.residuals[name], values) for name, values in fine.items())


def test_samples_of_a_part_are_those_of_its_mask(evidence):
    (record,) = evidence.records
    left = evidence.residuals(evidence.nominal)
    mask = np.random.default_rng(0).random(record.samples) < 0.5
    for train in (mask, ~mask, np.zeros_like(mask), np.ones_like(mask)):
        other = replace(evidence, records=[replace(record, train=train)])
        for block in evidence.blocks:
            assert np.array_equal(other.rows(left, block.name, "train"), left[block.name][0][train].T)


def test_within_a_round_a_jacobian_is_mended_and_not_made_again(evidence, simulations):
    rig = evidence.nominal.with_effect("link_1", "cubic_stiffness", {"k3": 2e9})
    free = nominal_free(rig) + effect_free(rig, "link_1", "cubic_stiffness", {"k3": 2e9})
    problem, x = Problem(evidence, rig, free), np.zeros(len(free))
    problem.weigh(problem.residuals(x))
    before = problem.jacobian(x)
    near = x + 1e-3
    here = problem.stack(problem.residuals(x), x)
    change = problem.stack(problem.residuals(near), near) - here
    made = len(simulations)
    mended = problem.jacobian(near)
    assert len(simulations) == made
    assert np.allclose(mended @ (near - x), change, atol=1e-9 * np.abs(change).max())
    assert np.linalg.norm(mended - before) < 0.3 * np.linalg.norm(before)
    # a step that it does not tell takes new differences, as does the next round
    problem._at = (x, here, -before)
    problem.jacobian(near)
    assert len(simulations) > made
    problem.weigh(problem.residuals(near))
    made = len(simulations)
    problem.jacobian(near)
    assert len(simulations) > made
