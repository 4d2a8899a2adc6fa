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


WHOLE = moved(1)
NUDGED = {c: WHOLE.assign(**{c: WHOLE[c] + 1e-9 * (WHOLE.index == 1999)}) for c in ("u", "theta")}


@pytest.mark.parametrize(("other", "shared"), [
    (WHOLE, 2000), (WHOLE[500:1700].reset_index(drop=True), 1200), (moved(2), 0),
    (NUDGED["u"], 0), (NUDGED["theta"], 0), (WHOLE.rename(columns={"theta": "omega"}), 0),
], ids=["a copy", "a part", "the same motion again", "another command", "another angle", "another sensor"])  # fmt: skip
def test_rows_are_shared_where_all_samples_are_the_same(other, shared):
    assert shared_rows(read(WHOLE), read(other)) == shared_rows(read(other), read(WHOLE)) == shared
