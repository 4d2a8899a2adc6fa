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


@pytest.mark.parametrize("change", ["none", "rounded", "one channel by a billionth"])
def test_a_copy_is_known_however_it_was_written(change):
    frame = moved(1)
    if change == "rounded":
        frame[["u", "theta"]] = frame[["u", "theta"]].round(6)
    elif change != "none":
        frame["u"] += 1e-9
    assert shared_rows(read(moved(1)), read(frame)) > 1900


def test_the_same_motion_recorded_again_is_another_recording():
    assert shared_rows(read(moved(1)), read(moved(2))) == 0


def test_a_later_part_of_it_shares_its_rows():
    assert shared_rows(read(moved(1)), read(moved(1)[500:].reset_index(drop=True))) == 1500
