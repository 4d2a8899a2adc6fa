"""What is said of a rig before its recordings are diagnosed."""

from nominal import nominal_rig
from reference import rigs

from dtbacklash.diagnose.say.beforehand import beforehand


def test_gains_against_friction_are_said_of_a_servo_without_a_force():
    (said,) = beforehand(rigs.served())
    assert "gains of servo (position_gain and speed_gain), inertias, friction and loads in proportion only" in said
    assert "Viscous friction of what it drives is the same as more speed_gain" in said
    assert beforehand(rigs.served(), {"u", "theta"}) == (said,)


def test_nothing_is_said_of_other_drives():
    assert beforehand(nominal_rig("pendulum")) == ()
    assert beforehand(rigs.lead_screw()) == ()
