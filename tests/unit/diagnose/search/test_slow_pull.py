"""The last fit by a slow pull: taken where it keeps what was found."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.search import slow_pull
from dtbacklash.diagnose.search.model import Model, Named

from ..conftest import recorded


@pytest.fixture(scope="module")
def evidence(rig) -> Evidence:
    return Evidence.gather(rig, [recorded(rig, 4.0)])


def leaving(evidence: Evidence, floors: float) -> Fit:
    """A fit that leaves noise, and so much of another origin that it is so many floors."""
    rng, nominal = np.random.default_rng(1), fit(evidence, evidence.nominal, [])
    more = np.sqrt(floors**2 - 1.0)
    residuals = {
        name: [rng.normal(0.0, 1.0, r.shape) + more * rng.normal(0.0, 1.0, r.shape) for r in there]
        for name, there in nominal.residuals.items()
    }
    return replace(nominal, residuals=residuals)


@pytest.mark.parametrize(
    ("before", "after", "taken"),
    [(1.0, 3.0, False), (1.0, 1.001, True), (1.0, 1.2, False), (5.0, 5.2, True), (5.0, 12.0, False), (3.0, 1.0, True)],
)
def test_a_slow_fit_is_taken_where_the_fit_that_was_compared_does_not_lead_it(
    evidence, monkeypatch, before, after, taken
):
    compared, slowly = leaving(evidence, before), leaving(evidence, after)
    monkeypatch.setattr(slow_pull, "slow_evidence", replace)
    monkeypatch.setattr(slow_pull, "refit_with", lambda *args, **how: slowly)
    monkeypatch.setattr(slow_pull, "polished", lambda given, fitted: (fitted, None))
    monkeypatch.setattr(slow_pull, "seen_by", lambda given, fitted: fitted)
    rig = evidence.nominal.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    model = Model(evidence, compared, replace(compared, rig=rig), (Named(("motor_bearing", "coulomb_friction")),))
    found, seen, fitted, _ = slow_pull.refit_slowly(model)
    assert (seen is not evidence, fitted is slowly, found.fitted is slowly) == (taken, taken, taken)
