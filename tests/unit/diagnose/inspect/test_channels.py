"""Faults of sensors: dead, spiked, clipped, hung, seldom read; mended where they can be, and said."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnose import Record, diagnose_records
from dtbacklash.diagnose.inspect import samples
from dtbacklash.diagnose.inspect.inspection import inspect
from dtbacklash.diagnose.settings import SETTINGS

from ..conftest import STEP_S, failed, with_
from .test_repeats import held


@pytest.mark.check
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
    assert samples.noise_alone(i, {"u": u}) < SETTINGS.dead_noise_share
    assert samples.noise_alone(i, {"u": random.standard_normal(8000)}) > SETTINGS.dead_noise_share


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


@pytest.mark.nightly
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


@pytest.mark.check
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


@pytest.mark.nightly
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


@pytest.mark.nightly
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
    mask = samples.hung(seen)
    assert all(mask[a:b].all() for a, b in places)
    assert mask.sum() == sum(b - a for a, b in places)
    found = inspect(rig, [with_(record, x1=seen)])
    assert failed(found) == ["x1 does not hang"]
    assert not any((found.records[0].train | found.records[0].held)[a:b].any() for a, b in places)


def resting(record: Record, samples_: int = 1500) -> Record:
    """A stretch in which nothing moves: each sensor shows its noise."""
    rng, mask = np.random.default_rng(11), np.ones(samples_, dtype=bool)
    y = {name: values[0] + 1e-3 * np.std(values) * rng.standard_normal(samples_) for name, values in record.y.items()}
    return Record(record.sample_time_s, np.zeros(samples_), y, mask, ~mask, from_s=100.0)


def test_a_machine_that_rests_through_a_stretch_has_no_dead_sensors(rig, clean):
    found = inspect(rig, [clean, resting(clean)])
    assert (found.fault, found.left_out, failed(found)) == (None, [], [])
    rubbish = resting(clean, clean.samples).y["q3"]
    dead = inspect(rig, [with_(clean, q3=rubbish), resting(clean)])
    assert dead.left_out == ["q3"]


def test_what_is_clipped_counts_by_the_whole_recording(rig, clean):
    """A short stretch at the limit, beside a long one that is not, is bridged; it forbids nothing."""
    y = {"theta_m": clean.y["theta_m"][:2000], "q3": clip(clean.y["q3"][:2000], 0.3)}
    part = Record(STEP_S, clean.u[:2000], y, clean.train[:2000], clean.held[:2000], from_s=100.0)
    assert inspect(rig, [part]).fault is not None
    found = inspect(rig, [clean, part])
    assert found.fault is None
    assert any(note.startswith("q3 is clipped in") for note in found.notes)


def test_a_few_repeated_samples_of_what_drives_the_structure_forbid_nothing(rig, clean):
    """What the row of checks passes is bridged."""
    values = clean.y["theta_m"].copy()
    at = 3000 + int(np.abs(np.diff(values[3000:5000])).argmax())
    values[at : at + 12] = values[at]
    assert samples.hung(values)[at + 1 : at + 12].all()
    found = inspect(rig, [with_(clean, theta_m=values)])
    assert (found.fault, failed(found)) == (None, [])
    assert not (found.records[0].train | found.records[0].held)[at + 1 : at + 12].any()


def test_the_first_spike_is_told_from_the_beginning_of_the_recording(rig, clean):
    values = clean.y["q3"].copy()
    values[1500] += 2e-3
    found = inspect(rig, [clean, replace(with_(clean, q3=values), from_s=20.0)])
    assert "(the first 21.5 s after" in found.notes[0]
