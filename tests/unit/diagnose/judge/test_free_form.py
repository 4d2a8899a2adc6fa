"""The force that is missing, recovered with no law assumed."""

import numpy as np
import pytest

from dtbacklash.diagnose.data.compare import part_of
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import nominal_free
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.judge.free_form import free_forms, path_of

from ..conftest import recorded


@pytest.fixture(scope="module")
def coulomb(rig):
    """Evidence of dry friction in the bearing."""
    truth = rig.with_effect("motor_bearing", "coulomb_friction", {"torque": 0.02})
    return Evidence.gather(rig, [recorded(truth)])


def test_what_is_left_is_located_and_has_the_hidden_shape(rig, coulomb):
    forms = free_forms(coulomb, fit(coulomb, rig, nominal_free(rig)))
    rest = max(forms, key=lambda form: form.share)
    assert rest.t > 3.5
    assert rest.fall > 1.0
    assert rest.place in ("motor_bearing", "amplifier")  # their efforts reach the angle alike
    assert rest.share > 0.5
    assert len(rest.knots) == len(rest.effort) == len(rest.error)
    bearing = next(form for form in forms if (form.place, form.state) == ("motor_bearing", "speed"))
    assert (bearing.state_unit, bearing.effort_unit) == ("rad/s", "N m")
    # The fit has given the friction a share of viscous damping; what is missing is the step and that share taken back.
    lines = np.column_stack([np.sign(bearing.knots), bearing.knots])
    step, _ = np.linalg.lstsq(lines, bearing.effort)[0]
    assert step == pytest.approx(-0.02, rel=0.25)


def test_no_linear_path_leads_from_a_winding_to_the_sensors(rig, coulomb):
    (motor, *_) = coulomb.blocks
    assert path_of(part_of(rig, motor), motor, "motor_circuit") is None
    assert path_of(part_of(rig, motor), motor, "motor_bearing")[0] == "N m"
