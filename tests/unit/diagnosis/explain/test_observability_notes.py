"""What is said of a rig before its recordings are diagnosed."""

from dataclasses import replace

from nominal import nominal_rig
from reference import rigs

from dtbacklash.diagnosis.explain.observability_notes import beforehand
from dtbacklash.physics.rig import build_rig


def test_gains_against_friction_are_said_of_a_servo_without_a_force():
    (said,) = beforehand(rigs.served())
    assert "gains of servo (position_gain and speed_gain), inertias, friction and loads in proportion only" in said
    assert "Viscous friction of what it drives is the same as more speed_gain" in said
    assert beforehand(rigs.served(), {"u", "theta"}) == (said,)


def test_what_accelerometers_do_not_show_is_said_where_there_is_nothing_else():
    rig = rigs.oscillator()
    alone = {"a": {"of": "mass_1", "quantity": "acceleration"}}
    (said,) = beforehand(build_rig(replace(rig.config, sensors=alone)))
    assert said.startswith("Accelerations alone do not show where the machine stands")
    assert beforehand(build_rig(replace(rig.config, sensors=rig.config.sensors | alone))) == ()


def test_nothing_is_said_of_other_drives():
    assert beforehand(nominal_rig("pendulum")) == ()
    assert beforehand(rigs.lead_screw()) == ()
