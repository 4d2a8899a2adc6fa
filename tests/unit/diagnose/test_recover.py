"""The force that is missing, recovered with no law assumed."""

import numpy as np
import pytest

from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.name import refit_with
from dtbacklash.diagnose.recover import locate_rest, recover
from dtbacklash.diagnose.refit import fit, nominal_free

from .conftest import recorded


@pytest.fixture(scope="module")
def coulomb(rig):
    """Evidence of dry friction in the bearing."""
    truth = rig.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    return Evidence.gather(rig, [recorded(truth)])


def test_the_recovered_force_is_the_hidden_one(rig, coulomb):
    nominal = fit(coulomb, rig, nominal_free(rig))
    fitted = refit_with(coulomb, nominal, [(("motor_bearing", "coulomb_friction"), {"torque": 0.015})])
    found = recover(coulomb, fitted, "motor_bearing", "coulomb_friction")
    assert found is not None
    assert (found.state, found.state_unit, found.effort_unit) == ("speed", "rad/s", "N m")
    assert found.share > 0.95
    fast = np.abs(found.knots) > 0.3 * np.abs(found.knots).max()
    assert found.effort[fast] == pytest.approx(-0.02 * np.sign(found.knots[fast]), rel=0.2)
    assert np.median(np.abs(found.effort[fast])) == pytest.approx(0.02, rel=0.05)
    assert found.law == pytest.approx(found.effort, abs=0.002)


def test_what_is_left_is_located(rig, coulomb):
    rest = locate_rest(coulomb, fit(coulomb, rig, nominal_free(rig)))
    assert rest is not None
    assert rest.place in ("motor_bearing", "amplifier")  # their efforts reach the angle alike
    assert rest.law.size == 0


def test_a_place_without_a_linear_path_gives_nothing(rig, coulomb):
    assert recover(coulomb, fit(coulomb, rig, nominal_free(rig)), "motor_circuit") is None
