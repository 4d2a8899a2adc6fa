"""Faults of wiring, sensors and sampling: found where they are, and never where physics is missing."""

from dataclasses import replace

import machine_cases as cases
import machines
import numpy as np
import pandas as pd
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.diagnose import Record, diagnose, diagnose_records
from dtbacklash.diagnose.inspect.inspection import inspect
from dtbacklash.diagnose.inspect.wiring import wiring
from dtbacklash.diagnose.say.sentences import limits_said
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.recording import Recording

from ..conftest import STEP_S, failed, record_of, with_


def test_a_clean_recording_passes_every_row(rig, clean):
    found = inspect(rig, [clean])
    assert found.fault is None
    assert not found.notes
    assert not failed(found)
    assert {"polarity of q3", "polarity of theta_m", "q3 is not clipped"} <= {c.check for c in found.checks}
    assert found.records[0] is clean


@pytest.mark.check
def test_machines_with_missing_physics_are_not_miswired(machine_recordings):
    """Friction near stalling, loads, play, PID loops: the largest reversal is far below the threshold."""
    largest = {}
    for name, (rig, record) in machine_recordings.items():
        found, rewiring = wiring(rig, record)
        assert rewiring is None, (name, rewiring)
        largest[name] = max(r.value for r in found)
    assert len(largest) > 35
    assert max(largest.values()) < 0.1


@pytest.mark.parametrize("seed", range(60, 75))
@pytest.mark.nightly
def test_drawn_machines_are_not_miswired(seed):
    rig, record = record_of(cases.drawn_case(seed))
    found = inspect(rig, [record])
    assert not [c for c in found.checks if not c.passed and "polarity" in c.check]
    assert found.fault is None or "turned" not in found.fault.what


@pytest.mark.parametrize("mass", [0.5, 1.4])
@pytest.mark.parametrize("tone_rad_s", [25.0, 33.5, 42.0])
def test_a_wrong_mass_that_turns_the_phase_is_no_turned_sensor(mass, tone_rad_s):
    """Between the nominal and the true resonance the motion is in opposition to what the nominal rig does."""
    machine = machines.Machine((mass,), gain=2.0, ground=900.0, ground_damping=1.2)
    u = 2.0 * np.sin(tone_rad_s * machines.times(8.0))
    x, _, _ = machines.record(machine, u, 1e-6)
    everywhere = np.ones(len(u), dtype=bool)
    assert wiring(cases.oscillator(), Record(STEP_S, u, {"y": x[:, 0]}, everywhere, ~everywhere))[1] is None


@pytest.mark.check
def test_each_turned_sensor_is_named(machine_recordings):
    for name in ("stage, free, friction", "motor, PID", "screw, closed loop, friction"):
        rig, record = machine_recordings[name]
        for channel in record.y:
            found = wiring(rig, with_(record, **{channel: -record.y[channel]}))[1]
            assert found is not None, (name, channel)
            assert (found.turned, found.swapped) == ((channel,), None), (name, channel)


def test_a_turned_command_is_told_from_a_turned_sensor_where_there_are_two(machine_recordings):
    rig, record = machine_recordings["carriage, friction, speed too"]
    found = wiring(rig, replace(record, u=-record.u))[1]
    assert found is not None
    assert (found.turned, found.instead) == (("u",), ())
    rig, record = machine_recordings["carriage, friction"]
    found = wiring(rig, replace(record, u=-record.u))[1]
    assert found is not None
    assert (found.turned, found.instead) == (("x",), ("u",))


@pytest.mark.parametrize("name", ["stage, free, play", "stage, grounded, friction", "stage, PID", "screw, closed loop"])
def test_swapped_sensors_are_named(machine_recordings, name):
    rig, record = machine_recordings[name]
    a, b = ("q3", "q2") if "screw" in name else ("x1", "x2")
    found = wiring(rig, with_(record, **{a: record.y[b], b: record.y[a]}))[1]
    assert found is not None
    assert (found.turned, found.swapped) == ((), (a, b))


@pytest.mark.parametrize("name", [
    "screw, friction",
    pytest.param("screw, play as wide as the motion", marks=pytest.mark.check),
    pytest.param("screw, closed loop", marks=pytest.mark.check),
])  # fmt: skip
def test_swapped_columns_of_an_angle_and_a_position_are_named_whatever_their_units(machine_recordings, name):
    rig, record = machine_recordings[name]
    swapped = with_(record, theta_m=1e3 * record.y["q3"], q3=1e-3 * record.y["theta_m"])
    found = inspect(rig, [swapped])
    assert found.fault is not None
    assert found.fault.what == "theta_m and q3 have changed places"
    assert found.fault.mend.startswith("Swap theta_m and q3 in the recording (or in its mapping)")
    assert "theta_m and q3 are in their places" in failed(found)


def test_a_turned_sensor_ends_in_no_physics(rig, clean):
    found = diagnose_records(rig, [with_(clean, q3=-clean.y["q3"])])
    document = found.to_json()
    assert document["verdict"] == "unexplained"
    assert not document["findings"]
    assert document["located"]["location"] == "sensor_q3"
    assert document["summary"].startswith("q3 has its sign turned round: turned back, q3 accounts for 100 %")
    assert "scale: -1" in document["next_experiment"]
    row = next(c for c in document["checks"] if c["check"] == "polarity of q3")
    assert not row["pass"]
    assert row["statistic"] > SETTINGS.reversal_share
    assert {c.name for c in found.shown.curves} == {"theta_m", "q3"}


@pytest.mark.nightly
def test_two_channels_swapped_in_a_loop_end_in_a_verdict(machine_recordings):
    rig, record = machine_recordings["stage, PID"]
    found = diagnose_records(rig, [with_(record, x1=record.y["x2"], x2=record.y["x1"])])
    assert (found.verdict, found.findings) == ("unexplained", ())
    assert found.fault == "x1 and x2 have changed places"


def thinned(record: Record, by: int) -> Record:
    y = {n: v[::by].copy() for n, v in record.y.items()}
    return Record(by * record.sample_time_s, record.u[::by].copy(), y, record.train[::by], record.held[::by])


@pytest.mark.check
def test_fifty_hertz_are_too_slow_for_the_structure(rig, clean):
    found = diagnose_records(rig, [thinned(clean, 20)])
    assert (found.verdict, found.findings) == ("unexplained", ())
    assert found.fault == "The sampling (50 Hz) is too slow for this rig"
    assert "11.3 Hz has 4.4 samples a period" in found.summary


def test_a_mode_that_the_recording_does_not_show_asks_for_no_sampling(clean):
    stiff = build_rig(compose("rig=lead_screw", "rig.parameters.k.value=1e10").rig)
    found = inspect(stiff, [clean])
    assert "the sampling carries the rig's modes" not in failed(found)


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


def test_what_stands_at_its_limit_is_said():
    said = limits_said(["`force` of ground friction at mass 1"], ["`m1`", "`k`"])
    assert "`force` of ground friction at mass 1 stands at the end of the range" in said
    assert "`m1` and `k` stand at the limit" in said
    assert limits_said([], []) == ""
