"""A recording without a command ends where its machine rests."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose.data.decay import RESTS, while_it_moves
from dtbacklash.recording.model import Recording

STEP_S, NOISE = 1e-3, 1e-6


@pytest.fixture
def oscillator():
    return nominal_rig("oscillator")


def decay(seconds, rate, u=0.0, first=1e-3):
    t = STEP_S * np.arange(round(seconds / STEP_S))
    x = first * np.exp(-rate * t) * np.cos(40.0 * t) + NOISE * np.random.default_rng(1).standard_normal(len(t))
    channels = {"u": np.full(len(t), u), "x": x, "unused": t}
    return Recording("decay", None, STEP_S, 5.0 + t, channels, {"u": "V", "x": "m", "unused": "s"}, ["as read"])


def test_what_comes_after_the_motion_is_left_out_and_said(oscillator):
    whole = decay(20.0, 2.0)
    part = while_it_moves(whole, oscillator)
    # exp(-2 t) / sqrt(2) falls to two standard deviations of the noise, 1e-6 of 1e-3, at 2.9 s
    assert part.duration_s == pytest.approx(2.9 * (1.0 + RESTS), abs=0.25)
    assert np.array_equal(part.channels["x"], whole.channels["x"][: part.samples])
    assert part.notes[0] == "as read"
    assert part.notes[1] == (
        "Nothing was commanded (u is 0): the state in which it begins is all that moves the machine. "
        f"What comes after {part.samples * STEP_S:.4g} s is left out: there it rests."
    )


def test_a_decay_that_lasts_stays_whole(oscillator):
    part = while_it_moves(decay(3.0, 0.5), oscillator)
    assert part.samples == 3000
    assert "left out" not in part.notes[1]


def test_a_commanded_recording_is_no_decay(oscillator):
    whole = decay(20.0, 2.0, u=0.1)
    assert while_it_moves(whole, oscillator) is whole


def test_where_nothing_moves_all_is_kept(oscillator):
    assert while_it_moves(decay(5.0, 2.0, first=0.0), oscillator).samples == 5000
