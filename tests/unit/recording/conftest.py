"""A made-up recording in plain columns, which are SI, and ways to spoil it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from nominal import nominal_rig

from dtbacklash.errors import UserError
from dtbacklash.recording import read_recording

STEP_S = 1e-3
SAMPLES = 4000
LEAD = 1e-3 / np.pi  # m/rad


@pytest.fixture(autouse=True)
def nowhere(tmp_path, monkeypatch):
    """No recordings but those that a test makes."""
    monkeypatch.delenv("DTB_RECORDINGS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def frame():
    """Smooth, never resting signals: t [s], r [m], u [V], theta_m [rad], q3 [m]."""
    t = STEP_S * np.arange(SAMPLES)
    theta = 3.0 * np.sin(2 * np.pi * 0.7 * t) + 0.5 * np.sin(2 * np.pi * 3.1 * t + 1.0)
    u = np.gradient(theta, STEP_S) / 3
    return pd.DataFrame({"t": t, "r": LEAD * theta, "u": u, "theta_m": theta, "q3": LEAD * theta})


@pytest.fixture
def save(tmp_path):
    """Write a frame as CSV; returns the path."""

    def write(frame: pd.DataFrame, name: str = "seen.csv") -> Path:
        frame.to_csv(tmp_path / name, index=False)
        return tmp_path / name

    return write


@pytest.fixture
def refusal():
    """The line with which a recording is refused."""

    def line(*arguments, **options) -> str:
        with pytest.raises(UserError) as caught:
            read_recording(*arguments, **options)
        assert caught.value.key in ("recording", "recording.path")
        assert "\n" not in str(caught.value)
        return str(caught.value)

    return line


@pytest.fixture(scope="session")
def lead_screw():
    """The shipped rig, whose positions are recorded in mm."""

    return nominal_rig("lead_screw")
