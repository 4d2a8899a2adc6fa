"""A drive that lets a body coast: what it does has a closed form between two commands."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.config.compose import compose
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.simulate import simulate

STEP_S, HELD = 2e-3, 60
#: V: off, on, half on, back, and a little
LEVELS = np.array([4.0, 0.0, 2.0, 0.0, -4.0, -1.0, 0.0, 0.2])


@pytest.mark.parametrize("driven_from", [0.0, 2.0, 8.0])
def test_a_driven_body_slows_down_as_it_does_in_closed_form(driven_from):
    """J v' = K u - (d - c share(u)) v at each command."""
    rig = nominal_rig("pendulum").with_effect("disk", "viscous_friction", {"coefficient": 0.08})
    values = {"coefficient": 0.06, "driven_from": driven_from}
    shown = simulate(rig.with_effect("disk", "coasting", values), np.repeat(LEVELS, HELD), STEP_S).sensors["omega"]
    K, J = (rig.config.parameters[name].value for name in ("K_t", "J"))
    v = [0.0]
    for u in np.repeat(LEVELS, HELD):
        off = float(u == 0.0) if driven_from == 0.0 else max(1.0 - abs(u) / driven_from, 0.0)
        d = 0.08 - 0.06 * off
        v.append(K * u / d + (v[-1] - K * u / d) * np.exp(-d * STEP_S / J))
    plain = simulate(rig, np.repeat(LEVELS, HELD), STEP_S).sensors["omega"]
    assert np.abs(shown - v).max() < 1e-6 * np.abs(shown - plain).max()


def test_it_acts_where_an_actuator_or_a_winding_drives_and_nowhere_else():
    places = {
        name: [place for place in nominal_rig(name).places if "coasting" in nominal_rig(name).takes(place)]
        for name in ("pendulum", "two_mass_stage", "rotary_drive", "servo_arm")
    }
    assert places == {
        "pendulum": ["disk"], "two_mass_stage": ["carriage"], "rotary_drive": ["motor_rotor"], "servo_arm": [],
    }  # fmt: skip
    with pytest.raises(UserError, match="a body that an actuator or a motor's winding drives"):
        build_rig(compose("rig=rotary_drive", "rig.effects.load.coasting.coefficient=0.001").rig)


def test_a_report_says_from_which_command_on_it_brakes_where_that_is_known():
    effect = CATALOGUE["rotor", "coasting"]
    assert "{driven_from}" in effect.said()
    assert "{driven_from}" not in effect.said({"driven_from"})
    assert effect.idle({"coefficient": 1.0, "driven_from": 0.0}) == {"driven_from"}
