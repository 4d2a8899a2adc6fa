"""What is done to a recording before it is compared: cut, detrended, resampled, in Python and by a mapping."""

import numpy as np
import pandas as pd
import pytest
from told import refusal, refused

from dtbacklash import cli
from dtbacklash.recording import Recording, read_recording
from dtbacklash.recording.prepare import Preparation

T = 1e-3 * np.arange(4000)
SLOW, FAST = np.sin(9.0 * T), np.sin(2.0 * np.pi * 330.0 * T)


@pytest.fixture
def recording():
    return Recording.from_frame(pd.DataFrame({"t": T, "u": SLOW, "x [m]": 3.0 + 0.5 * T + SLOW + FAST}))


def test_it_is_cut_by_its_clock(recording):
    part = recording.cut(0.5, 2.5)
    assert (part.t_s[0], part.t_s[-1], part.samples) == pytest.approx((0.5, 2.5, 2001))
    assert np.array_equal(part.channels["x"], recording.channels["x"][500:2501])
    assert recording.cut().samples == recording.samples
    assert part.notes[-1] == "Cut to 0.5 to 2.5 s."


@pytest.mark.parametrize("trend", ["constant", "linear"])
def test_a_mean_or_a_line_is_taken_off(recording, trend):
    before, after = recording.channels, recording.detrend("x", trend=trend).channels
    off = before["x"] - after["x"]
    assert abs(after["x"].mean()) < 1e-12
    assert np.allclose(np.diff(off, 2), 0.0)
    assert (np.ptp(off) < 1e-12, abs(np.polyfit(T, after["x"], 1)[0]) < 1e-9) == (
        trend == "constant",
        trend == "linear",
    )
    assert np.array_equal(after["u"], before["u"])  # what was commanded stays


def test_a_slower_rate_keeps_what_is_slow_and_no_alias_of_what_is_fast(recording):
    slower = recording.detrend("x", trend="linear").resample(0.005)
    assert (slower.samples, slower.sample_time_s) == (800, pytest.approx(0.005))
    assert np.allclose(np.diff(slower.t_s), 0.005)
    inside = slice(40, -40)
    reference = recording.detrend("x", trend="linear").channels["x"] - FAST
    assert np.abs(slower.channels["x"] - reference[::5])[inside].max() < 0.02  # 330 Hz would be 1, at 70 Hz
    assert np.abs(slower.channels["u"] - SLOW[::5])[inside].max() < 0.02


def test_each_stretch_is_resampled_alone():
    t = np.concatenate([T, T + 10.0])
    gapped = Recording.from_frame(pd.DataFrame({"t": t, "u": np.tile(SLOW, 2), "x [m]": np.tile(SLOW, 2)}))
    slower = gapped.resample(0.004)
    assert slower.stretches == ((0, 1000), (1000, 2000))
    assert slower.t_s[1000] == pytest.approx(10.0)


@pytest.mark.parametrize(("change", "said"), [
    (lambda r: r.cut(1.0, 1.05), "cut=1 to 1.05 s: fewer than 100 samples lie there; it goes from 0 to 3.999 s"),
    (lambda r: r.detrend("y"), "detrend.y=constant: no such channel; it has u, x"),
    (lambda r: r.detrend("x", trend="cubic"), "detrend.x=cubic: choose one of constant, linear"),
    (lambda r: r.resample(0.0015), "sample_time_s=0.0015: must be a whole multiple of the recording's own, 0.001 s"),
    (lambda r: r.resample(0.0), "sample_time_s=0.0: must be a whole multiple"),
    (lambda r: r.resample(0.05), "sample_time_s=0.05: leaves fewer than 100 samples"),
])  # fmt: skip
def test_what_leaves_nothing_is_refused(recording, change, said):
    with refused(start=said):
        change(recording)


MAPPING = """files: [bench.csv]
time: t
channels: {u: u, theta: {column: x, unit: mrad}}
rig: pendulum
prepare: {from_s: 0.5, to_s: 3.5, detrend: {theta: linear}, sample_time_s: 0.002}
"""


@pytest.fixture
def lab(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pd.DataFrame({"t": T, "u": SLOW, "x": 3.0 + 0.5 * T + SLOW}).to_csv("bench.csv", index=False)
    (tmp_path / "lab.yaml").write_text(MAPPING)
    return tmp_path


def test_a_mapping_says_the_same(lab):
    plain = MAPPING.replace("prepare:", "notes: [] #")
    (lab / "plain.yaml").write_text(plain)
    prepared, raw = read_recording("lab.yaml"), read_recording("plain.yaml")
    same = Preparation(0.5, 3.5, {"theta": "linear"}, 0.002).of(raw)
    assert prepared.samples == 1501
    assert np.array_equal(prepared.channels["theta"], same.channels["theta"])
    (lab / "lab.yaml").write_text(f"{plain}prepare: {{cut: 3}}\n")
    with refused("must be a mapping with some of from_s, to_s, detrend, sample_time_s"):
        read_recording("lab.yaml")


@pytest.mark.parametrize(("wrong", "said"), [
    ("detrend: {theta: cubic}", "choose one of constant, linear"), ("sample_time_s: -1", "must be positive s"),
    ("from_s: soon", "must be a number"),
])  # fmt: skip
def test_a_mistake_in_a_mapping_is_one_line(lab, wrong, said):
    (lab / "lab.yaml").write_text(f"{MAPPING.partition('prepare')[0]}prepare: {{{wrong}}}\n")
    with refused("recording.prepare.", said):
        read_recording("lab.yaml")


def test_it_is_looked_at_before_it_is_diagnosed(lab, capsys):
    assert cli.main(["recordings", "check", "lab.yaml", "out=seen"]) == 0
    told = capsys.readouterr().out
    assert "bench.csv" in told or "lab" in told
    assert "theta  " in told
    assert "Resampled from 0.001 to 0.002 s" in told
    assert told.splitlines()[-1] == "drawn in seen/lab_recording.png"
    assert (lab / "seen" / "lab_recording.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(("words", "said"), [
    (["check"], "write dtb recordings check FILE"), (["check", "a", "b"], "write dtb recordings check FILE"),
    (["check", "lab.yaml", "rug=x"], "rug=x: no such setting"), (["look"], "fetch NAME, or check FILE"),
])  # fmt: skip
def test_a_mistake_of_the_command_line_is_one_line(lab, capsys, words, said):
    assert said in refusal(capsys, "recordings", *words)
