"""What is proposed for a fit: not the same law twice."""

import pytest
from nominal import nominal_rig

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.search.model import Model, Named, Trial
from dtbacklash.diagnose.search.order import is_named_already
from dtbacklash.physics.rig import Rig

from ..fit.test_refit import shaken

DRY, BOUC_WEN, HARDENS = ("spring", "dry_friction"), ("spring", "hysteresis"), ("spring", "cubic_stiffness")
#: displacements within which a spring yields, as shares of how far it is stretched
SHARP, SOFT = 1e-6, 0.3


@pytest.fixture(scope="module")
def rig() -> Rig:
    return nominal_rig("oscillator")


@pytest.fixture(scope="module")
def evidence(rig) -> Evidence:
    return Evidence.gather(rig, [shaken(rig.with_effect(*DRY, {"force": 0.5}))])


def fitted(evidence: Evidence, *effects: tuple[Key, dict[str, float]]) -> Fit:
    rig = evidence.nominal
    for key, values in effects:
        rig = rig.with_effect(*key, values)
    return fit(evidence, rig, [])


def yields(evidence: Evidence, share: float) -> tuple[Key, dict[str, float]]:
    return BOUC_WEN, {"force": 0.5, "displacement": share * evidence.moving("spring").span}


def tried(evidence: Evidence, key: Key, values: dict[str, float]) -> Trial:
    there = fitted(evidence, (key, values))
    return Trial(key, None, there, evidence.rms(there.residuals))


def search(evidence: Evidence, key: Key, values: dict[str, float], former: list[Trial]) -> Model:
    nominal = fitted(evidence)
    return Model(evidence, nominal, fitted(evidence, (key, values)), (Named(key, tried=tuple(former)),))


@pytest.mark.parametrize(("share", "already"), [(SHARP, True), (SOFT, False)])
def test_dry_friction_beside_a_hysteresis_that_has_become_it_is_the_same_twice(evidence, share, already):
    model = search(evidence, *yields(evidence, share), [])
    assert is_named_already(model, tried(evidence, DRY, {"force": 0.5})) == already
    assert not is_named_already(model, tried(evidence, HARDENS, {"k3": 1e6}))
