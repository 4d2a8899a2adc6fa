"""Faults of sensors: dead, spiked, clipped, hung, seldom read; mended where they can be, and said."""

from dataclasses import replace

import numpy as np
import pytest

from dtbacklash.diagnosis.inspect import samples
from dtbacklash.diagnosis.inspect.fault import faulty
from dtbacklash.diagnosis.inspect.inspection import Fault, inspect
from dtbacklash.diagnosis.records import Record

from ..conftest import STEP_S, failed, with_
from .test_repeats import held


def test_nothing_but_dead_sensors_is_a_fault(rig, clean):
    noise = np.random.default_rng(8).standard_normal((2, clean.samples))
    found = inspect(rig, [with_(clean, theta_m=noise[0], q3=1e-3 * noise[1])])
    assert found.fault is not None
    assert found.fault.what == "theta_m and q3 show nothing but noise"


def test_a_current_that_follows_a_white_command_is_alive():
    random = np.random.default_rng(9)
    u = random.standard_normal(8000)
    i = u / 2.0 + 0.05 * random.standard_normal(8000)
    assert samples.noise_alone(i, {"u": u}) < samples.DEAD_NOISE_SHARE
    assert samples.noise_alone(i, {"u": random.standard_normal(8000)}) > samples.DEAD_NOISE_SHARE


def only_missing(found, before: Record, **masks: np.ndarray) -> bool:
    """Whether of one record just these samples are missing, in their channels only, and all else is as it was."""
    (after,) = found.records
    as_marked = {n: np.where(masks[n], np.nan, v) if n in masks else v for n, v in before.y.items()}
    alike = all(np.array_equal(after.y[n], v, equal_nan=True) for n, v in as_marked.items())
    return alike and after.train is before.train and after.held is before.held


@pytest.mark.parametrize(("channel", "size"), [("q3", 2e-3), ("theta_m", 20.0)])
def test_spikes_are_left_out_of_their_channel(rig, clean, channel, size):
    values, at = clean.y[channel].copy(), [1500, 7000, 10100]
    values[at] += size * np.array([1.0, -0.5, 2.0])
    found = inspect(rig, [with_(clean, **{channel: values})])
    assert failed(found) == [f"{channel} is free of spikes"]
    assert f"{channel} has 3 spikes (the first 1.5 s after" in found.notes[0]
    assert only_missing(found, clean, **{channel: np.isin(np.arange(clean.samples), at)})


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


@pytest.mark.parametrize("channel", ["q3", "theta_m"])
def test_a_clipped_sensor_is_left_out_where_it_is_clipped(rig, clean, channel):
    values = clip(clean.y[channel], 0.7)
    seen = with_(clean, **{channel: values})
    found = inspect(rig, [seen])
    assert failed(found) == [f"{channel} is not clipped"]
    assert found.fault is None
    assert only_missing(found, seen, **{channel: np.abs(values) == np.abs(values).max()})


def test_an_angle_that_is_clipped_too_often_is_a_fault(rig, clean):
    found = inspect(rig, [with_(clean, theta_m=clip(clean.y["theta_m"], 0.2))])
    assert found.fault is not None
    assert found.fault.what.startswith("theta_m is clipped in")
    assert found.fault.why.endswith("too often to leave that out")


def test_what_is_clipped_just_where_it_judges_is_a_fault(rig, clean):
    """A sixth of all is missing, but most of what is held out."""
    everywhere = np.ones(clean.samples, dtype=bool)
    fitted = replace(clean, train=everywhere, held=~everywhere)
    y = {"theta_m": clean.y["theta_m"][:3000], "q3": clip(clean.y["q3"][:3000], 0.05)}
    held_out = Record(STEP_S, clean.u[:3000], y, ~everywhere[:3000], everywhere[:3000], recording=1)
    found = inspect(rig, [fitted, held_out])
    assert found.fault is not None
    assert found.fault.what.startswith("q3 is clipped in")


def test_one_slow_entry_at_the_limit_is_clipped_too():
    t = STEP_S * np.arange(8000)
    drifting = np.sin(0.7 * t) + 0.02 * np.sin(30.0 * t)
    assert samples.at_limits(np.minimum(drifting, 0.9)).mean() > 0.1
    assert not samples.at_limits(np.where(t < 3.0, drifting, drifting[2999])).any()


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
def test_of_a_sensor_that_is_read_seldom_its_readings_are_kept(machine_recordings, every):
    rig, record = machine_recordings["stage, PID"]
    seen = held(record.y["x1"], every, first=2)
    found = inspect(rig, [with_(record, x1=seen)])
    assert failed(found) == ["x1 is read at every sample"]
    (note,) = found.notes
    assert note.startswith("x1 repeats its readings")
    read = np.arange(record.samples) % every == 2
    read[0] = True
    assert only_missing(found, with_(record, x1=seen), x1=~read)


def test_a_sensor_of_few_readings_is_left_out(machine_recordings):
    rig, record = machine_recordings["stage, PID"]
    found = inspect(rig, [with_(record, x2=held(record.y["x2"], 200))])
    assert found.left_out == ["x2"]
    assert found.notes[0].startswith("x2 is read 60 times in all")
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
    assert only_missing(found, with_(record, x1=seen), x1=mask)


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
    """A short stretch at the limit, beside a long one that is not, is left out; it forbids nothing."""
    y = {"theta_m": clean.y["theta_m"][:2000], "q3": clip(clean.y["q3"][:2000], 0.3)}
    part = Record(STEP_S, clean.u[:2000], y, clean.train[:2000], clean.held[:2000], from_s=100.0)
    assert inspect(rig, [part]).fault is not None
    found = inspect(rig, [clean, part])
    assert found.fault is None
    assert any(note.startswith("q3 is clipped in") for note in found.notes)


def test_a_few_repeated_samples_of_what_drives_the_structure_forbid_nothing(rig, clean):
    """What the row of checks passes is left out."""
    values = clean.y["theta_m"].copy()
    at = 3000 + int(np.abs(np.diff(values[3000:5000])).argmax())
    values[at : at + 12] = values[at]
    assert samples.hung(values)[at + 1 : at + 12].all()
    found = inspect(rig, [with_(clean, theta_m=values)])
    assert (found.fault, failed(found)) == (None, [])
    assert np.isnan(found.records[0].y["theta_m"][at + 1 : at + 12]).all()


def test_the_first_spike_is_told_from_the_beginning_of_the_recording(rig, clean):
    values = clean.y["q3"].copy()
    values[1500] += 2e-3
    found = inspect(rig, [clean, replace(with_(clean, q3=values), from_s=20.0)])
    assert "(the first 21.5 s after" in found.notes[0]


def test_each_recording_may_have_channels_of_its_own(rig, clean):
    noise = 1e-3 * np.random.default_rng(7).standard_normal(clean.samples)
    angle, mass = ({n: clean.y[n]} for n in ("theta_m", "q3"))
    both = [replace(clean, y=angle), replace(clean, y=mass, recording=1)]
    assert (inspect(rig, both).fault, inspect(rig, both).left_out) == (None, [])
    dead = inspect(rig, [clean, replace(both[0], y={**angle, "q3": noise}, recording=1)])
    assert dead.left_out == []
    alone = inspect(rig, [both[0], replace(clean, y={"q3": noise}, recording=1)])
    assert alone.fault is not None
    assert alone.fault.what == "q3 shows nothing but noise"


@pytest.mark.filterwarnings("error")
def test_missing_readings_and_exact_rest_are_no_faults(rig, clean):
    """The last half rests and reads exactly 0; one reading in ten is missing."""
    half, gone = clean.samples // 2, np.arange(clean.samples) % 10 == 3
    moving = np.arange(clean.samples) < half
    fade = np.clip((half - np.arange(clean.samples)) / 500.0, 0.0, 1.0)
    y = {n: np.where(gone, np.nan, np.where(moving, fade * v, 0.0)) for n, v in clean.y.items()}
    found = inspect(rig, [replace(clean, u=fade * clean.u, y=y)])
    assert (found.fault, found.left_out, found.notes) == (None, [], [])
    with_fault = faulty(rig, found, Fault("sensor_q3", "Something", "it is made up", "Mend it."))
    assert 0.0 < with_fault.fit.noise_floor < 0.1
    assert all(np.isfinite(c.measured).all() for c in with_fault.shown.curves)


def test_a_dead_sensor_with_missing_readings_is_dead(rig, clean):
    rng = np.random.default_rng(7)
    noise = np.where(rng.random(clean.samples) < 0.7, np.nan, 1e-3 * rng.standard_normal(clean.samples))
    assert inspect(rig, [with_(clean, q3=noise)]).left_out == ["q3"]
    assert inspect(rig, [with_(clean, q3=np.full(clean.samples, np.nan))]).left_out == ["q3"]


@pytest.mark.filterwarnings("error")
def test_a_channel_that_is_constant_is_dead(rig, clean):
    found = inspect(rig, [with_(clean, q3=np.full(clean.samples, 0.1))])
    assert found.left_out == ["q3"]
    only = inspect(rig, [replace(clean, y={"q3": np.full(clean.samples, 0.1)})])
    assert only.fault is not None
    assert faulty(rig, only, only.fault).fit.held_out.nominal is None
