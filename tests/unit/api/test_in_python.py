"""What is wrong is said in Python's words where Python is spoken."""

import numpy as np
import pandas as pd
import pytest
from told import refused

import dtbacklash as dtb

T = 1e-3 * np.arange(500)
SOUND = {"t": T, "u": np.sin(9.0 * T), "theta": np.cos(7.0 * T)}


@pytest.mark.parametrize(("options", "said"), [
    ({"units": {"theta": "furlong"}}, r"units['theta']=furlong: "),
    ({"command": "loud"}, "command=loud: choose one of"),
    ({"sample_time_s": -1.0}, "sample_time_s=-1.0: "),
])  # fmt: skip
def test_an_error_names_the_argument(options, said, tmp_path):
    file = tmp_path / "bench.csv"
    pd.DataFrame(SOUND if "sample_time_s" not in options else {k: SOUND[k] for k in ("u", "theta")}).to_csv(file)
    with refused(start=said):
        dtb.read_recording(file, rig="pendulum", **options)


def test_a_remedy_is_an_argument_and_no_word_of_the_command_line(tmp_path):
    headless = tmp_path / "headless.csv"
    pd.DataFrame(SOUND).to_csv(headless, header=False, index=False)
    with pytest.raises(dtb.UserError) as told:
        dtb.diagnose(headless, "pendulum")
    assert "frame.rename(columns={0: 't', 1: 'u', 2: 'theta'})" in str(told.value)
    assert "MAPPING" not in str(told.value)
