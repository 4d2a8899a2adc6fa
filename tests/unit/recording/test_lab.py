"""A lab's files: time stamps, texts beside numbers, remarks, UTF-16, Excel; and what is said where they do not fit."""

import numpy as np
import pandas as pd
import pytest
import yaml

from dtbacklash.errors import UserError
from dtbacklash.recording import Recording, read_recording, stamps

N = 300
K = np.arange(N)
U, X = np.sin(0.05 * K), np.cos(0.03 * K)
START = pd.Timestamp("2026-03-01 23:59:59.900")
TIMES = pd.Series(START + pd.to_timedelta(K, unit="ms"))
STAMPS = {
    "iso": TIMES.dt.strftime("%Y-%m-%dT%H:%M:%S.%f"), "zone": TIMES.dt.strftime("%Y-%m-%d %H:%M:%S.%f+01:00"),
    "german": TIMES.dt.strftime("%d.%m.%Y %H:%M:%S,%f"), "clock": TIMES.dt.strftime("%H:%M:%S,%f"),
    "twelve hours": TIMES.dt.strftime("%m/%d/%Y %I:%M:%S.%f %p"), "month": TIMES.dt.strftime("%d-%b-%Y %H:%M:%S.%f"),
    "compact": TIMES.dt.strftime("%Y%m%dT%H%M%S.%f"), "no hours": TIMES.dt.strftime("%M:%S.%f"),
    "day first": TIMES.dt.strftime("%d/%m/%Y %H:%M:%S.%f"), "two digits": TIMES.dt.strftime("%d.%m.%y %H:%M:%S,%f"),
    "whole seconds": TIMES.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ").str.replace(".000000Z", "Z"),
    "colons": TIMES.dt.strftime("%H:%M:%S:%f").str[:-3], "utc": TIMES.dt.strftime("%Y-%m-%dT%H:%M:%S.%f000Z"),
}  # fmt: skip


@pytest.mark.parametrize("kind", STAMPS)
def test_time_stamps_across_midnight_are_seconds(kind, tmp_path):
    frame = pd.DataFrame({"Zeit [hh:mm:ss]": STAMPS[kind], "u": U, "x [mm]": X})
    frame.to_csv(tmp_path / "a.csv", sep=";", decimal=",", index=False)
    found = read_recording(tmp_path / "a.csv")
    assert found.sample_time_s == pytest.approx(1e-3)
    assert found.t_s[0] == 0.0
    assert np.allclose(found.channels["x"], 1e-3 * X)


def test_dates_of_pandas_and_texts_in_a_frame():
    for times in (TIMES, TIMES.dt.tz_localize("UTC"), STAMPS["german"]):
        found = Recording.from_frame(pd.DataFrame({"Zeit": times, "u": U, "x [mm]": X, "state": ["on"] * N}))
        assert found.sample_time_s == pytest.approx(1e-3)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "utf-16-be"])
def test_texts_and_a_remark_in_the_first_row(encoding, tmp_path):
    remark = ["Probe 3, neu", *[""] * (N - 1)]
    frame = pd.DataFrame({"t [ms]": K, "state": ["läuft"] * N, "u": U, "Weg": X, "remark": remark})
    frame.to_csv(tmp_path / "a.csv", sep=";", decimal=",", index=False, encoding=encoding)
    mapping = {"files": ["a.csv"], "time": "t [ms]", "channels": {"u": "u", "x": {"column": "Weg", "unit": "mm"}}}
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump(mapping))
    found = read_recording(str(tmp_path / "lab.yaml"))
    assert found.samples == N
    assert np.allclose(found.channels["u"], U)
    assert np.allclose(found.channels["x"], 1e-3 * X)


def test_an_excel_file(tmp_path):
    pytest.importorskip("openpyxl")
    frame = pd.DataFrame({"Zeit": TIMES, "u": U, "x [mm]": X, "remark": ["new", *[None] * (N - 1)]})
    frame.to_excel(tmp_path / "a.xlsx", index=False)
    found = read_recording(tmp_path / "a.xlsx")
    assert found.sample_time_s == pytest.approx(1e-3)
    assert np.allclose(found.channels["x"], 1e-3 * X)


@pytest.mark.parametrize("before", [{}, {"Bench": ["3", "operator: X"]}], ids=["an empty sheet", "a cover"])
def test_the_first_sheet_with_a_table_is_read_and_said(before, tmp_path):
    pytest.importorskip("openpyxl")
    with pd.ExcelWriter(tmp_path / "a.xlsx") as book:
        pd.DataFrame(before).to_excel(book, sheet_name="Cover", index=False)
        pd.DataFrame({"t [ms]": K, "u": U, "x [mm]": X}).to_excel(book, sheet_name="Log", index=False)
        pd.DataFrame({"t [ms]": K, "u": 0.0 * U, "x [mm]": X}).to_excel(book, sheet_name="Later", index=False)
    found = read_recording(tmp_path / "a.xlsx")
    assert np.allclose(found.channels["u"], U)
    assert "Sheet Log is read: none before it holds a table of numbers." in found.notes


@pytest.mark.parametrize("suffix", ["csv", "xlsx"])
def test_a_time_column_without_values_is_told_and_a_sample_time_does(suffix, tmp_path):
    frame, file = pd.DataFrame({"Zeit": np.full(N, np.nan), "u": U, "x [mm]": X}), tmp_path / f"a.{suffix}"
    if suffix == "xlsx":
        pytest.importorskip("openpyxl")
        frame.to_excel(file, index=False)
    else:
        frame.to_csv(file, index=False)
    with pytest.raises(UserError, match=r"has no values in its time column Zeit .* recording\.sample_time_s=SECONDS"):
        read_recording(file)
    assert read_recording(file, sample_time_s=0.002).sample_time_s == 0.002


def test_the_sample_time_may_be_given(tmp_path):
    pd.DataFrame({"u": U, "x [mm]": X}).to_csv(tmp_path / "a.csv", index=False)
    assert read_recording(tmp_path / "a.csv", sample_time_s=0.002).sample_time_s == 0.002
    with pytest.raises(UserError, match=r"recording\.sample_time_s=SECONDS"):
        read_recording(tmp_path / "a.csv")


def test_a_message_says_what_the_file_has_and_what_this_rig_wants(lead_screw, tmp_path):
    pd.DataFrame({"t": 1e-3 * K, "u": U, "Laser": X}).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(UserError, match=r"the file has t, u, Laser; lead_screw wants u and some of theta_m"):
        read_recording(tmp_path / "a.csv", rig=lead_screw)


def test_a_file_without_a_header_names_no_channel_of_another_rig(tmp_path):
    pd.DataFrame({"t": 1e-3 * K, "u": U, "x": X}).to_csv(tmp_path / "a.csv", index=False, header=False)
    with pytest.raises(
        UserError, match=r"MAPPING.yaml: {files: \[FILE\], time: 0, channels: {u: 1, SENSOR: 2}}"
    ) as error:
        read_recording(tmp_path / "a.csv")
    assert "q3" not in str(error.value)


def test_an_infinite_value_is_not_a_missing_one():
    x = X.copy()
    x[7] = np.inf
    with pytest.raises(UserError, match="channel x is inf"):
        Recording.from_frame(pd.DataFrame({"t": 1e-3 * K, "u": U, "x [mm]": x}))


def test_what_is_no_stamp():
    assert stamps.seconds(["on", "off"]) is None
    assert stamps.seconds(["10:00:00", "off"]) is None
    assert stamps.seconds(["31.02.2026 10:00:00", "31.02.2026 10:00:01"]) is None
