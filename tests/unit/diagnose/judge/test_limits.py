"""What is not named has a bound, and the bound says what would have been seen."""

import numpy as np
import pytest
from ringing import blade, known
from ringing import recorded as ringing

from dtbacklash.diagnose import diagnose_records
from dtbacklash.diagnose.result import Limit

from ..conftest import recorded

COULOMB = ("motor_bearing", "coulomb_friction")


@pytest.fixture(scope="module")
def sound(rig):
    """The diagnosis of a recording with nothing in it."""
    return diagnose_records(rig, [recorded(rig)])


def bound(found, place: str, effect: str) -> Limit:
    return next(x for x in found.limits if (x.location, x.effect) == (place, effect))


@pytest.mark.check
def test_every_candidate_has_a_bound_or_is_said_to_be_out_of_sight(sound):
    assert {(c.location, c.effect) for c in sound.candidates} == {(x.location, x.effect) for x in sound.limits}
    assert all(x.upper95 is None or x.upper95 > 0.0 for x in sound.limits)


@pytest.mark.nightly
def test_twenty_times_the_bound_is_found(sound, rig):
    limit = bound(sound, *COULOMB)
    assert limit.unit == "N m"
    larger = rig.with_effect(*COULOMB, {"torque": 20.0 * limit.upper95})
    assert COULOMB in [(f.location, f.effect) for f in diagnose_records(rig, [recorded(larger)]).findings]


@pytest.mark.parametrize("times", [0.3, 1.0, 2.0])
@pytest.mark.nightly
def test_what_is_too_small_to_be_named_lies_below_the_bound(sound, rig, times):
    torque = times * bound(sound, *COULOMB).upper95
    found = diagnose_records(rig, [recorded(rig.with_effect(*COULOMB, {"torque": torque}), seed=2)])
    assert COULOMB not in [(f.location, f.effect) for f in found.findings]
    assert bound(found, *COULOMB).upper95 > torque


@pytest.mark.check
def test_a_limit_of_the_command_has_a_bound_from_below(sound, rig):
    limit = bound(sound, "amplifier", "saturation")
    assert limit.upper95 is None
    assert 0.0 < limit.lower95 < np.abs(recorded(rig).u).max()


def test_the_row_says_a_bound_or_that_there_is_none():
    row = Limit("gear", "backlash", "gap", "rad", upper95=1e-3).to_json()
    assert row == {"location": "gear", "effect": "backlash", "parameter": "gap", "unit": "rad", "upper95": 1e-3}
    unseen = Limit("mass_2", "absorber", "mass", "kg", {"frequency": 9.0}).to_json()
    assert (unseen["visible"], unseen["at"]) == (False, {"frequency": 9.0})


@pytest.mark.nightly
def test_where_the_parameters_can_do_all_of_it_their_tolerances_bound_it():
    """The force constant does what a gain error does; masses, stiffness and damping do it together, as well."""
    rig = known(blade())
    tolerances = {name: p.tolerance for name, p in rig.config.parameters.items()}
    alone = tolerances.pop("g")
    together = np.sqrt(alone**2 + 1.0 / np.sum([t**-2 for t in tolerances.values()]))
    limit = bound(diagnose_records(rig, [ringing(blade(), 17)]), "amplifier", "gain_error")
    assert 0.95 * 1.96 * alone < limit.upper95 < 1.05 * 1.96 * together
