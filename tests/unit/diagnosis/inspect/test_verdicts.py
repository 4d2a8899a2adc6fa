"""Verdicts on recordings with a fault that was mended, or that forbids physics."""

from dataclasses import replace

import machine_cases as cases
import machines
import numpy as np
import pandas as pd
import pytest

from dtbacklash.diagnosis import Record, diagnose, diagnose_records
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.recording import Recording

from ..conftest import STEP_S, with_
from .test_channels import clip
from .test_repeats import held


@pytest.mark.check
def test_a_dead_sensor_is_left_out_and_said(rig, clean):
    noise = 1e-3 * np.random.default_rng(7).standard_normal(clean.samples)
    found = diagnose_records(rig, [with_(clean, q3=noise)])
    assert found.verdict == "consistent"
    assert found.fit.channels == ("theta_m",)
    assert found.summary.startswith("q3 shows nothing but noise")
    assert "q3 shows more than noise" in [c.check for c in found.checks if not c.passed]


@pytest.mark.nightly
def test_one_spike_changes_no_verdict(rig, clean):
    values = clean.y["theta_m"].copy()
    values[7000] += 30.0
    found = diagnose_records(rig, [with_(clean, theta_m=values)])
    assert found.verdict == "consistent"
    assert any("1 spike" in note for note in found.notes)


@pytest.mark.check
def test_a_clipped_sensor_changes_no_verdict(rig, clean):
    assert diagnose_records(rig, [with_(clean, q3=clip(clean.y["q3"], 0.7))]).verdict == "consistent"


@pytest.mark.nightly
def test_a_clipped_position_that_pulls_a_stage_ends_in_a_verdict(machine_recordings):
    rig, record = machine_recordings["stage, PID"]
    found = diagnose_records(rig, [with_(record, x1=clip(record.y["x1"], 0.5))])
    assert (found.verdict, found.findings) == ("unexplained", ())
    assert found.fault.startswith("x1 is clipped in")


@pytest.mark.nightly
def test_a_sensor_that_is_read_seldom_is_no_delay(rig, clean):
    """Held for ten samples it is five late on average; without a look at its readings a delay was named."""
    found = diagnose_records(rig, [with_(clean, q3=held(clean.y["q3"], 10))])
    assert (found.verdict, found.findings) == ("consistent", ())
    assert any(note.startswith("q3 repeats its readings") for note in found.notes)


@pytest.mark.nightly
def test_two_channels_swapped_in_a_loop_end_in_a_verdict(machine_recordings):
    rig, record = machine_recordings["stage, PID"]
    found = diagnose_records(rig, [with_(record, x1=record.y["x2"], x2=record.y["x1"])])
    assert (found.verdict, found.findings) == ("unexplained", ())
    assert found.fault == "x1 and x2 have changed places"


def velocity_rig() -> Rig:
    motor = cases.motor().config
    return build_rig(replace(
        motor, sensors={"omega": {"of": "shaft", "quantity": "velocity"}},
        parameters={n: replace(p, tolerance=0.05) for n, p in motor.parameters.items()},
    ))  # fmt: skip


@pytest.mark.check
def test_friction_is_named_from_the_speed_alone():
    machine = machines.Machine((2e-4,), gain=0.025, emf=0.05, coulomb=0.02)
    _, v, u = machines.record(machine, machines.multisine(machines.times(8.0), 3.0, 8.0))
    omega = v[:, 0] + 1e-2 * np.random.default_rng(3).standard_normal(len(u))
    train = np.arange(len(u)) < 0.7 * len(u)
    found = diagnose_records(velocity_rig(), [Record(STEP_S, u, {"omega": omega}, train, ~train)])
    assert [(f.location, f.effect) for f in found.findings] == [("shaft", "coulomb_friction")]
    assert found.findings[0].parameters["torque"].value == pytest.approx(0.02, rel=0.1)
    tried = {(c.location, c.effect) for c in found.candidates}
    assert ("shaft", "coulomb_friction") in tried
    assert not {effect for _, effect in tried} & {"cogging", "gravity", "torque_ripple"}


@pytest.mark.nightly
def test_a_carriage_whose_speed_alone_is_recorded_is_pulled_on_it():
    config = cases.carriage().config
    rig = build_rig(replace(
        config, sensors={"v": config.sensors["v"]},
        parameters={n: replace(p, tolerance=0.05) for n, p in config.parameters.items()},
    ))  # fmt: skip
    machine = machines.Machine((95.0,), gain=35.0, coulomb=20.0)
    _, v, u = machines.record(machine, machines.multisine(machines.times(8.0), 3.0, 8.0))
    noisy = v[:, 0] + 1e-4 * np.random.default_rng(4).standard_normal(len(u))
    train = np.arange(len(u)) < 0.7 * len(u)
    found = diagnose_records(rig, [Record(STEP_S, u, {"v": noisy}, train, ~train)])
    assert ("carriage", "ground_friction") in [(f.location, f.effect) for f in found.findings] or (
        ("carriage", "coulomb_friction") in [(f.location, f.effect) for f in found.findings]
    )


def frame_of(rig: Rig, record: Record, start: int = 0) -> Recording:
    columns = {"t": STEP_S * np.arange(record.samples), "u": record.u, **record.y}
    units = {"theta_m": "rad", "q3": "m"}
    return Recording.from_frame(pd.DataFrame(columns).iloc[start:], rig=rig, units=units)


def test_a_recording_cannot_judge_itself(rig, clean):
    whole = frame_of(rig, clean)
    for other, count in ((whole, clean.samples), (whole.section(6000, 12001), 6001)):
        with pytest.raises(UserError, match=f"holds {count} samples of the recording itself") as caught:
            diagnose(whole, rig, other)
        assert caught.value.key == "validation"
