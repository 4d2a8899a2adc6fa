"""Records of recordings: their parts, short stretches, and where a recording without a command ends."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.records import RESTS, held_equivalent, long_enough, records_of, while_it_moves
from dtbacklash.recording.channels import filled
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
    holes = replace(whole, channels={**whole.channels, "x": whole.channels["x"].copy()})
    holes.channels["x"][500:510] = np.nan
    assert while_it_moves(holes, oscillator).samples == part.samples
    lasts = while_it_moves(decay(3.0, 0.5), oscillator)
    assert lasts.samples == 3000
    assert "left out" not in lasts.notes[1]
    assert while_it_moves(decay(5.0, 2.0, first=0.0), oscillator).samples == 5000  # where nothing moves
    commanded = decay(20.0, 2.0, u=0.1)
    assert while_it_moves(commanded, oscillator) is commanded


def test_each_stretch_has_its_part_of_the_masks_and_its_time(oscillator):
    stretches = ((0, 500), (500, 3000))
    first, second = records_of(replace(decay(3.0, 0.5), stretches=stretches), oscillator, True, True, 0.4, number=3)
    assert (first.samples, second.samples) == (500, 2500)
    assert (first.from_s, second.from_s, second.recording) == (0.0, pytest.approx(0.5), 3)
    assert set(first.y) == {"x"}
    assert first.train.all()
    assert second.train.sum() == 1300
    assert np.array_equal(second.held, ~second.train)


def stretches_of(rig, *ends):
    return records_of(replace(decay(3.0, 0.5), stretches=ends), rig, True, True, 0.4)


def test_short_stretches_beside_others_are_left_out_and_said(oscillator):
    records = stretches_of(oscillator, (0, 100), (100, 299), (299, 3000))
    kept, (note,) = long_enough(records)
    assert [r.samples for r in kept] == [2701]
    assert note.startswith("2 of 3 stretches (299 samples) are left out, being shorter than 200 samples")


def test_nothing_is_left_out_where_no_part_would_remain(oscillator):
    for ends in ([(0, 2900), (2900, 3000)], [(0, 3000)], [(0, 150)]):
        records = stretches_of(oscillator, *ends)
        records = [replace(r, train=~late, held=late) for r, late in
                   ((r, np.full(r.samples, r.from_s > 0.0)) for r in records)]  # fmt: skip
        assert long_enough(records) == (records, ())


def test_what_is_missing_is_filled_by_straight_lines():
    values = np.array([np.nan, 1.0, np.nan, 3.0, np.nan])
    assert filled(values).tolist() == [1.0, 1.0, 2.0, 3.0, 3.0]
    assert not filled(np.full(3, np.nan)).any()


def test_a_smooth_command_is_taken_half_a_sample_ahead():
    t = np.arange(1000.0)
    ahead = held_equivalent(np.sin(0.2 * t))[50:-50]
    gain = 0.1 / np.sin(0.1)
    assert np.abs(ahead - gain * np.sin(0.2 * (t + 0.5))[50:-50]).max() < 1e-4
