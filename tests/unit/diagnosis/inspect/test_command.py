"""Outliers of the command: found where no sensor answers them, with their row; a pulse that was commanded is none."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnosis.inspect.command import bridged, outliers
from dtbacklash.diagnosis.inspect.inspection import inspect

from ..conftest import STEP_S, command, failed, recorded

AT = 4200


@pytest.mark.parametrize("size", [-142026.0, 60.0, -30.0])
def test_an_outlier_is_bridged_and_said_with_its_row(rig, clean, size):
    u = clean.u.copy()
    u[AT] = size
    found = inspect(rig, [replace(clean, u=u)])
    assert found.fault is None
    assert failed(found) == ["u is free of outliers"]
    assert found.notes == [f"u is {size:g} at 4.2 s (row 4201 of the values), and no sensor answers that: bridged."]
    (after,) = found.records
    assert np.array_equal(np.delete(after.u, AT), np.delete(clean.u, AT))
    assert after.u[AT] == pytest.approx(0.5 * (clean.u[AT - 1] + clean.u[AT + 1]))


def test_many_are_counted(rig, clean):
    u = clean.u.copy()
    u[500:6000:700] = 80.0
    notes = inspect(rig, [replace(clean, u=u)]).notes
    assert len(notes) == 4
    assert notes[-1] == "u has 5 more outliers: bridged."


@pytest.mark.parametrize("size", [1000.0, 60.0, -30.0])
def test_a_pulse_that_was_commanded_is_none(rig, size):
    u = command(12.0, 1)
    u[AT] = size
    assert not outliers(rig, recorded(rig, u=u)).any()


def test_a_hammers_blows_are_none(rig):
    u = np.zeros(8001)
    u[::900] = 40.0
    record = recorded(rig, u=u)
    assert not outliers(rig, record).any()
    assert np.array_equal(bridged(record, np.arange(8001) % 900 == 0).u, 0.0 * u)


def test_a_step_a_ramp_and_noise_are_none(rig):
    t = STEP_S * np.arange(8001)
    for u in (np.where(t < 3.0, 1.0, -2.0), np.abs((t % 2.0) - 1.0), np.random.default_rng(1).standard_normal(len(t))):
        assert not outliers(rig, recorded(rig, u=u)).any()


@pytest.mark.check
def test_machines_with_missing_physics_have_none(machine_recordings):
    assert not [name for name, (rig, record) in machine_recordings.items() if outliers(rig, record).any()]
