"""A run that does not settle says so, and what it says helps."""

import re

import pytest

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import beliefs_of, design_for
from dtbacklash.control.design import largest_gain
from dtbacklash.errors import Diverged
from dtbacklash.experiment.run import run_scenario

NO_GAP = ("profile=constant", "profile.start_deg=0")
SETTING = re.compile(r"(?<![(\w])((?:controller|reference|sensors|duration_s)[\w.]*=[\w.-]*\w)")

BARE = "controller=imc controller.internal_model=bare"

#: words of a run that does not settle, what is said of it
CASES = [
    (f"{BARE} rig.effects.motor_bearing.coulomb_friction.torque=0.05", "Coulomb friction at motor_bearing"),
    (f"{BARE} rig.effects.amplifier.dead_zone.half_width=0.2", "dead zone at amplifier"),
    (f"{BARE} rig.effects.sensor_theta_m.gain_error.relative=0.02", "gain error at sensor_theta_m"),
    (
        "controller=imc controller.internal_model=measured rig.effects.motor_bearing.coulomb_friction.torque=0.05",
        r"\(measured\) cannot see",
    ),
    ("controller=nimc_fixed controller.internal_model=inner_loop", "larger \\(50 deg\\) than it is \\(0 deg\\)"),
    (
        "controller=nimc_fixed controller.internal_model=bare controller.gap_hat_deg=0 "
        "rig.effects.motor_bearing.constant_load.torque=0.05 "
        "profile.start_deg=30",
        "internal_model=inverse takes it out",
    ),
    ("controller=imc controller.prefilter=none reference.period_s=4", "rings the structure"),
    ("controller=imc reference.period_s=1", "A move takes about 0.83 s"),
    ("controller=imc reference=staircase reference.dwell_s=0.3 duration_s=12", "holds for 0.3 s"),
    ("controller=imc profile.start_deg=50 reference.period_s=2.5", "a gap that the controller's model does not have"),
    ("controller=imc duration_s=20.3", "duration_s=21"),
]


@pytest.mark.parametrize(("line", "said"), CASES)
def test_what_is_said_helps(line, said):
    words = [*NO_GAP, "duration_s=60", *line.split()]
    last = {word.partition("=")[0]: word for word in words}  # what a case says replaces what all have
    result = run_scenario(compose(*last.values()))
    assert result.summary["settles"] is False
    first, *reasons = result.summary["advice"]
    assert re.fullmatch(r"\d+ of \d+ moves never settle within 1 %\.", first)
    assert len(reasons) == 1
    assert re.search(said, reasons[0])
    helpful = SETTING.findall(reasons[0])
    assert helpful
    for setting in helpful:
        better = run_scenario(compose(*(last | {setting.partition("=")[0]: setting}).values()))
        settled = better.moves["settling_time_s"].notna()
        # with another period the end of the run may cut the last move short
        assert settled[:-1].all() if setting.startswith("reference") else settled.all(), setting


def test_nothing_is_said_of_a_run_that_settles():
    result = run_scenario(compose(*NO_GAP, "controller=imc", "duration_s=30"))
    assert result.summary["settles"] is True
    assert result.summary["advice"] == []


def test_friction_with_a_model_that_knows_how_to_live_with_it_is_no_cause():
    friction = "rig.effects.motor_bearing.coulomb_friction.torque=0.02"
    words = [*NO_GAP, "controller=imc", "controller.internal_model=inner_loop", friction, "reference.period_s=1"]
    advice = run_scenario(compose(*words, "duration_s=10")).summary["advice"]
    assert len(advice) == 2
    assert advice[1].startswith("A move takes about")


def test_open_loop_has_no_moves_to_settle():
    summary = run_scenario(compose("controller=open_loop", "duration_s=2")).summary
    assert (summary["settles"], summary["advice"]) == (None, [])


def test_a_sensor_that_is_wrong_at_the_output_is_beyond_every_setting():
    words = [*NO_GAP, "controller=imc", "rig.effects.sensor_q3.gain_error.relative=0.05", "duration_s=40"]
    reasons = run_scenario(compose(*words)).summary["advice"][1:]
    assert len(reasons) == 1
    assert reasons[0].startswith("sensor_q3 has gain error")
    assert not SETTING.findall(reasons[0])


def test_a_band_narrower_than_the_sensors_count():
    words = ["controller=nimc_twin", "sensors=encoder", "reference.amplitude_mm=0.01", "duration_s=100"]
    reasons = run_scenario(compose(*words)).summary["advice"][1:]
    assert any("narrower than the resolution of q3_mm" in reason for reason in reasons)


@pytest.mark.parametrize(
    "words",
    [
        ("controller.k_theta_v_per_rad=300",),
        ("rig.effects.amplifier.delay.time=0.02",),
        ("rig.effects.sensor_theta_m.delay.time=0.02",),
    ],
)
def test_a_loop_that_diverges_says_which_gain_it_bears(words):
    base = [*NO_GAP, "controller=imc", "duration_s=30"]
    with pytest.raises(Diverged) as caught:
        run_scenario(compose(*base, *words))
    gain = re.search(r"(controller\.k_theta_v_per_rad=[\d.]*\d) leaves a margin", str(caught.value))
    assert gain
    others = [word for word in words if not word.startswith("controller.k_theta")]
    assert run_scenario(compose(*base, *others, gain.group(1))).summary["settles"]


def test_the_largest_gain_is_where_the_loop_becomes_unstable():
    config = compose(*NO_GAP, "controller=imc", "duration_s=5")
    design = design_for(config, beliefs_of(config).design)
    assert design is not None
    limit = largest_gain(design.motor_position)
    for share, stable in ((0.95, True), (1.1, False)):
        words = [*NO_GAP, "controller=imc", "duration_s=5", f"controller.k_theta_v_per_rad={share * limit}"]
        if stable:
            assert run_scenario(compose(*words)).summary["settles"]
        else:
            with pytest.raises(Diverged):
                run_scenario(compose(*words))
    limits = [largest_gain(design.motor_position, delay) for delay in range(4)]
    assert limits == sorted(limits, reverse=True)
