"""Readings that repeat: told from the counts of a slow motion, and from a machine at rest."""

import numpy as np
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from dtbacklash.diagnosis.inspect import samples

from ..conftest import recorded


def held(values: np.ndarray, every: int, first: int = 0) -> np.ndarray:
    """What a sensor shows that is read at every so many samples only."""
    at = np.arange(len(values))
    return values[np.maximum((at - first) // every * every + first, 0)]


def test_the_first_value_of_a_sensor_that_is_read_seldom_is_known():
    """A machine begins at rest there, and its first state with it."""
    values = np.concatenate([np.zeros(10), held(np.linspace(1.0, 7.0, 990) ** 2, 10)])
    assert np.flatnonzero(~samples.stale(values)).tolist() == list(range(0, 1000, 10))


@given(slope=st.floats(0.02, 3.0), count=st.floats(0.5, 2.0), noise=st.floats(0.0, 2.0), seed=st.integers(0, 10**6))
@hypothesis_settings(deadline=None)
def test_counts_of_a_slow_motion_are_no_held_readings(slope, count, noise, seed):
    rng = np.random.default_rng(seed)
    t = np.arange(4000)
    motion = slope * 200.0 * np.sin(t / 200.0) + noise * rng.standard_normal(len(t))
    assert not samples.stale(count * np.round(motion / count)).any()


@given(every=st.integers(2, 40), first=st.integers(0, 39), seed=st.integers(0, 10**6))
@hypothesis_settings(deadline=None)
def test_held_readings_are_found_whatever_their_rate(every, first, seed):
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.standard_normal(4000))
    known = np.flatnonzero(~samples.stale(held(values, every, first % every)))
    assert set((known[1:] - first) % every) == {0}


def test_a_machine_at_rest_does_not_hang(rig):
    """An encoder repeats its count, and a simulated one without noise all its digits."""
    rest = np.concatenate([np.zeros(500), recorded(rig).y["q3"]])
    assert not samples.hung(rest).any()


def test_a_motor_that_friction_holds_and_lets_go_does_not_hang():
    """It sets off faster than it moves on the whole, as it mostly rests, and goes on: a jump would end there."""
    rng = np.random.default_rng(2)
    moves = [np.concatenate([np.zeros(rng.integers(60, 120)), rng.choice([-1, 1]) * np.array([8, 9, 9, 8, 6, 3, 1])])
             for _ in range(40)]  # fmt: skip
    assert not samples.hung(np.cumsum(np.concatenate(moves))).any()


@given(stop=st.integers(1000, 3000), pause=st.integers(12, 200), seed=st.integers(0, 10**6))
@hypothesis_settings(deadline=None)
def test_a_sensor_that_hangs_while_the_machine_moves_on_is_found(stop, pause, seed):
    t = np.arange(4000) / 1000.0
    seen = 50.0 * t + 0.01 * np.random.default_rng(seed).standard_normal(len(t))
    seen[stop + 1 : stop + pause] = seen[stop]
    assert set(np.flatnonzero(samples.hung(seen))) == set(range(stop + 1, stop + pause))
