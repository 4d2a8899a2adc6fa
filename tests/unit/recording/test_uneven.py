"""Uneven times are resampled where the steps are short beside what moves, and refused with the row where not."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dtbacklash.errors import UserError
from dtbacklash.recording import Recording

HZ = 2.0


def logged(steps_s, gap_s=0.0, command=lambda t: np.sign(np.sin(t))) -> pd.DataFrame:
    """A motion of 2 Hz that is logged at uneven times."""
    t = np.concatenate([[0.0], np.cumsum(steps_s)])
    t[len(t) // 2 :] += gap_s
    return pd.DataFrame({"t_s": t, "u": command(t), "x [mm]": motion(t)})


def motion(t):
    return 3.0 * np.sin(2 * np.pi * HZ * t) + np.sin(2 * np.pi * 0.5 * t)


def steps(seed, spread, count=2000, mean_s=0.005):
    return mean_s * (1.0 + spread * np.random.default_rng(seed).uniform(-1.0, 1.0, count))


@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 10**6), spread=st.sampled_from([0.6, 0.8, 0.95]), gap_s=st.sampled_from([0.0, 3.0]))
def test_uneven_steps_are_resampled_and_said(seed, spread, gap_s):
    frame = logged(steps(seed, spread), gap_s)
    found = Recording.from_frame(frame)
    assert len(found.stretches) == (2 if gap_s else 1)
    assert np.allclose(np.diff(found.t_s)[: found.stretches[0][1] - 1], found.sample_time_s)
    assert np.abs(found.channels["x"] - 1e-3 * motion(found.t_s)).max() < 1e-5
    assert any("Sampling is uneven, with steps from" in note for note in found.notes)


def test_a_held_command_keeps_its_impulse():
    frame = logged(steps(1, 0.9), command=lambda t: np.cumsum(np.cos(40.0 * t)))
    found = Recording.from_frame(frame)
    held = float(np.sum(frame.u[:-1] * np.diff(frame.t_s)))
    assert found.sample_time_s * found.channels["u"].sum() == pytest.approx(held, abs=0.01 * np.abs(frame.u).max())


def test_a_step_beyond_a_quarter_of_the_fastest_period_is_refused_with_its_row():
    pauses = steps(2, 0.9, 600, 0.03)
    pauses[300] = 0.2
    said = r"uneven: 0.2 s pass before row 302 of .* fastest period that x shows \(0.4"
    with pytest.raises(UserError, match=said) as e:
        Recording.from_frame(logged(pauses))
    assert "recording.rows=[FIRST,LAST]" in str(e.value)


def test_a_channel_that_stops_early_is_said_with_its_time():
    frame = logged(np.full(2000, 0.005))
    frame.loc[1800:, "x [mm]"] = np.nan
    said = "were cut off. Channel x stops at t = 8.995 s, and the recording at 10 s."
    assert any(said in note for note in Recording.from_frame(frame).notes)
    frame.loc[1200:, "x [mm]"] = np.nan
    with pytest.raises(UserError, match=r"60 % of the rows only. Channel x stops at t = 5.995 s.*recording.rows="):
        Recording.from_frame(frame)
