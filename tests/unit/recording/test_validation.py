"""Whether two recordings hold the same samples."""

import numpy as np
import pandas as pd
import pytest
from nominal import nominal_rig

from dtbacklash.recording import Recording
from dtbacklash.recording.validation import shared_rows

NOISE = 1e-4


def moved(seed: int, samples: int = 2000) -> pd.DataFrame:
    """The same motion each time; noise of its own."""
    t, rng = 1e-3 * np.arange(samples), np.random.default_rng(seed)
    return pd.DataFrame({
        "t": t, "u": np.sin(9.0 * t), "theta": np.sin(9.0 * t - 0.3) + NOISE * rng.standard_normal(samples),
    })  # fmt: skip


def read(frame: pd.DataFrame) -> Recording:
    return Recording.from_frame(frame, rig=nominal_rig("pendulum"))


def test_a_copy_is_known():
    assert shared_rows(read(moved(1)), read(moved(1))) == 2000


@pytest.mark.parametrize("channel", ["u", "theta"])
def test_what_differs_anywhere_is_no_copy(channel):
    other = moved(1)
    other.loc[1999, channel] += 1e-9
    assert shared_rows(read(moved(1)), read(other)) == 0


def test_the_same_motion_recorded_again_is_another_recording():
    assert shared_rows(read(moved(1)), read(moved(2))) == 0


@pytest.mark.parametrize("turned", [False, True])
def test_a_part_of_it_shares_all_its_rows(turned):
    both = read(moved(1)), read(moved(1)[500:1700].reset_index(drop=True))
    assert shared_rows(*(both[::-1] if turned else both)) == 1200


def test_a_command_alone_is_no_copy():
    with_speed = read(moved(1).rename(columns={"theta": "omega"}))
    assert shared_rows(read(moved(1)), with_speed) == 0
