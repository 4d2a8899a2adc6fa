"""The last fit by a slow pull: taken where it keeps what was found."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.search.slow_pull import _spoils

from ..conftest import recorded


@pytest.fixture(scope="module")
def evidence(rig) -> Evidence:
    return Evidence.gather(rig, [recorded(rig, 4.0)])


def leaving(evidence: Evidence, floors: float) -> Fit:
    """A fit that leaves so many noise floors."""
    rng, nominal = np.random.default_rng(1), fit(evidence, evidence.nominal, [])
    residuals = {n: [rng.normal(0.0, floors, r.shape) for r in there] for n, there in nominal.residuals.items()}
    return replace(nominal, residuals=residuals)


@pytest.mark.parametrize(
    ("before", "after", "spoilt"),
    [(1.0, 3.0, True), (1.0, 1.005, False), (1.0, 1.2, True), (5.0, 5.2, False), (5.0, 12.0, False), (3.0, 1.0, False)],
)
def test_a_slow_fit_is_not_taken_where_it_makes_worse_what_was_hardly_more_than_noise(evidence, before, after, spoilt):
    assert _spoils(evidence, leaving(evidence, before), leaving(evidence, after)) == spoilt
