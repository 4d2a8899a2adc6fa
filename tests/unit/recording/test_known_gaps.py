"""Recordings that should be refused, and are not yet (docs/recordings.md)."""

import numpy as np
import pandas as pd
import pytest

from dtbacklash.errors import UserError
from dtbacklash.recording import Recording


@pytest.mark.xfail(
    reason="`t` is the clock, and `time` is ignored like any other column", strict=True, raises=pytest.fail.Exception
)
def test_two_clocks_that_contradict_each_other_are_refused() -> None:
    t = 1e-3 * np.arange(500)
    frame = pd.DataFrame({"t": t, "time": 2.0 * t, "u": np.sin(9.0 * t), "q3": np.sin(7.0 * t)})
    with pytest.raises(UserError):
        Recording.from_frame(frame)
