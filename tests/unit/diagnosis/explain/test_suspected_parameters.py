"""A typo in a rig is told first, and physics that a rig lacks is no typo."""

import pytest

import dtbacklash as dtb

pytestmark = pytest.mark.check
MOTION = ("controller=open_loop", "reference=multisine", "reference.rms_v=0.5", "reference.f_max_hz=5", "duration_s=15")


@pytest.mark.parametrize(
    ("rig", "hidden", "wrong", "said"),
    [
        ("pendulum", "disk.coulomb_friction.torque=0.02", {"J": 0.2}, "`J` fits a tenth of its value (0.02 kg m^2"),
        ("oscillator", "", {"k": 19e3}, "`k` fits a tenth of its value (1.9e+03 N/m instead of 1.9e+04 N/m)"),
        ("pendulum", "disk.gravity.torque=0.3", {}, ""),
    ],
)
def test_a_wrong_number_is_told_and_what_is_missing_is_none(rig, hidden, wrong, said):
    run = dtb.run(*MOTION, *([f"rig.effects.{hidden}"] if hidden else []), rig=rig)
    found = dtb.diagnose(run.recording, dtb.load_rig(rig).with_parameters(wrong), search="none").diagnosis
    assert found.verdict == "unexplained"
    assert said in found.suspected
    assert bool(found.suspected) == bool(said)
    assert found.summary.startswith(found.suspected)
