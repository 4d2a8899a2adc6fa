"""Properties of the laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtbacklash.physics.effects import body, drive, periodic, sensor, spring
from dtbacklash.physics.effects.play import play

angles = st.floats(-100.0, 100.0)
gaps = st.floats(0.0, 6.3)
positive = st.floats(1e-3, 1e3)
paths = st.lists(angles, min_size=1, max_size=30)


def play_along(path: list[float], gap: float, start: float = 0.0) -> list[float]:
    now, out = start, []
    for theta_m in path:
        now = play(now, theta_m, gap)
        out.append(now)
    return out


@given(paths, gaps)
def test_the_play_stays_within_the_gap(path: list[float], gap: float) -> None:
    for theta_m, theta_d in zip(path, play_along(path, gap), strict=True):
        assert abs(theta_m - theta_d) <= gap + 1e-12


@given(paths, gaps)
def test_the_play_does_not_depend_on_the_pace(path: list[float], gap: float) -> None:
    """Points in between, on the straight way, and pauses change nothing at the points themselves."""
    slow, before = [], 0.0
    for theta_m in path:
        slow += [before + f * (theta_m - before) for f in (0.25, 0.5, 0.75)] + [theta_m, theta_m]
        before = theta_m
    assert play_along(slow, gap)[4::5] == pytest.approx(play_along(path, gap), abs=1e-9)


@given(paths, gaps)
def test_the_play_moves_only_where_it_is_pushed(path: list[float], gap: float) -> None:
    before, last = 0.0, 0.0
    for theta_m, theta_d in zip(path, play_along(path, gap), strict=True):
        assert (theta_d - before) * (theta_m - last) >= 0.0 or before == theta_d or abs(last - before) > gap
        before, last = theta_d, theta_m


@given(paths)
def test_the_play_without_a_gap_is_rigid(path: list[float]) -> None:
    assert play_along(path, 0.0) == path


@given(paths, gaps, angles)
def test_the_play_is_symmetric(path: list[float], gap: float, start: float) -> None:
    mirrored = play_along([-x for x in path], gap, -start)
    assert mirrored == [-x for x in play_along(path, gap, start)]


@given(angles, positive)
def test_dead_zone_and_saturation_are_odd_and_do_not_amplify(u: float, width: float) -> None:
    for function in (drive.dead_zone, drive.saturation):
        assert function(-u, width) == -function(u, width)
        assert abs(function(u, width)) <= abs(u)
    assert drive.dead_zone(u, 0.0) == u == drive.saturation(u, math.inf)
    assert abs(drive.saturation(u, width)) <= width
    # what the one takes away is what the other lets through
    assert drive.dead_zone(u, width) + drive.saturation(u, width) == pytest.approx(u, abs=1e-12)


@given(positive, positive, positive)
def test_friction_falls_from_the_static_to_the_sliding_level(coulomb: float, extra: float, speed: float) -> None:
    levels = [body.coulomb(coulomb) + body.stribeck(f * speed, extra, speed) for f in (0.0, 0.5, 1.0, 2.0, 50.0)]
    assert levels[0] == pytest.approx(coulomb + extra)
    assert levels == sorted(levels, reverse=True)
    assert levels[-1] == pytest.approx(coulomb)


@given(st.floats(-1.0, 1.0), positive)
def test_dampers_oppose_the_motion(rate: float, c2: float) -> None:
    assert spring.quadratic_damping(rate, c2) * rate >= 0.0


@given(st.floats(-1.0, 1.0), st.floats(-50.0, 50.0), st.floats(-5.0, 5.0))
def test_friction_by_direction_is_its_mean_and_half_the_difference(rate: float, viscous: float, levels: float) -> None:
    """Levels of 10 +- levels and coefficients of 100 +- viscous, forwards and backwards."""
    sign = 1.0 if rate > 0.0 else -1.0
    mean = -10.0 * sign - 100.0 * rate
    by_direction = -(10.0 + sign * levels) * sign - (100.0 + sign * viscous) * rate
    assert mean + body.asymmetric_friction(rate, viscous, levels) == pytest.approx(by_direction, abs=1e-9)


@given(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3), positive)
def test_the_bumper_only_pushes(stretch: float, clearance: float, stiffness: float) -> None:
    force = spring.bumper(stretch, stiffness, clearance)
    assert force >= 0.0
    assert (force > 0.0) == (stretch > clearance)


@given(angles, positive, st.floats(0.1, 50.0), st.floats(-3.0, 3.0))
def test_the_slope_of_the_periodic_law(position: float, amplitude: float, wave: float, phase: float) -> None:
    step = 1e-6 / wave
    difference = periodic.periodic(position + step, amplitude, wave, phase)
    difference -= periodic.periodic(position - step, amplitude, wave, phase)
    slope = periodic.periodic_slope(position, amplitude, wave, phase)
    assert difference / (2.0 * step) == pytest.approx(slope, abs=1e-4 * amplitude * wave)


@given(st.floats(-3.0, 3.0), positive, positive, positive)
def test_a_winding_warms_up_to_its_loss(current: float, resistance: float, gain: float, tau: float) -> None:
    steady = gain * resistance * current * current
    rate = drive.heating_rate(0.0, current, resistance, gain, tau)
    assert rate >= 0.0
    assert rate - steady / tau == pytest.approx(0.0, abs=1e-12 * rate)  # the decay of the linear plant
    assert drive.voltage_of_heat(steady, current, resistance) == pytest.approx(resistance * steady * current)


@given(st.floats(-1e-2, 1e-2), positive)
def test_the_cubic_spring_is_odd(stretch: float, k3: float) -> None:
    assert spring.cubic_stiffness(-stretch, k3) == -spring.cubic_stiffness(stretch, k3)
    assert spring.cubic_stiffness(stretch, k3) == pytest.approx(k3 * stretch**3)
    assert spring.stiffness_drift(stretch, 2.0, k3, 0.5) == pytest.approx(k3 * stretch)


@given(st.lists(angles, min_size=1), st.floats(0.0, 0.05), st.floats(-3.1, 3.1))
def test_an_eccentric_encoder_is_right_at_zero_and_can_be_undone(turned, amplitude, phase) -> None:
    shown = np.array([sensor.eccentric(a, amplitude, phase) for a in turned])
    assert sensor.eccentric(0.0, amplitude, phase) == 0.0
    assert np.abs(shown - turned).max() <= 2.0 * amplitude + 1e-12
    assert sensor.centred(shown, amplitude, phase) == pytest.approx(turned, abs=2.0 * amplitude**5 + 1e-9)
