"""When a finding matters: by what moves, never by what only looks like it."""

from types import SimpleNamespace

import numpy as np

from dtbacklash.diagnose.say.sentences import _when_it_moves

from ..conftest import STEP_S


def said(rig, channels: tuple[str, ...]) -> str:
    """Of a change at each reversal of a swinging motor, which some channels show."""
    t = STEP_S * np.arange(8000)
    angle, current = np.sin(4.0 * t), np.sin(4.0 * t + 0.8)
    change = np.exp(-(((np.abs(np.cos(4.0 * t))) / 0.05) ** 2))
    record = SimpleNamespace(y={"theta_m": angle, "i_m": current}, u=current, samples=len(t), sample_time_s=STEP_S)
    return _when_it_moves(SimpleNamespace(nominal=rig, blocks=[SimpleNamespace(channels=channels)]), record, change)


def test_reversals_are_those_of_what_moves_whatever_was_recorded_first(rig):
    assert said(rig, ("i_m", "theta_m")) == said(rig, ("theta_m",))
    assert "of a velocity reversal" in said(rig, ("theta_m",))


def test_of_a_current_alone_no_reversal_is_said(rig):
    assert said(rig, ("i_m",)) == ""
