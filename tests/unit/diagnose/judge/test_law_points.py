"""The law of a finding with its points: on the law where it is the right one, off it where it is not."""

import numpy as np
import pytest

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.judge.law_points import law_shown, travel
from dtbacklash.diagnose.say.drawn import shown
from dtbacklash.diagnose.say.findings import without
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Model, Named

from ..conftest import recorded


def found(rig, key, values, start=None):
    """A model of evidence of one effect, which has it (or what ``start`` says) fitted there."""
    evidence = Evidence.gather(rig, [recorded(rig.with_effect(*key, values), seconds=8.0)])
    nominal = fit(evidence, rig, nominal_free(rig))
    name, begin = start or (key[1], values)
    fitted = refit_with(evidence, nominal, [((key[0], name), begin)])
    return Model(evidence, nominal, fitted, (Named((key[0], name)),))


def drawn(model):
    (key,) = model.keys
    return law_shown(model.evidence, model.fitted, key, without(model)[key])


def off(law):
    """How far the points are from the law, in standard errors and as a share of its size."""
    away = np.abs(law.recovered - np.interp(law.state, law.law_state, law.law_effort))
    return np.median(away / law.error), np.median(away) / np.ptp(law.law_effort)


@pytest.mark.parametrize(
    ("key", "values", "label", "unit"),
    [
        (("motor_bearing", "coulomb_friction"), {"torque": 0.02}, "speed of motor bearing", "N m"),
        (("link_1", "cubic_stiffness"), {"k3": 1e10}, "stretch of link 1", "N"),
    ],
)
def test_points_lie_on_the_law_that_is_true(rig, key, values, label, unit):
    law = drawn(found(rig, key, values))
    assert (law.state_label, law.effort_unit) == (label, unit)
    assert len(law.state) > 10
    errors, share = off(law)
    assert errors < 3.0
    assert share < 0.03


def test_points_leave_a_law_that_is_not_true(rig):
    true = drawn(found(rig, ("link_1", "cubic_stiffness"), {"k3": 1e10}))
    stop = ("bumper", {"stiffness": 2e3, "clearance": 1e-4})
    wrong = drawn(found(rig, ("link_1", "cubic_stiffness"), {"k3": 1e10}, stop))
    assert off(wrong)[1] > 5 * off(true)[1]


def test_backlash_is_a_loop_with_points_on_both_branches(rig):
    law = drawn(found(rig, ("gear", "backlash"), {"half_gap": 0.2}))
    assert (law.state_unit, law.effort_unit, law.effort_label) == ("rad", "rad", "angle behind the gap")
    assert law.law_state[0] == pytest.approx(law.law_state[-1])
    lag = law.recovered - law.state
    assert np.abs(lag).max() == pytest.approx(0.2, rel=0.1)
    assert {-1.0, 1.0} <= set(np.sign(lag))


def test_the_evidence_adds_up_and_noise_has_none(rig):
    model = found(rig, ("motor_bearing", "coulomb_friction"), {"torque": 0.02})
    assert shown(model, without(model), [], None).evidence == {"motor_bearing": 1.0}
    quiet = Evidence.gather(rig, [recorded(rig, seconds=8.0)])
    nominal = fit(quiet, rig, nominal_free(rig))
    assert shown(Model(quiet, nominal, nominal), {}, [], None).evidence == {}


def test_travel_starts_anew_at_each_reversal():
    way, direction = travel(np.array([0.0, 1.0, 2.0, 1.9, 2.1, 1.0, 0.0, 3.0]), 0.5)
    assert way.tolist() == pytest.approx([0.0, 1.0, 2.0, 1.9, 2.1, 1.1, 2.1, 3.0])
    assert direction.tolist() == [1.0] * 5 + [-1.0, -1.0, 1.0]
