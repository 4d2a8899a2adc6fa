"""Margins of a design, beside python-control's and the closed loops' own."""

import control
import numpy as np
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import beliefs_of, design_for
from dtbacklash.control.design import largest_gain
from dtbacklash.control.margins import frequencies, loop_transfer, margins
from dtbacklash.experiment.run import run_scenario

CONFIG = compose("controller=nimc_twin")
DESIGN = design_for(CONFIG, beliefs_of(CONFIG).design)
TAU_R = CONFIG.controller.tau_r_s


@pytest.mark.parametrize("form", ["bare", "measured", "inner_loop"])
def test_they_are_those_of_python_control(form):
    omega = frequencies(1e-3)[::4]
    loop = control.frd(loop_transfer(DESIGN, form, omega), omega, smooth=True)
    gain, phase, stability, _, crossover, _ = control.stability_margins(loop)
    found = margins(DESIGN, form, TAU_R)
    assert found.gain == pytest.approx(gain, rel=1e-3)
    assert found.phase_deg == pytest.approx(phase, rel=1e-3)
    assert found.delay_s == pytest.approx(np.radians(phase) / crossover, rel=1e-3)
    assert 1 / found.ms == pytest.approx(stability, rel=1e-3)


def test_they_are_where_the_closed_loop_becomes_unstable():
    """Of the form whose loop is the motor's alone: by the poles of the loop with another gain, and with delays."""
    found, k = margins(DESIGN, "measured", TAU_R), DESIGN.k_theta_v_per_rad
    assert found.gain == pytest.approx(largest_gain(DESIGN.motor_position) / k, rel=1e-3)
    samples = int(found.delay_s / 1e-3)
    assert largest_gain(DESIGN.motor_position, samples) > k > largest_gain(DESIGN.motor_position, samples + 1)


def test_the_play_predicts_a_cycle_for_all_forms_but_the_inverse():
    swinging = margins(DESIGN, "inner_loop", TAU_R)
    assert (swinging.cycle_share, swinging.cycle_rad_s) == (pytest.approx(1.2, abs=0.03), pytest.approx(42, abs=2))
    assert margins(DESIGN, "inverse", TAU_R).cycle_share is None
    assert margins(DESIGN, "inner_loop", TAU_R, gap=False).cycle_share is None


@pytest.mark.parametrize(("delay_s", "said"), [(0.003, False), (0.006, True)])
def test_a_design_says_that_its_delay_margin_is_small(delay_s, said):
    words = ("controller=imc", "profile=constant", "profile.start_deg=0", "duration_s=5",
             "controller.internal_model=inner_loop", f"rig.effects.amplifier.delay.time={delay_s}")  # fmt: skip
    summary = run_scenario(compose(*words)).summary
    assert summary["margins"]["delay_s"] == pytest.approx(9.27e-3, rel=0.01)
    assert any("delay margin of 9.27 ms" in one for one in summary["advice"]) is said
