"""The least-squares problem of a fit, and when it ends."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.free import effect_free, nominal_free
from dtbacklash.diagnose.refit import QUICK, Problem, fit

from .conftest import recorded


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
