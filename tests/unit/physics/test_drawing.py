"""How laws are drawn: as they are, over the state that they depend on."""

import numpy as np
import pytest

from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.drawing import drawing_of, law_curve


def drawing(kind, effect):
    return drawing_of(CATALOGUE[kind, effect])


def test_an_effect_that_is_no_law_of_one_state_is_not_drawn():
    assert drawing("mass", "absorber") is None
    assert drawing("amplifier", "delay") is None


def test_a_cubic_spring_is_smooth():
    state, force = law_curve(drawing("link", "cubic_stiffness"), {"k3": 1e10}, {}, (-2e-4, 2e-4))
    assert force == pytest.approx(1e10 * state**3)
    assert np.abs(np.diff(force, 2)).max() < 0.01 * np.ptp(force)


def test_dry_friction_jumps_at_rest_and_nowhere_else():
    speed, torque = law_curve(drawing("rotor", "coulomb_friction"), {"torque": 0.02}, {}, (-3.0, 5.0))
    steps = np.flatnonzero(np.diff(torque))
    assert np.abs(speed[steps]).max() < 1e-6
    assert set(torque) == {0.02, 0.0, -0.02}


def test_a_play_loops_around_the_diagonal_by_its_gap():
    angle, behind = law_curve(drawing("gear", "backlash"), {"half_gap": 0.1}, {}, (-0.3, 0.3))
    half = len(angle) // 2
    assert behind[half - 1] == pytest.approx(0.2)
    assert behind[-1] == pytest.approx(-0.2)
    assert np.abs(behind - angle).max() == pytest.approx(0.1)
    held = angle[:half] < -0.1  # after the reversal nothing moves until the gap is crossed
    assert behind[:half][held] == pytest.approx(-0.2)


def test_hysteresis_closes_its_loop_and_saturates():
    values = {"force": 2.0, "displacement": 1e-5}
    stretch, force = law_curve(drawing("link", "hysteresis"), values, {}, (-1e-4, 1e-4))
    half = len(stretch) // 2
    assert force[half - 1] == pytest.approx(2.0, rel=1e-3)
    assert force[-1] == pytest.approx(-2.0, rel=1e-3)
    assert force[:half] == pytest.approx(-force[half:], abs=1e-9)
    # from -force it rises in a straight line, by the force within the yield displacement
    assert np.interp(-1e-4 + 1e-5, stretch[:half], force[:half]) == pytest.approx(0.0, abs=0.02)
