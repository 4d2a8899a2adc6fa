"""The command of a rig with a servo is a position, in any of its units; a volt stands for one in SI."""

import numpy as np
import pandas as pd
import pytest
from reference import rigs

from dtbacklash.errors import UserError
from dtbacklash.recording import Recording


def frame(head):
    t = 2e-3 * np.arange(400)
    return pd.DataFrame(
        {"t": t, head: np.sin(5 * t), "theta [deg]": np.sin(5 * t - 0.2), "theta_l": np.sin(5 * t - 0.2)}
    )


@pytest.mark.parametrize(("head", "unit", "factor"), [
    ("u", "rad (assumed)", 1.0), ("u [deg]", "deg (header)", np.pi / 180.0), ("u_v", "v (header)", 1.0),
])  # fmt: skip
def test_a_servos_command_is_an_angle(head, unit, factor):
    recording = Recording.from_frame(frame(head), rig=rigs.served(), trust_units=True)
    assert np.allclose(recording.channels["u"], factor * frame(head)[head])
    assert recording.assumed_units["u"] == unit


def test_another_quantity_is_refused():
    with pytest.raises(UserError, match="u is measured in rad"):
        Recording.from_frame(frame("u [mm]"), rig=rigs.served(), trust_units=True)
    with pytest.raises(UserError, match="u is measured in m;"):
        Recording.from_frame(
            frame("u [deg]").rename(columns={"theta_l": "x"}), rig=rigs.served_carriage(), trust_units=True
        )
