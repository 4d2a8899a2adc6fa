"""Laws for whatever they may meet; test_truth.py holds each of them against an independent solution."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtbacklash.physics.effects import sensor
from dtbacklash.physics.effects.spring import play

angles = st.floats(-100.0, 100.0)
gaps = st.floats(0.0, 6.3)


@given(angles, angles, gaps)
def test_the_play_stays_in_its_gap_and_moves_only_where_it_is_pushed(before: float, theta_m: float, gap: float) -> None:
    now = play(before, theta_m, gap)
    assert abs(theta_m - now) <= gap + 1e-12
    pushed = abs(theta_m - now) >= gap - 1e-12 and np.sign(now - before) == np.sign(theta_m - before)
    assert now == before or pushed


@given(st.lists(angles, min_size=1), st.floats(0.0, 0.05), st.floats(-3.1, 3.1))
def test_an_eccentric_encoder_is_right_at_zero_and_can_be_undone(turned, amplitude, phase) -> None:
    shown = np.array([sensor.eccentric(a, amplitude, phase) for a in turned])
    assert sensor.eccentric(0.0, amplitude, phase) == 0.0
    assert np.abs(shown - turned).max() <= 2.0 * amplitude + 1e-12
    assert sensor.centred(shown, amplitude, phase) == pytest.approx(turned, abs=2.0 * amplitude**5 + 1e-9)
