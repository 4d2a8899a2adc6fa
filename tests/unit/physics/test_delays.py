"""A delay is no whole number of ticks: what a rig shows changes smoothly with it, as the search for it needs."""

import itertools

import numpy as np
import pytest
from nominal import nominal_rig
from reference.cases import three_tones

from dtbacklash.physics.simulate import simulate

STEP_S, LEVELS = 1e-3, 10
TICK_S = STEP_S / 2**LEVELS
RIG, COMMAND = nominal_rig("oscillator"), three_tones(0.5)[:-1]


def shown(place: str, time_s: float, levels: int = LEVELS) -> np.ndarray:
    rig = RIG.with_effect(place, "delay", {"time": time_s}) if time_s else RIG
    return simulate(rig, COMMAND, STEP_S, event_levels=levels).sensors["x"]


@pytest.mark.parametrize("place", ["amplifier", "sensor_x"])
@pytest.mark.parametrize("whole", [0.4, 97.3, 512.0, 1500.7])
def test_what_a_rig_shows_moves_evenly_with_a_delay(place, whole):
    """In steps of a fifth of a tick, over ticks: rounding would move it by nothing or by a whole one."""
    at = [shown(place, (whole + 0.2 * k) * TICK_S) for k in range(12)]
    moved = np.array([np.linalg.norm(b - a) for a, b in itertools.pairwise(at)])
    assert moved.max() < 1.02 * moved.min()


@pytest.mark.parametrize("place", ["amplifier", "sensor_x"])
@pytest.mark.parametrize("time_s", [97.31e-6, 5.123e-4, 1.37777e-3])
def test_it_is_as_late_as_with_the_finest_ticks(place, time_s):
    effect = np.linalg.norm(shown(place, time_s, 22) - shown(place, 0.0))
    assert np.linalg.norm(shown(place, time_s) - shown(place, time_s, 22)) < 1e-6 * effect


@pytest.mark.parametrize("samples", [3, 7, 40])
def test_a_moving_average_of_samples_is_their_mean(samples):
    """Of so many readings; it began at rest at 0."""
    window = samples * STEP_S
    values = {"window": window, "middle": 0.5 * (1.0 - 1.0 / samples)}
    filtered = simulate(RIG.with_effect("sensor_x", "moving_average", values), COMMAND, STEP_S).sensors["x"]
    plain = shown("sensor_x", 0.0)
    mean = np.convolve(plain, np.full(samples, 1.0 / samples))[: len(plain)]
    assert np.abs(filtered - mean).max() < 3e-5 * np.ptp(plain)


def test_a_moving_average_of_all_instants_is_an_integral():
    window, fine = 0.03, 20
    values = {"window": window, "middle": 0.5}
    filtered = simulate(RIG.with_effect("sensor_x", "moving_average", values), COMMAND, STEP_S).sensors["x"]
    plain = simulate(RIG, np.repeat(COMMAND, fine), STEP_S / fine).sensors["x"]
    area = np.concatenate([[0.0], np.cumsum(0.5 * (plain[1:] + plain[:-1])) * STEP_S / fine])
    back = round(window / STEP_S) * fine
    mean = (area - np.concatenate([np.zeros(back), area[:-back]])) / window
    assert np.abs(filtered - mean[::fine]).max() < 1e-5 * np.ptp(plain)
