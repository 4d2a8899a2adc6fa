"""Each defect of a recording: found, said in one sentence, and handled or refused."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dtbacklash.errors import UserError
from dtbacklash.recording import Recording, read_pair, read_recording, split
from dtbacklash.recording.channels import clipping, hanging
from dtbacklash.recording.model import refined
from dtbacklash.recording.refusal import Refused


def note(recording: Recording, words: str) -> str:
    """The one note of a recording beside that about its units, which must hold ``words``."""
    notes = [text for text in recording.notes if not text.startswith("Units: ")]
    assert len(notes) == 1, notes
    assert words in notes[0]
    assert notes[0].endswith(".")
    return notes[0]


def hanging_from(f, name, first, last):
    return f.assign(**{name: f[name].where((f.index < first) | (f.index > last), f[name][first])})


#: how a recording is spoilt, and what is said of it
REFUSED = {
    "too little between gaps": (lambda f: f[(f.index // 90) % 2 == 0],
                                "stretches of at least 100 samples between them hold 0 % of it"),
    "many double stamps": (lambda f: f.assign(t=1e-3 * (f.index - (f.index % 20 == 7))),
                           "repeat the time of the row before"),
    "time stands still": (lambda f: f.assign(t=3.0), "time stands still"),
    "time runs backwards": (lambda f: f.assign(t=f.t - 0.2 * (f.index >= 700)),
                            "time runs backwards once, first in row 701 (from 0.699 s to 0.5 s)"),
    "from the end to the beginning": (lambda f: f[::-1], "time runs backwards 3999 times"),
    "time in ms": (lambda f: f.assign(t=f.t * 1e3), "is it in ms, or a row number?"),
    "time in us": (lambda f: f.assign(t=f.t * 1e6), "is it in ms, or a row number?"),
    "too short": (lambda f: f[:99], "is too short: 99 samples, at least 100"),
    "no command": (lambda f: f.drop(columns="u"), "lacks the column u (the command); the file has t, r, theta_m, q3"),
    "no sensor": (lambda f: f[["t", "r", "u"]], "lacks a measured channel"),
    "dropouts": (lambda f: f.assign(q3=f.q3.mask((f.index // 200) % 5 > 2)),
                 "the channels have values at the same time, in stretches without holes, in 60 % of the rows only"),
    "many NaN": (lambda f: f.assign(q3=f.q3.mask(f.index % 10 == 1)), "channel q3 has no value in 400 of 4000 rows"),
    "a constant": (lambda f: f.assign(q3=2e-4), "channel q3 never changes"),
    "too small to be squared": (lambda f: f.assign(q3=1e-200 * f.q3), "channel q3 never changes"),
    "hangs and jumps": (lambda f: hanging_from(f, "q3", 1000, 1900), "channel q3 hangs from 1 to 1.9 s"),
    "hangs to the end": (lambda f: hanging_from(f, "theta_m", 3000, 4000), "channel theta_m hangs from 3 to 3.999 s"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_mended_is_refused(case, frame, save, refusal):
    spoil, said = REFUSED[case]
    assert said in refusal(save(spoil(frame)))


# --- time


def test_jitter_is_resampled(frame, save):
    rng = np.random.default_rng(1)
    t = frame.t + 1e-4 * rng.uniform(-1, 1, len(frame))
    jittered = frame.assign(t=t, q3=np.interp(t, frame.t, frame.q3))
    recording = read_recording(save(jittered))
    assert "resampled linearly" in note(recording, "uneven by up to")
    truth = np.interp(recording.t_s, frame.t, frame.q3)
    assert np.abs(recording.channels["q3"] - truth)[1:-1].max() < 1e-4 * np.ptp(truth)
    assert np.ptp(np.diff(recording.t_s)) < 1e-12


@pytest.mark.parametrize("kind", ["large jitter", "two sample rates"])
def test_uneven_times_are_resampled(kind, frame, save):
    rng = np.random.default_rng(1)
    t = frame.t + 4.5e-4 * rng.uniform(-1, 1, len(frame)) * (kind == "large jitter")
    logged = pd.DataFrame({"t": t, "u": frame.u, **{n: np.interp(t, frame.t, frame[n]) for n in ("theta_m", "q3")}})
    rows = slice(None) if kind == "large jitter" else (frame.index < 2000) | (frame.index % 2 == 0)
    recording = read_recording(save(logged[rows]))
    note(recording, "Sampling is uneven, with steps from")
    for name in ("theta_m", "q3"):
        off = recording.channels[name] - np.interp(recording.t_s, frame.t, frame[name])
        assert np.abs(off)[2:-2].max() < 1e-3 * np.ptp(frame[name])


def test_samples_that_come_late_now_and_then_are_resampled_and_none_is_missing(frame, save):
    """A computer that is busy for some samples and then catches up: one long step, then short ones."""
    t = frame.t.to_numpy().copy()
    for row in range(100, len(t) - 10, 97):
        t[row : row + 3] += (2.3e-3, 1.6e-3, 0.8e-3)
    recording = read_recording(save(frame.assign(t=t, q3=np.interp(t, frame.t, frame.q3))))
    assert "resampled linearly" in note(recording, "uneven by up to 80 % of a step")
    assert not any("missing" in text for text in recording.notes)
    assert recording.samples == len(frame)
    assert np.abs(recording.channels["q3"] - frame.q3).max() < 1e-3 * np.ptp(frame.q3)


def test_rounded_stamps_are_not_jitter(frame, save):
    t = np.arange(len(frame)) * 0.0016384041943147375
    recording = read_recording(save(frame.assign(t=np.round(t, 4))))
    note(recording, "times are rounded to 0.0001 s")
    assert recording.sample_time_s == pytest.approx(t[1], rel=1e-5)
    assert np.allclose(recording.channels["q3"], frame.q3)


def test_a_gap_makes_two_stretches(frame, save):
    recording = read_recording(save(frame.drop(index=range(1000, 1300))))
    said = [n for n in recording.notes if not n.startswith("Units: ")]
    assert said == [
        "There is 1 gap, the widest 0.301 s at t = 0.999 s.",
        "2 stretches are used: 0 to 0.999 s, 1.3 to 3.999 s; together 3700 samples.",
    ]
    assert recording.stretches == ((0, 1000), (1000, 3700))
    assert recording.t_s[1000] - recording.t_s[999] == pytest.approx(0.301)
    assert recording.duration_s == pytest.approx(3.698)
    later = recording.section(900, 1200)
    assert (later.stretches, later.samples) == (((0, 100), (100, 300)), 300)
    with pytest.raises(UserError, match="has 2 stretches"):
        refined(recording)


def test_a_gap_in_a_clock_that_jitters(frame, save):
    t = frame.t + 1e-4 * np.random.default_rng(1).uniform(-1, 1, len(frame))
    jittered = frame.assign(t=t, q3=np.interp(t, frame.t, frame.q3)).drop(index=range(1000, 1300))
    recording = read_recording(save(jittered))
    assert [b - a for a, b in recording.stretches] == pytest.approx([1000, 2700], abs=1)
    truth = np.interp(recording.t_s, frame.t, frame.q3)
    assert np.abs(recording.channels["q3"] - truth)[1:-1].max() < 1e-3 * np.ptp(truth)
    for a, b in recording.stretches:
        assert np.allclose(np.diff(recording.t_s[a:b]), recording.sample_time_s, rtol=1e-9)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    losses=st.lists(st.tuples(st.integers(0, 3900), st.integers(1, 150)), min_size=1, max_size=6),
    channel=st.sampled_from(["u", "theta_m", "q3", "t"]),
)
def test_whatever_is_lost_what_remains_is_the_recording(frame, losses, channel):
    """Rows or values that are missing cut a recording or are interpolated; all else is what was recorded."""
    lost = np.zeros(len(frame), dtype=bool)
    for start, count in losses:
        lost[start : start + count] = True
    spoilt = frame[~lost] if channel == "t" else frame.assign(**{channel: frame[channel].mask(lost)})
    recording = Recording.from_frame(spoilt)
    ends = [0, *(b for _, b in recording.stretches)]
    assert [a for a, _ in recording.stretches] == ends[:-1]
    assert ends[-1] == recording.samples
    for a, b in recording.stretches:
        assert b - a >= 100
        assert np.allclose(np.diff(recording.t_s[a:b]), recording.sample_time_s, rtol=1e-6)
    rows = np.round(recording.t_s / 1e-3).astype(int)
    assert np.allclose(recording.t_s, frame.t.to_numpy()[rows], atol=1e-6)
    kept = ~lost[rows]
    for name, values in recording.channels.items():
        assert np.allclose(values[kept], frame[name].to_numpy()[rows][kept], atol=1e-6 * np.ptp(frame[name]))
    again = Recording.from_frame(recording.to_frame())
    assert again.stretches == recording.stretches
    assert np.allclose(again.channels["q3"], recording.channels["q3"])


def test_a_few_double_stamps_are_dropped(frame, save):
    recording = read_recording(save(pd.concat([frame[:900], frame[899:]])))
    note(recording, "Of 1 pair of rows at one time the later one counts.")
    assert recording.samples == len(frame)


def test_rows_without_a_time(frame, save, refusal):
    frame.loc[[7, 8], "t"] = np.nan
    recording = read_recording(save(frame))
    assert recording.notes[0] == "2 rows without a time were dropped."
    frame.loc[::3, "t"] = np.nan
    assert "rows have no time" in refusal(save(frame))


def test_a_slow_machine_is_recorded_as_slowly_as_its_header_says(frame, save):
    slow = frame.assign(t=frame.t * 1e3).rename(columns={"t": "t_s"})
    fast = read_recording(save(frame))
    assert read_recording(save(slow)).sample_time_s == pytest.approx(1e3 * fast.sample_time_s)


def test_without_a_time_column_the_step_must_be_given(frame, save, refusal):
    file = save(frame.drop(columns="t"))
    assert "has no time column" in refusal(file)
    assert read_recording(file, sample_time_s=0.002).duration_s == pytest.approx(7.998)


# --- channels


def test_a_dropout_makes_two_stretches(frame, save):
    frame.loc[2000:2060, "q3"] = np.nan
    recording = read_recording(save(frame))
    assert "Channel q3 drops out once, for 61 samples in a row at t = 2 s." in recording.notes
    assert recording.stretches == ((0, 2000), (2000, 3939))
    assert np.array_equal(recording.channels["u"], frame.u.drop(index=range(2000, 2061)))
    train, held_out = split(recording)
    assert (train.stretches, held_out.stretches) == (((0, 2000), (2000, 2757)), ((0, 1182),))


def test_a_channel_without_values(frame, save, refusal):
    recording = read_recording(save(frame.assign(q2=np.nan)))
    note(recording, "Channel q2 has hardly any values and is not used")
    assert "channel u has no value in 100 % of the rows" in refusal(save(frame.assign(u=np.nan)))


def test_a_clipped_channel_is_noted(frame, save):
    recording = read_recording(save(frame.assign(q3=frame.q3.clip(upper=5e-4))))
    note(recording, "Channel q3 is clipped at its top (0.0005)")


def test_a_peak_of_an_encoder_and_a_rest_are_not_clipped():
    t = np.arange(5000) * 1e-3
    count = 1e-4
    assert clipping("q3", count * np.round(np.sin(6 * t) / count)) is None
    assert clipping("q3", count * np.round((1 - np.exp(-2 * t)) / count)) is None
    assert clipping("u", np.sign(np.sin(6 * t))) is None
    assert clipping("q3", np.clip(count * np.round(np.sin(6 * t) / count), -0.8, 1)) is not None


@pytest.mark.parametrize("counts", [pytest.param(1, id="coarse"), pytest.param(20, id="fine")])
@pytest.mark.parametrize("way", [pytest.param(1, id="top"), pytest.param(-1, id="bottom")])
@pytest.mark.parametrize(
    ("slowest", "rest", "leaves", "is_clipped"),
    [
        pytest.param(3, 5, 3, True, id="cut-off"),
        pytest.param(3, 20, 3, True, id="cut-off-for-longer"),
        pytest.param(3, 150, 3, False, id="slowed-down-and-stayed"),
        pytest.param(3, 20, 0, False, id="set-off-from-rest"),
        pytest.param(9, 150, 9, True, id="cut-off-at-full-speed"),
        pytest.param(9, 150, 0, False, id="stopped-at-once"),
        pytest.param(9, 150, None, True, id="never-back"),
    ],
)
def test_a_clipped_sensor_is_told_from_a_motor_that_friction_stops(slowest, rest, leaves, is_clipped, way, counts):
    # speeds in coarse counts a sample: cut off by a sensor, it would soon be back, and as fast as it went
    back = [] if leaves is None else [np.linspace(-leaves, -9, 300)]
    stops = [np.linspace(0, 9, 600), np.linspace(9, slowest, 14), [1.0], np.zeros(rest)]
    lower = [np.linspace(0, 8, 600), np.linspace(8, -9, 900)]
    angle = way * np.round(counts * np.cumsum(np.concatenate(lower + stops + back)))
    assert (clipping("theta_m", angle) is not None) == is_clipped


def test_a_rest_is_noted_not_refused():
    t = np.arange(4000) * 1e-3
    u = np.sin(8 * t)
    play = np.where(t < 1.0, 0.0, np.where(t < 2.0, 1 - np.cos(3 * (t - 1)), 1 - np.cos(3) + np.sin(3 * (t - 2))))
    assert "stands still from 0 to" in str(hanging("q3", play, u, t))
    with pytest.raises(Refused, match="hangs"):
        hanging("q3", np.where(t < 1.0, 0.0, 5 + t), u, t)
    # while the input rests as well, nothing is amiss
    assert hanging("q3", play, np.where(t < 1.0, 0.0, u), t) is None


@pytest.mark.parametrize("input_v", [0.0, 3.0])
def test_what_rests_while_the_input_does_does_not_hang(input_v):
    t = 1e-3 * np.arange(4000)
    rests = np.where(t < 2.0, np.cos(5.0 * t) * (2.0 - t), 0.0)
    assert hanging("theta", rests, np.full(4000, input_v), t) is None
    with pytest.raises(Refused, match="never moves again"):
        hanging("theta", rests, np.sin(t), t)


# --- what to judge on


def test_the_last_share_is_held_out(frame, save):
    train, held_out = read_pair(save(frame))
    assert (train.samples, held_out.samples) == (2800, 1200)
    assert held_out.t_s[0] == pytest.approx(2.8)
    assert np.array_equal(np.concatenate([train.channels["u"], held_out.channels["u"]]), frame.u)
    with pytest.raises(UserError, match="held_out"):
        split(train, 0.01)
    with pytest.raises(UserError, match="above 0"):
        split(train, 1.0)


def test_another_recording_to_judge_on(frame, save):
    train, held_out = read_pair(save(frame), save(frame[:1000], "other.csv"))
    assert (train.samples, held_out.samples) == (4000, 1000)
    for spoilt, word in ((frame.drop(columns="q3"), "lacks the recording's channel q3"),
                         (frame.assign(t=2 * frame.t), "sample time 0.001 s"), (frame[:5], "too short")):  # fmt: skip
        with pytest.raises(UserError) as caught:
            read_pair(save(frame), save(spoilt, "other.csv"))
        assert caught.value.key == "validation"
        assert word in str(caught.value)
