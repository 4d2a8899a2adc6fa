"""How sure a finding is beside what nothing explains."""

from dataclasses import replace

import numpy as np
import pytest
from ringing import blade, known, recorded

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.intervals import standard_errors
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.judge.free_form import Recovered
from dtbacklash.diagnose.judge.verdict import confidence, moved_parameters
from dtbacklash.diagnose.say.findings import without
from dtbacklash.diagnose.search.model import Model, Named

SPRING, FORCE = ("foot", "cubic_stiffness"), ("tip", "constant_force")
NONE = np.zeros(0)


def left_over(place: str, share: float, t: float) -> Recovered:
    return Recovered(place, "stretch", "m", "N", NONE, NONE, NONE, share, t=t)


@pytest.fixture(scope="module")
def found() -> Model:
    """A large cubic spring at the foot and a small force on the tip, which are both there."""
    rig = known(blade())
    truth = rig.with_effect(*SPRING, {"k3": 2e9}).with_effect(*FORCE, {"force": 0.3})
    evidence = Evidence.gather(rig, [recorded(truth, 31, 4000)])
    return Model(evidence, fit(evidence, rig, []), fit(evidence, truth, []), (Named(SPRING), Named(FORCE)))


def said(found: Model, rest: Recovered | None, unexplained: bool = True) -> str:
    return confidence(found, FORCE, without(found)[FORCE], rest, unexplained)


def test_a_finding_is_sure_beside_a_small_rest_elsewhere(found):
    alone = Model(found.evidence, found.nominal, found.fitted, (Named(FORCE),))
    assert said(alone, left_over("frame", 0.3, 10.0)) == "sure"


@pytest.mark.parametrize(("share", "t"), [(0.01, 10.0), (0.3, 1.0)], ids=["explains nothing", "not significant"])
def test_no_finding_is_sure_beside_a_rest_that_shows_nowhere(found, share, t):
    alone = Model(found.evidence, found.nominal, found.fitted, (Named(FORCE),))
    assert said(alone, left_over("frame", share, t)) == "partial"


def test_findings_near_the_rest_count_as_left(found):
    """What stands in for unknown physics at the foot explains far more than the force at the tip does."""
    assert said(found, left_over("frame", 0.3, 10.0)) == "partial"


def test_where_noise_is_left_every_finding_is_sure_and_where_nothing_can_be_looked_at_none(found):
    assert said(found, None, unexplained=False) == "sure"
    assert said(found, None) == "partial"


@pytest.mark.parametrize("place", ["tip", "blade"])
def test_a_finding_near_the_rest_is_a_part(found, place):
    alone = Model(found.evidence, found.nominal, found.fitted, (Named(FORCE),))
    assert said(alone, left_over(place, 0.3, 10.0)) == "partial"


@pytest.mark.parametrize(("place", "sure"), [("tip", "partial"), ("foot", "sure")])
def test_a_sensor_is_where_what_it_measures_is(found, place, sure):
    key = ("sensor_x_2", "offset")
    rig = found.evidence.nominal.with_effect(*key, {"offset": 0.05})
    there = Model(found.evidence, found.nominal, replace(found.nominal, rig=rig), (Named(key),))
    left_out = {name: [r + 1e4 for r in rows] for name, rows in there.fitted.residuals.items()}
    assert confidence(there, key, left_out, left_over(place, 0.3, 10.0), True) == sure


def test_a_trifle_of_a_tolerance_that_was_needed_is_said():
    """A nominal rig that leaves more than noise does not agree with the recording."""
    rig = known(blade())
    evidence = Evidence.gather(rig, [recorded(blade(k_1=3000.0 * 1.01), 33, 6000)])
    fitted = fit(evidence, rig, nominal_free(rig))
    moved = moved_parameters(evidence, rig, fitted, standard_errors(evidence, fitted))
    value, error = moved["k_1"]
    assert value == pytest.approx(3030.0, abs=4.0 * error)
    exact = Evidence.gather(rig, [recorded(blade(), 34, 6000)])
    fitted = fit(exact, rig, nominal_free(rig))
    assert moved_parameters(exact, rig, fitted, standard_errors(exact, fitted)) == {}
