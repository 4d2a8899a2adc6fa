"""Margins of a design, beside python-control's and the closed loops' own."""

from dataclasses import replace

import control
import numpy as np
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import Belief, beliefs_of, design_for
from dtbacklash.control.chain import structure_ss
from dtbacklash.control.design import largest_gain, sampled
from dtbacklash.control.margins import Curves, DesignedLoop, frequencies, margins
from dtbacklash.errors import Diverged
from dtbacklash.experiment.run import run_scenario
from dtbacklash.physics.rig import build_rig

CONFIG = compose("controller=nimc_twin")
BELIEF = beliefs_of(CONFIG).design
DESIGN = design_for(CONFIG, BELIEF)


def loop_of(form, models_gap=True):
    controller = replace(CONFIG.controller, internal_model=form)
    found = DesignedLoop.of(replace(CONFIG, controller=controller), DESIGN, BELIEF)
    return replace(found, models_gap=models_gap)


@pytest.mark.parametrize("form", ["bare", "measured", "inner_loop"])
def test_they_are_those_of_python_control(form):
    omega = frequencies(1e-3)[::4]
    loop = control.frd(Curves(loop_of(form), omega).loop, omega, smooth=True)
    gain, phase, stability, _, crossover, _ = control.stability_margins(loop)
    found = margins(loop_of(form))
    assert found.gain == pytest.approx(gain, rel=1e-3)
    assert found.phase_deg == pytest.approx(phase, rel=1e-3)
    assert found.delay_s == pytest.approx(np.radians(phase) / crossover, rel=1e-3)
    assert 1 / found.ms == pytest.approx(stability, rel=1e-3)


def test_they_are_where_the_closed_loop_becomes_unstable():
    """Of the form whose loop is the motor's alone: by the poles of the loop with another gain, and with delays."""
    found, k = margins(loop_of("measured")), DESIGN.k_theta_v_per_rad
    assert found.gain == pytest.approx(largest_gain(DESIGN.motor_position) / k, rel=1e-3)
    samples = int(found.delay_s / 1e-3)
    assert largest_gain(DESIGN.motor_position, samples) > k > largest_gain(DESIGN.motor_position, samples + 1)


def test_the_small_gain_bound_of_one_parameter_is_the_paper_s():
    """A structure that differs by dG2: the loop that is left of IMC is W G dG2, with G the closed inner loop."""
    designed = loop_of("inner_loop")
    omega = np.geomspace(1.0, 100.0, 200)
    softer = DesignedLoop.of(CONFIG, DESIGN, BELIEF).variations
    nominal = BELIEF.linear()
    at = next(i for i, (low, high) in enumerate(softer) if low.motor == high.motor == nominal.motor)
    alone = replace(designed, variations=softer[at : at + 1])
    changed = []
    for one in softer[at]:
        other = replace(DESIGN, structure=sampled(structure_ss(one.structure), 1e-3))
        curves = Curves(replace(designed, design=other), omega)
        base = Curves(designed, omega)
        servo = DESIGN.k_theta_v_per_rad * base.plant[0]
        changed.append(np.abs(base.filtered[0] * servo / (1.0 + servo) * (curves.plant[1] - base.plant[1])))
    assert Curves(alone, omega).moved == pytest.approx(np.max(changed, axis=0), rel=1e-9)


def test_the_play_predicts_a_cycle_for_all_forms_but_the_inverse():
    swinging = margins(loop_of("inner_loop"))
    assert (swinging.cycle_share, swinging.cycle_rad_s) == (pytest.approx(1.2, abs=0.03), pytest.approx(42, abs=2))
    assert margins(loop_of("inverse")).cycle_share is None
    assert margins(loop_of("inner_loop", models_gap=False)).cycle_share is None


@pytest.mark.parametrize(("delay_s", "said"), [(0.003, False), (0.006, True)])
def test_a_design_says_that_its_delay_margin_is_small(delay_s, said):
    words = ("controller=imc", "profile=constant", "profile.start_deg=0", "duration_s=5",
             "controller.internal_model=inner_loop", f"rig.effects.amplifier.delay.time={delay_s}")  # fmt: skip
    result = run_scenario(compose(*words))
    assert result.summary["margins"] == result.design.margins().as_dict()
    assert result.design.margins().delay_s == pytest.approx(9.27e-3, rel=0.01)
    assert any("delay margin of 9.27 ms" in one for one in result.summary["advice"]) is said


@pytest.mark.parametrize("form", ["bare", "measured", "inner_loop"])
def test_a_known_delay_is_counted_in_the_margin(form):
    """The loop is stable with a further delay below the margin that is left, and not with one above it."""
    known_s, words = 0.003, ("controller=imc", "profile=constant", "profile.start_deg=0", "duration_s=10",
                             "reference.period_s=20", f"controller.internal_model={form}")  # fmt: skip
    delay = "rig.effects.amplifier.delay.time={}"

    def run(delay_s):
        beliefs = beliefs_of(compose(*words, delay.format(known_s)))
        belief = Belief(build_rig(compose(*words, delay.format(known_s)).rig))
        return run_scenario(compose(*words, delay.format(delay_s)), beliefs=replace(beliefs, design=belief))

    left_s = run(known_s).design.margins().delay_s
    assert left_s == pytest.approx(9.2e-3 - known_s, abs=0.5e-3)
    assert run(known_s + 0.9 * left_s).moves["settling_time_s"].notna().all()
    with pytest.raises(Diverged):
        run(known_s + 1.15 * left_s)
