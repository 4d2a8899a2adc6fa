"""The rig of the paper, and a motion that has steps, rests and many reversals."""

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.prove import draw as drawing

STEP_S = 1e-3


@pytest.fixture(scope="session")
def lead_screw():
    return nominal_rig("lead_screw")


@pytest.fixture
def short(monkeypatch):
    """Recordings of 3 s, so that the tests are quick."""
    monkeypatch.setattr(drawing, "DURATION_S", (3, 3))


@pytest.fixture(scope="session")
def command():
    """(3000,) V: random levels of 0.125 s and a sine of 7 Hz, mean zero."""
    levels = np.random.default_rng(0).uniform(-3.0, 3.0, 24)
    u = np.repeat(levels - levels.mean(), 125)
    return u + 0.5 * np.sin(2 * np.pi * 7 * STEP_S * np.arange(u.size))
