"""Recordings from DataFrames, and back."""

import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from dtbacklash.errors import UserError
from dtbacklash.recording import Recording, read_recording


def same(one: Recording, other: Recording) -> None:
    assert one.units == other.units
    assert one.sample_time_s == pytest.approx(other.sample_time_s, rel=1e-9)
    for name, values in one.channels.items():
        assert np.array_equal(values, other.channels[name]), name


def test_a_frame_is_read_by_the_rules_of_a_file(frame, save):
    recording = Recording.from_frame(frame, name="bench")
    same(recording, read_recording(save(frame)))
    assert (recording.name, recording.source) == ("bench", None)
    assert recording.assumed_units == {
        "t": "s (assumed)", "r": "m (assumed)", "u": "V (assumed)", "theta_m": "rad (assumed)", "q3": "m (assumed)",
    }  # fmt: skip


def test_units_come_from_the_argument_the_head_the_rig_in_this_order(frame, lead_screw):
    given = frame.rename(columns={"q3": "q3_um", "theta_m": "theta_m [deg]"})
    recording = Recording.from_frame(given, units={"q3": "m"}, rig=lead_screw, trust_units=True)
    assert recording.assumed_units["q3"] == "m (given)"
    assert recording.assumed_units["theta_m"] == "deg (header)"
    assert recording.assumed_units["r"] == "mm (declared by the rig)"  # that of the output's sensor
    assert np.array_equal(recording.channels["q3"], frame.q3)
    assert np.array_equal(recording.channels["theta_m"], frame.theta_m * (np.pi / 180))
    assert np.array_equal(recording.channels["r"], frame.r * 1e-3)
    overruled = "Channel q3 is read in m, as given, though the header says um."
    assert overruled in recording.notes
    agreeing = Recording.from_frame(given, units={"q3": "µm"}, rig=lead_screw, trust_units=True)
    assert not any("Channel q3" in note for note in agreeing.notes)


def test_without_a_rig_a_column_is_a_channel_by_its_unit():
    k = np.arange(500)
    table = pd.DataFrame(
        {"t": 1e-3 * k, "u": np.sin(k / 9), "x1_mm": np.cos(k / 9), "speed [m/s]": np.sin(k / 7), "n": k}
    )
    recording = Recording.from_frame(table)
    assert recording.units == {"u": "V", "x1": "m", "speed": "m/s"}
    assert np.allclose(recording.channels["x1"], 1e-3 * np.cos(k / 9))
    assert "not used: n." in recording.notes[0]
    plain = table.rename(columns={"x1_mm": "x1"})[["t", "u", "x1"]]
    assert Recording.from_frame(plain, units={"x1": "mm"}).assumed_units["x1"] == "mm (given)"
    with pytest.raises(UserError, match=r"without a rig a column needs a unit"):
        Recording.from_frame(plain)


@pytest.mark.parametrize(
    "index",
    [
        pd.Index, lambda t: pd.Index(1e3 * t, name="t [ms]"), lambda t: pd.Index(t, name="time"),
        lambda t: pd.to_timedelta(t, unit="s"), lambda t: pd.Timestamp("2024-01-02") + pd.to_timedelta(t, unit="s"),
    ],
)  # fmt: skip
def test_the_time_may_be_the_index(index, frame):
    there = frame.drop(columns="t").set_index(index(frame.t.to_numpy()))
    recording = Recording.from_frame(there)
    assert recording.sample_time_s == pytest.approx(1e-3, rel=1e-6)
    assert np.array_equal(recording.channels["q3"], frame.q3)


def test_to_frame_gives_the_same_recording_again(frame, lead_screw, save, tmp_path):
    first = Recording.from_frame(frame, units={"q3": "m", "r": "m"}, rig=lead_screw, trust_units=True)
    table = first.to_frame()
    assert list(table) == ["t_s", "r_m", "u_v", "theta_m_rad", "q3_m"]
    same(first, Recording.from_frame(table, rig=lead_screw, trust_units=True))
    same(first, Recording.from_frame(table))
    table.to_parquet(tmp_path / "again.parquet")
    same(first, read_recording(tmp_path / "again.parquet", rig=lead_screw, trust_units=True))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.drop(columns="u"), "lacks the column u"),
        (lambda f: f.drop(columns="t"), "has no time column"),
        (lambda f: f.assign(q3="a"), "column q3 holds no numbers"),
        (lambda f: f.assign(q3=f.q3 + 1j * f.q3), "column q3 is complex"),
        (lambda f: f.iloc[:50], "is too short"),
        (lambda f: f.iloc[:0], "is empty"),
        (lambda f: f.to_numpy(), "must be a DataFrame"),
        (lambda f: pd.concat([f, f.q3], axis=1), "two columns named q3"),
        (lambda f: f.assign(**{"q3 [mm]": 1e3 * f.q3}), "two columns for q3, q3 and q3 [mm]; leave one out"),
        (
            lambda f: f.assign(**{"x1": f.q3, "x1 [mm]": 1e3 * f.q3}),
            "two columns for x1, x1 [mm] and x1; leave one out",
        ),
        (lambda f: f.assign(**{"x1_um": f.q3, "x1 [mm]": f.q3}), "two columns for x1, x1_um and x1 [mm]; leave one"),
        (lambda f: f.drop(columns="t").set_index(f.t.astype(str) + "x"), "an index of times"),
    ],
)
def test_what_is_wrong_with_a_frame_is_one_line(change, said, frame):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UserError) as caught:
            Recording.from_frame(change(frame), name="bench")
    assert str(caught.value).startswith("recording=bench: ")
    assert said in str(caught.value)


def test_missing_values_of_pandas_are_missing_values(frame):
    holes = frame.astype({"q3": "Float64"})
    holes.loc[[100, 101], "q3"] = pd.NA
    assert any("2 missing values interpolated" in note for note in Recording.from_frame(holes).notes)


@pytest.mark.parametrize(
    ("units", "said"),
    [
        ({"q3": "furlong"}, "recording.units.q3=furlong: choose one of m, cm, mm"),
        ({"q3": "deg"}, "recording.units.q3=deg: choose one of m, cm, mm"),
        ({"u": "mm"}, "recording.units.u=mm: choose one of V, mV"),
        ({"q9": "mm"}, "recording.units.q9=mm: no such channel; lead_screw has t, r, u, theta_m"),
        ({"i_m": "mA"}, "recording.units.i_m=mA: no such column; it has t, r, u"),
    ],
)
def test_units_that_cannot_be_are_one_line(units, said, frame, lead_screw):
    with pytest.raises(UserError) as caught:
        Recording.from_frame(frame, units=units, rig=lead_screw)
    assert said in str(caught.value)


def test_a_recording_prints_itself_in_a_few_lines(frame, lead_screw):
    given = frame.rename(columns={"q3": "q3_um"})
    recording = Recording.from_frame(given, rig=lead_screw, trust_units=True, name="bench")
    first, *lines = str(recording).splitlines()
    assert first == f"bench: {len(frame)} samples, 0.001 s apart, from {frame.t[0]:g} s"
    channels = {line.split()[0]: line for line in lines[: len(recording.channels)]}
    low, high = 1e-6 * frame.q3.min(), 1e-6 * frame.q3.max()
    assert set(channels) == set(recording.channels)
    assert channels["q3"].endswith(f"{low:.4g} to {high:.4g} m   read in um (header)")
    assert [line.strip() for line in lines[len(channels) :]] == recording.notes
    assert len(recording.notes) > 0
    assert "part train" in str(replace(recording, part="train"))
