"""Zeros of position sensors that differ between recordings: found where the rig shows them, left where it does not."""

from dataclasses import replace

import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnose import Record
from dtbacklash.diagnose.data.pull import cut, zero_channels
from dtbacklash.diagnose.data.tempo import tempo_rad_s
from dtbacklash.diagnose.data.zeros import aligned
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import simulate

from ..conftest import STEP_S, command

SECONDS = 6.0


def recorded(rig: Rig, number: int, step_s: float, channels: tuple[str, ...], **off: float) -> Record:
    """A recording whose positions are counted from other zeros: ``off`` by channel."""
    u = command(SECONDS, number + 1)[:: round(step_s / STEP_S)]
    shown = simulate(rig, u[:-1], step_s).sensors
    y = {c: shown[c] + off.get(c, 0.0) for c in channels}
    mask = np.ones(len(u), dtype=bool)
    return Record(step_s, u, y, mask, ~mask, recording=number, own_zero=number > 0)


@pytest.mark.parametrize("name", ["oscillator", "lead_screw"])
def test_the_channels_that_show_their_zero(name):
    rig = nominal_rig(name)
    channels = ("theta_m", "q3") if name == "lead_screw" else ("x", "v")
    records = [recorded(rig, 0, STEP_S, channels)]
    shown = {c for b in cut(rig, channels, STEP_S, tempo_rad_s(rig, records)) for c in zero_channels(rig, b, STEP_S)}
    assert shown == {"oscillator": {"x"}, "lead_screw": {"q3"}}[name]  # a motor may stand at any angle


@pytest.mark.parametrize("step_s", [STEP_S, 2 * STEP_S])
def test_a_spring_to_the_ground_shows_the_zero(step_s):
    rig = nominal_rig("oscillator")
    first, second = recorded(rig, 0, STEP_S, ("x",)), recorded(rig, 1, step_s, ("x",), x=0.02)
    same, moved = aligned(rig, [first, second])
    assert same is first
    assert moved.zero["x"] == pytest.approx(0.02, rel=1e-3)
    assert moved.y["x"] == pytest.approx(second.y["x"] - moved.zero["x"])


def test_an_imposed_angle_shows_the_zero_of_what_it_drives():
    rig = nominal_rig("lead_screw")
    channels = "theta_m", "q3"
    records = [
        recorded(rig, 0, STEP_S, channels, q3=1e-4),  # what is the same in both is no zero of the second
        recorded(rig, 1, 2 * STEP_S, channels, q3=3e-3 + 1e-4, theta_m=1.7),
    ]
    moved = aligned(rig, records)[1]
    lead = rig.only("screw").values["lead"]
    assert moved.zero == {"q3": pytest.approx(3e-3 - 1.7 * lead, rel=1e-3)}
    assert moved.y["theta_m"] is records[1].y["theta_m"]


def test_one_recording_and_what_judges_it_keep_their_zeros():
    rig = nominal_rig("oscillator")
    records = [replace(recorded(rig, n, STEP_S, ("x",), x=0.01 * n), own_zero=False) for n in (0, 1)]
    assert aligned(rig, records) is records
