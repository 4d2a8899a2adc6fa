"""Faults of wiring, sensors and sampling: found where they are, and never where physics is missing."""

from dataclasses import replace

import machine_cases as cases
import machines
import numpy as np
import pandas as pd
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.diagnose import Record, diagnose, diagnose_records
from dtbacklash.diagnose.faults import repeats, samples
from dtbacklash.diagnose.faults.inspect import inspect
from dtbacklash.diagnose.faults.wiring import wiring
from dtbacklash.diagnose.sayings import limits_said
from dtbacklash.diagnose.settings import settings
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.recording import Recording

from .conftest import STEP_S, recorded
from .test_repeats import held


def record_of(case: cases.Case) -> tuple[Rig, Record]:
    u, channels = case.frame["u"].to_numpy(), {n: case.frame[n].to_numpy() for n in case.frame if n in case.rig.sensors}
    train = np.arange(len(u)) < 0.7 * len(u)
    return case.rig, Record(STEP_S, u, channels, train, ~train)


def with_(record: Record, **channels: np.ndarray) -> Record:
    return replace(record, y={**record.y, **channels})


def failed(found) -> list[str]:
    return [c.check for c in found.checks if not c.passed]


@pytest.fixture(scope="module")
def clean(rig):
    return recorded(rig)


@pytest.fixture(scope="module")
def machine_recordings():
    return {case.name: record_of(case) for case in cases.all_cases()}


def test_a_clean_recording_passes_every_row(rig, clean):
    found = inspect(rig, [clean])
    assert found.fault is None
    assert not found.notes
    assert not failed(found)
    assert {"polarity of q3", "polarity of theta_m", "q3 is not clipped"} <= {c.check for c in found.checks}
    assert found.records[0] is clean


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
    assert row["statistic"] > settings().reversal_share
    assert {c.name for c in found.shown.curves} == {"theta_m", "q3"}


def test_two_channels_swapped_in_a_loop_end_in_a_verdict(machine_recordings):
    rig, record = machine_recordings["stage, PID"]
    found = diagnose_records(rig, [with_(record, x1=record.y["x2"], x2=record.y["x1"])])
    assert (found.verdict, found.findings) == ("unexplained", ())
    assert found.fault == "x1 and x2 have changed places"


def test_a_dead_sensor_is_left_out_and_said(rig, clean):
    noise = 1e-3 * np.random.default_rng(7).standard_normal(clean.samples)
    found = diagnose_records(rig, [with_(clean, q3=noise)])
    assert found.verdict == "consistent"
    assert found.fit.channels == ("theta_m",)
    assert found.summary.startswith("q3 shows nothing but noise")
    assert "q3 shows more than noise" in [c.check for c in found.checks if not c.passed]


def test_nothing_but_dead_sensors_is_a_fault(rig, clean):
    noise = np.random.default_rng(8).standard_normal((2, clean.samples))
    found = inspect(rig, [with_(clean, theta_m=noise[0], q3=1e-3 * noise[1])])
    assert found.fault is not None
    assert found.fault.what == "theta_m and q3 show nothing but noise"


def test_a_current_that_follows_a_white_command_is_alive():
    random = np.random.default_rng(9)
    u = random.standard_normal(8000)
    i = u / 2.0 + 0.05 * random.standard_normal(8000)
    assert samples.noise_alone(i, {"u": u}) < settings().dead_noise_share
    assert samples.noise_alone(i, {"u": random.standard_normal(8000)}) > settings().dead_noise_share


@pytest.mark.parametrize(("channel", "size"), [("q3", 2e-3), ("theta_m", 20.0)])
def test_spikes_are_bridged_and_not_judged(rig, clean, channel, size):
    values, at = clean.y[channel].copy(), [1500, 7000, 10100]
    values[at] += size * np.array([1.0, -0.5, 2.0])
    found = inspect(rig, [with_(clean, **{channel: values})])
    assert failed(found) == [f"{channel} is free of spikes"]
    assert f"{channel} has 3 spikes (the first 1.5 s after" in found.notes[0]
    (mended,) = found.records
    assert not (mended.train | mended.held)[at].any()
    assert (mended.train | mended.held).sum() >= clean.samples - 12
    assert np.abs(mended.y[channel] - clean.y[channel]).max() < 0.01 * size


def test_one_spike_changes_no_verdict(rig, clean):
    values = clean.y["theta_m"].copy()
    values[7000] += 30.0
    found = diagnose_records(rig, [with_(clean, theta_m=values)])
    assert found.verdict == "consistent"
    assert any("1 spike" in note for note in found.notes)


def test_what_happens_often_or_stays_is_no_spike():
    t = STEP_S * np.arange(8000)
    u = np.sin(3.0 * t)
    assert not samples.spikes(np.sign(np.sin(40.0 * t)), u).any()
    assert not samples.spikes(np.round(200 * np.sin(3.0 * t)), u).any()
    assert not samples.spikes(np.where(np.arange(8000) % 40 == 0, 1.0, 0.0), u).any()


def test_a_current_after_a_jump_of_the_command_is_no_spike():
    u = np.where(np.arange(8000) < 4000, 1.0, -1.0)
    i = 1e-3 * np.random.default_rng(2).standard_normal(8000)
    i[[0, 4000]] += [1.0, -2.0]
    assert not samples.spikes(i, u).any()
    assert samples.spikes(i, np.ones(8000))[4000]


def clip(values: np.ndarray, share: float) -> np.ndarray:
    limit = share * np.abs(values).max()
    return np.clip(values, -limit, limit)


def test_a_clipped_sensor_is_masked_where_it_is_clipped(rig, clean):
    values = clip(clean.y["q3"], 0.7)
    (mended,) = (found := inspect(rig, [with_(clean, q3=values)])).records
    assert failed(found) == ["q3 is not clipped"]
    assert found.fault is None
    assert not (mended.train | mended.held)[values != clean.y["q3"]].any()
    assert diagnose_records(rig, [with_(clean, q3=values)]).verdict == "consistent"


def test_a_clipped_angle_that_drives_the_structure_is_a_fault(rig, clean):
    found = diagnose_records(rig, [with_(clean, theta_m=clip(clean.y["theta_m"], 0.6))])
    assert (found.verdict, found.findings) == ("unexplained", ())
    assert found.fault.startswith("theta_m is clipped in")


def test_a_clipped_position_that_pulls_a_stage_ends_in_a_verdict(machine_recordings):
    rig, record = machine_recordings["stage, PID"]
    found = diagnose_records(rig, [with_(record, x1=clip(record.y["x1"], 0.5))])
    assert (found.verdict, found.findings) == ("unexplained", ())
    assert found.fault.startswith("x1 is clipped in")


def test_a_simulation_that_was_pulled_towards_a_bridge_is_judged_when_it_has_forgotten_it(machine_recordings):
    rig, record = machine_recordings["stage, free, plain"]
    values = clip(record.y["x1"], 0.9)
    found = inspect(rig, [with_(record, x1=values)])
    assert failed(found) == ["x1 is not clipped"]
    assert found.fault is None
    last = np.flatnonzero(values != record.y["x1"])[-1]
    used = found.records[0].train | found.records[0].held
    assert not used[last : last + 990].any()
    assert used[last + 1100 :].all()


def test_one_slow_entry_at_the_limit_is_clipped_too():
    t = STEP_S * np.arange(8000)
    drifting = np.sin(0.7 * t) + 0.02 * np.sin(30.0 * t)
    assert samples.at_limits(np.minimum(drifting, 0.9)).mean() > 0.1
    assert not samples.at_limits(np.where(t < 3.0, drifting, drifting[2999])).any()


def test_a_gap_is_bridged_with_the_slopes_beside_it():
    t = STEP_S * np.arange(1000)
    y = np.sin(6.0 * t)
    missing = np.abs(y) > 0.9
    error = np.abs(samples.bridged(np.where(missing, np.nan, y), missing) - y)
    assert error[: np.flatnonzero(~missing)[-1]].max() < 0.02


def thinned(record: Record, by: int) -> Record:
    y = {n: v[::by].copy() for n, v in record.y.items()}
    return Record(by * record.sample_time_s, record.u[::by].copy(), y, record.train[::by], record.held[::by])


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
    assert "`force` of ground friction at mass 1 stands at the end of its range" in said
    assert "`m1` and `k` stand at the limit" in said
    assert limits_said([], []) == ""


@pytest.mark.parametrize("count", [1, 6, 30])
def test_spikes_of_a_signal_that_moves_are_found_however_many(count):
    """A spike shifts its neighbours' medians by a step of the motion, and many pass for what is usual."""
    t, rng = 1e-3 * np.arange(8000), np.random.default_rng(1)
    moving = np.sin(9.0 * t) + 0.4 * np.sin(31.0 * t) + 3e-4 * rng.standard_normal(8000)
    at = rng.choice(np.arange(100, 7900, 20), count, replace=False)
    spiked = moving.copy()
    spiked[at] += 0.5 * rng.choice([-1.0, 1.0], count)
    u = np.sin(9.0 * t)
    assert not samples.spikes(moving, u).any()
    assert np.array_equal(np.flatnonzero(samples.spikes(spiked, u)), np.sort(at))


def test_an_angle_that_begins_anew_at_each_turn_is_straightened():
    t = 1e-3 * np.arange(8000)
    angle = 9.0 * np.sin(1.1 * t) + 1e-4 * np.random.default_rng(1).standard_normal(8000)
    within = np.angle(np.exp(1j * angle))
    straight, count = samples.unwrapped(within)
    assert count == np.sum(np.abs(np.diff(within)) > 3.0) > 4
    assert np.allclose(straight, angle, atol=1e-9)
    assert samples.unwrapped(angle)[1] == 0


def test_steps_of_any_size_are_no_turns():
    coarse = np.random.default_rng(1).uniform(-8.0, 8.0, 500)
    same, count = samples.unwrapped(coarse)
    assert count == 0
    assert same is coarse


@pytest.mark.parametrize("every", [3, 10])
def test_a_sensor_that_is_read_seldom_is_compared_where_it_was_read(machine_recordings, every):
    rig, record = machine_recordings["stage, PID"]
    seen = held(record.y["x1"], every, first=2)
    found = inspect(rig, [with_(record, x1=seen)])
    assert failed(found) == ["x1 is read at every sample"]
    (note,) = found.notes
    assert note.startswith("x1 repeats its readings")
    (mended,) = found.records
    compared = np.flatnonzero(mended.train | mended.held)
    np.testing.assert_array_equal(mended.y["x1"][compared], seen[compared])
    assert set((compared - 2) % every) == {0}
    # between its readings it moves on as the machine does
    away = np.abs(mended.y["x1"] - record.y["x1"])[every:-every]
    assert away.max() < 0.2 * np.abs(seen - record.y["x1"])[every:-every].max()


def test_a_sensor_that_is_read_seldom_is_no_delay(rig, clean):
    """Held for ten samples it is five late on average; without a look at its readings a delay was named."""
    found = diagnose_records(rig, [with_(clean, q3=held(clean.y["q3"], 10))])
    assert (found.verdict, found.findings) == ("consistent", ())
    assert any(note.startswith("q3 repeats its readings") for note in found.notes)


def test_a_sensor_of_few_readings_is_left_out(machine_recordings):
    rig, record = machine_recordings["stage, PID"]
    found = inspect(rig, [with_(record, x2=held(record.y["x2"], 100))])
    assert found.left_out == ["x2"]
    assert "x2 is read 1" in found.notes[0]
    assert "x2" not in found.records[0].y
    assert found.records[0].train.sum() == record.train.sum()


def test_a_sensor_that_hangs_is_left_out_where_it_does(machine_recordings):
    rig, record = machine_recordings["stage, PID"]
    seen = record.y["x1"].copy()
    jumps = np.abs(seen[100:] - seen[:-100])
    places = [(a + 1, a + 100) for a in (2000 + int(jumps[2000:5000].argmax()), 6000 + int(jumps[6000:9000].argmax()))]
    for a, b in places:
        seen[a:b] = seen[a - 1]
    mask = repeats.hung(seen)
    assert all(mask[a:b].all() for a, b in places)
    assert mask.sum() == sum(b - a for a, b in places)
    found = inspect(rig, [with_(record, x1=seen)])
    assert failed(found) == ["x1 does not hang"]
    assert not any((found.records[0].train | found.records[0].held)[a:b].any() for a, b in places)
