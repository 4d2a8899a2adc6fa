"""Faults of wiring, sensors and sampling: found where they are, and never where physics is missing."""

from dataclasses import replace

import machine_cases as cases
import machines
import numpy as np
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.diagnosis.inspect.fault import faulty
from dtbacklash.diagnosis.inspect.inspection import Fault, Inspected, inspect
from dtbacklash.diagnosis.inspect.wiring import wiring
from dtbacklash.diagnosis.records import Record
from dtbacklash.physics.rig import build_rig

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
    inspected = inspect(rig, [with_(clean, q3=-clean.y["q3"])])
    assert inspected.fault is not None
    found = faulty(rig, inspected, inspected.fault)
    document = found.to_json()
    assert document["verdict"] == "unexplained"
    assert not document["findings"]
    assert document["located"]["location"] == "sensor_q3"
    assert document["summary"].startswith("q3 has its sign turned round: turned back, q3 accounts for 100 %")
    assert "scale: -1" in document["next_experiment"]
    row = next(c for c in document["checks"] if c["check"] == "polarity of q3")
    assert not row["pass"]
    assert row["statistic"] > row["threshold"] == 0.5
    assert {c.name for c in found.shown.curves} == {"theta_m", "q3"}
    # the angle is right, and the nominal rig is the machine: its free simulation is what was measured
    angle = next(c for c in found.shown.curves if c.name == "theta_m")
    assert np.abs(angle.measured - angle.nominal).max() < 0.01 * np.ptp(angle.measured)


def test_where_nothing_pulls_back_a_position_begins_as_measured(rig, clean):
    away = with_(clean, theta_m=clean.y["theta_m"] + 7.0)
    made_up = Fault("sensor_q3", "Something", "it is made up", "Mend it.")
    curves = faulty(rig, inspect(rig, [away]), made_up).shown.curves
    assert abs(next(c for c in curves if c.name == "theta_m").nominal[0] - 7.0) < 0.01
    released = Record(STEP_S, np.zeros(500), {"y": np.full(500, 0.05)}, np.arange(500) < 300, np.arange(500) >= 300)
    grounded = faulty(cases.oscillator(), Inspected([released]), made_up)
    assert not grounded.shown.curves[0].nominal.any()


def thinned(record: Record, by: int) -> Record:
    y = {n: v[::by].copy() for n, v in record.y.items()}
    return Record(by * record.sample_time_s, record.u[::by].copy(), y, record.train[::by], record.held[::by])


def test_fifty_hertz_are_too_slow_for_the_structure(rig, clean):
    fault = inspect(rig, [thinned(clean, 20)]).fault
    assert fault is not None
    assert fault.what == "The sampling (50 Hz) is too slow for this rig"
    assert "11.3 Hz has 4.4 samples a period" in fault.why


def test_a_mode_that_the_recording_does_not_show_asks_for_no_sampling(clean):
    stiff = build_rig(compose("rig=lead_screw", "rig.parameters.k.value=1e10").rig)
    found = inspect(stiff, [clean])
    assert "the sampling carries the rig's modes" not in failed(found)


@pytest.mark.parametrize(
    ("name", "channel"), [("carriage, PID, sticks", "x"), ("oscillator, friction", "y"), ("motor, hoist", "theta")]
)
def test_a_command_and_a_sensor_that_have_changed_places_are_named(machine_recordings, name, channel):
    rig, record = machine_recordings[name]
    swapped = replace(with_(record, **{channel: record.u}), u=record.y[channel])
    fault = inspect(rig, [swapped]).fault
    assert fault is not None
    assert fault.what == f"u and {channel} have changed places"
    assert (fault.where, fault.mend.split(" in the")[0]) == (rig.only("amplifier").name, f"Swap u and {channel}")
    assert inspect(rig, [record]).fault is None
