"""Sensors whose log has a clock of its own: found with its rate and set right; never found where there is none."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from nominal import nominal_rig

import dtbacklash as dtb
from dtbacklash.diagnosis.inspect.clock import GAIN, clock_of, clocks
from dtbacklash.diagnosis.inspect.inspection import inspect
from dtbacklash.diagnosis.records import Record
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording.model import Recording

from ..conftest import STEP_S, command, failed


def logged(record, fast):
    """The record, a logger of whose sensors stamps what happened at t with t (1 + fast)."""
    t = record.sample_time_s * np.arange(record.samples)
    return replace(record, y={name: np.interp(t / (1.0 + fast), t, y) for name, y in record.y.items()})


@pytest.mark.parametrize("fast", [0.005, -0.005, 0.012])
def test_a_log_that_runs_fast_or_slow_is_set_right_and_said(rig, clean, fast):
    wrong = logged(clean, fast)
    found = inspect(rig, [wrong])
    assert found.fault is None
    assert failed(found) == ["the sensors and u have one clock"]
    (note,), (after,) = found.notes, found.records
    assert note.startswith("The clock of ")
    assert f"{'fast' if fast > 0.0 else 'slow'} against that of u" in note
    ((clock, names),) = clocks(rig, [wrong]).values()
    assert set(names) == set(clean.y)
    assert clock.fast == pytest.approx(fast, abs=2e-4)
    for name, y in clean.y.items():
        read = np.isfinite(after.y[name])
        assert read.mean() > 0.98
        assert np.std((after.y[name] - y)[read]) < 0.2 * np.std((wrong.y[name] - y)[read])


def test_a_gap_stays_one(rig, clean):
    holes = np.arange(clean.samples) % 2000 < 40
    wrong = logged(replace(clean, y={n: np.where(holes, np.nan, y) for n, y in clean.y.items()}), 0.005)
    (after,) = inspect(rig, [wrong]).records
    assert all(0.9 < np.isfinite(y).mean() < 0.99 for y in after.y.values())


def test_a_play_that_grows_is_no_clock(rig):
    """Of a square wave it makes what lies behind it later and later, at all frequencies alike."""
    t = STEP_S * np.arange(30_001)
    u = 4.0 * np.sign(np.sin(2.0 * np.pi * 0.8 * t))
    shown = simulate(rig, u[:-1], STEP_S, np.linspace(0.0, 1.5, len(u))).sensors

    train = t < 20.0
    found = inspect(rig, [Record(STEP_S, u, {n: shown[n] for n in ("theta_m", "q3")}, train, ~train)])
    assert "the sensors and u have one clock" not in failed(found)


@pytest.mark.check
def test_machines_with_missing_physics_have_one_clock_and_half_a_percent_is_seen(machine_recordings):
    fast = {}
    for machine, (rig, record) in machine_recordings.items():
        for known in clocks(rig, [record]).values():
            assert known[0].gain < 0.9 * GAIN, machine
        for known in clocks(rig, [logged(record, 0.005)]).values():
            fast[machine] = known[0].fast if known[0].gain > GAIN else None
    seen = [f for f in fast.values() if f is not None]
    assert len(seen) >= 0.5 * len(fast)
    assert np.abs(np.array(seen) - 0.005).max() < 1.5e-3


def test_a_long_recording_of_all_frequencies_takes_little_memory():
    """What is tried grows with the length, what is kept of it does not."""
    rng = np.random.default_rng(0)
    u = rng.choice([-1.0, 1.0], 120_000)
    y = np.cumsum(np.convolve(u, np.exp(-np.arange(200) / 20.0))[: len(u)])
    tracemalloc.start()
    clock = clock_of(u, y, 1e-3)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert clock.gain < 1.1
    assert peak < 60.0 * 8 * len(u)


@pytest.mark.check
def test_after_a_clock_was_set_right_no_name_is_sure():
    """What is left of a clock may have made the friction that is named."""
    rig = nominal_rig("pendulum")
    u, rng = 0.2 * command(30.0, 1), np.random.default_rng(1)
    shown = simulate(rig.with_effect("disk", "coulomb_friction", {"torque": 0.02}), u[:-1], STEP_S).sensors
    y = {n: v + 1e-3 * v.std() * rng.standard_normal(len(u)) for n, v in shown.items()}
    record = Record(STEP_S, u, y, u < np.inf, u > np.inf)
    t = STEP_S * np.arange(len(u))
    frame = pd.DataFrame({"t": t, "u": record.u, **logged(record, 0.005).y})
    found = dtb.diagnose(Recording.from_frame(frame, rig=rig), rig).diagnosis
    assert found.summary.startswith("The clock of ")
    assert "Record both with one clock" in found.summary
    assert all(finding.confidence == "partial" for finding in found.findings)
