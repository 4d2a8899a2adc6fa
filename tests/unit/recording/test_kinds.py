"""Logs as instruments, drives, buses and simulations write them: read without preparation, or one line that mends them.

Each is written here from the same command and angle, and has to give them back.
"""

import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nominal import nominal_rig

from dtbacklash.diagnosis.inspect.inspection import _turned_back
from dtbacklash.diagnosis.records import records_of
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import build_rig
from dtbacklash.recording import Recording, read_recording

STEP_S = 5e-3
K = np.arange(400)
T = STEP_S * K
U = np.sign(np.sin(0.11 * K)) + 0.1 * np.sin(0.05 * K)
THETA = np.round(30.0 * np.sin(0.02 * K) + 2.0, 6)


STAMPS = (pd.Timestamp("2026-03-01 10:00:00.125") + pd.to_timedelta(T, unit="s")).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def table(separator=",", decimal=".", heads=("t", "u", "theta"), columns=(T, U, THETA), behind="", first=0) -> str:
    """Rows of numbers below a row of heads; ``behind`` : at the end of each row."""
    out = io.StringIO()
    frame = pd.DataFrame(dict(enumerate(columns)))[first:]
    frame.to_csv(out, sep=separator, decimal=decimal, header=False, index=False, float_format="%.9g")
    rows = out.getvalue().rstrip("\n").replace("\n", behind + "\n") + behind + "\n"
    return (separator.join(heads) + "\n" if heads else "") + rows


def lvm(x_columns: str, segments: int = 1) -> str:
    """LabVIEW's measurement file: one column of times, one for each channel, or none."""
    head = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\n"
    head += f"X_Columns\t{x_columns}\nTime_Pref\tRelative\n***End_of_Header***\t\t\n"
    heads, unit, columns = {
        "One": ("X_Value\tu\ttheta\tComment", "V\tdeg\t", (T, U, np.rad2deg(THETA))),
        "Multi": ("X_Value\tu\tX_Value\ttheta\tComment", "V\t\tdeg", (T, U, T, np.rad2deg(THETA))),
        "No": ("X_Value\tu\ttheta\tComment", "V\tdeg", (np.full(len(T), np.nan), U, np.rad2deg(THETA))),
    }[x_columns]
    top = f"Channels\t2\t\t\nSamples\t400\t400\t\nDate\t2026/03/01\t2026/03/01\t\nY_Unit_Label\t{unit}\t\n"
    top += f"X_Dimension\tTime\tTime\t\nX0\t0,0\t0,0\t\nDelta_X\t0,005\t0,005\t\n***End_of_Header***\t\t\t\n{heads}\n"
    rows = table("\t", ",", (), columns)
    parts = ["\n".join(rows.split("\n")[k::1][: len(K) // segments]) for k in range(0, len(K), len(K) // segments)]
    return head + "\n".join(top + part + "\n" for part in parts)


def scope(other: float = 0.0) -> str:
    """A drive's scope: keys that recur for each channel, times of its own for each, in ms."""
    head = "Name;Drive scope\nFile;C:\\scope\\a.svdx\nStart;133500000000000000;Tuesday\n\n"
    head += "Name;u;Name;theta\nSymbolName;MAIN.u;SymbolName;MAIN.theta\nData-Type;REAL;Data-Type;REAL\n"
    head += "SampleTime [ms];5;SampleTime [ms];5\n\n"
    return head + table(";", ".", (), (1e3 * T, U, 1e3 * T + other, THETA))


def tektronix() -> str:
    """Preamble of keys and values, then TIME, CH1, CH2."""
    head = "Model,MSO24\nHorizontal Units,s\nSample Interval,0.005\nVertical Units,V,rad\nSource,CH1,CH2\nLabels,,\n\n"
    return head + table(heads=("TIME", "CH1", "CH2"))


def rigol() -> str:
    """Neither times nor their unit: a number of each row, and its step beside the names."""
    head = "X,CH1,CH2,Start,Increment,\nSequence,Volt,rad,0.000e+00,5.000e-03\n"
    return head + table(heads=(), columns=(K, U, THETA), behind=",,")


def bus(seconds: bool = False) -> str:
    """A row for each message: the command every 40 ms, the angle every 5 ms, a status now and then."""
    rows = [(int(1e9 * t), f"{u:.9g}", "", "") for t, u in zip(T[::8], U[::8], strict=True)]
    rows += [(int(1e9 * t) + 10, "", f"{x:.9g}", "") for t, x in zip(T, THETA, strict=True)]
    rows += [(int(1e9 * t) + 20, "", "", "7") for t in T[::50]]
    since = 1_766_147_454_233_218_075
    lines = []
    for ns, *values in sorted(rows):
        s, rest = divmod(since + ns, 10**9)
        lines.append(",".join([*((str(s), str(rest)) if seconds else (str(since + ns),)), *values]))
    times = "header.stamp.sec,header.stamp.nanosec" if seconds else "timestamp [ns]"
    return f"{times},cmd.u,joint.theta,state\n" + "\n".join(lines) + "\n"


def long_form() -> str:
    """A row for each value, which says what it is the value of."""
    rows = [f"{t:.6f},Drive,{name},{value:.9g}" for t, u, x in zip(T, U, THETA, strict=True)
            for name, value in (("u", u), ("theta", x), ("state", 1.0))]  # fmt: skip
    return "\n".join(["Time [s],Node,Signal,Value", *rows]) + "\n"


def beside() -> str:
    """An oscilloscope's keys beside the numbers, in the first rows."""
    keys = ["Record Length,400,", "Sample Interval,5e-3,", "Vertical Units,V,"]
    rows = table(heads=()).rstrip("\n").split("\n")
    return "\n".join((keys[k] if k < len(keys) else ",,") + f",{row}," for k, row in enumerate(rows)) + "\n"


def simulated(between: bool) -> str:
    """A simulation's result: a row before and a row after each step of the command, on the grid or in between."""
    rows = []
    for k in K:
        jump = k and U[k] * U[k - 1] < 0
        if jump and between:
            rows += [(T[k] - 2e-3, U[k - 1], THETA[k] - 1e-3), (T[k] - 2e-3, U[k], THETA[k] - 1e-3)]
        elif jump:
            rows.append((T[k], U[k - 1], THETA[k]))
        rows.append((T[k], U[k], THETA[k]))
    return table(columns=tuple(np.array(rows).T))


BY_NUMBER = {"time": 0, "channels": {"u": 1, "theta": 2}}
BY_NAME = {"time": "TIME", "channels": {"u": "CH1", "theta": "CH2"}}
#: a kind -> its text, a mapping where it needs one, the share of the command's samples that are as they were
KINDS = {
    "no head": (table(heads=()), BY_NUMBER, 1.0),
    "no head, a line about it": (f"# bench 3, {len(K)} rows\n" + table(heads=()), BY_NUMBER, 1.0),
    "a head in place of its number": (table(heads=("Zeit", "AO 0", "Enc")), BY_NUMBER, 1.0),
    "more heads than columns": (table(heads=("t", "u", "theta", "comment", "note")), None, 1.0),
    "trailing delimiters": (table(behind=",,"), None, 1.0),
    "rows that are counted, without a head": (table(" ", columns=(K + 1, T, U, THETA)), None, 1.0),
    "a mapping without times": (table(heads=("Zeit", "AO", "Enc")), {"channels": {"u": "AO", "theta": "Enc"}}, 1.0),
    **{f"LVM, X_Columns {x}": (lvm(x), None, 1.0) for x in ("One", "Multi", "No")},
    "LVM, two segments": (lvm("One", 2), None, 1.0),
    "LVM, two segments without times": (lvm("No", 2), None, 1.0),
    "scope of a drive": (scope(), None, 1.0),
    "scope of a drive, channels 1 ms apart": (scope(1.0), None, 0.0),
    "times of each channel": (table(heads=("Time", "u", "Time", "theta"), columns=(T, U, T, THETA)), None, 1.0),
    "Tektronix": (tektronix(), BY_NAME, 1.0),
    "Keysight": ("x-axis,1,2\nsecond,Volt,rad\n" + table(heads=()), {"channels": {"u": "1", "theta": "2"}}, 1.0),
    "LeCroy": ("LECROYWS3024,1,Waveform\nSegments,1,SegmentSize,400\nSegment,TrigTime,TimeSinceSegment1\n"
               "#1,01-Jan-2026 10:00:00,0\n" + table(heads=("Time", "Ampl", "Ampl2")),
               {"channels": {"u": "Ampl", "theta": "Ampl2"}}, 1.0),
    "Rigol": (rigol(), {"channels": {"u": "CH1", "theta": "CH2"}}, 1.0),
    "oscilloscope, volts of a sensor": (
        "Time,CH1,CH2\n(ms),(V),(mV)\n\n" + table(heads=(), columns=(1e3 * T, U, 2 * THETA)),
        {"channels": {"u": "CH1", "theta": {"column": "CH2", "scale": 0.5}}}, 1.0),
    "drive's scope, UTF-8 with a mark": ("\ufeff" + scope(), None, 1.0),
    "trace of a real-time computer": (
        "trace_keys,1,2,3\ntrace_values\npath,,Model/u,Model/theta\nunit,s,V,rad\n"
        + "".join(f",{row}\n" for row in table(heads=()).splitlines()),
        {"time": 1, "channels": {"u": 2, "theta": 3}}, 1.0),
    "message bus, ns since 1970": (bus(), None, 0.1),
    "message bus, sec and nanosec": (bus(True), None, 0.1),
    "simulation, events on its grid": (simulated(False), None, 1.0),
    "simulation, events in between": (simulated(True), None, 0.9),
    "units behind the values": (
        table(";", heads=("t", "u", "theta"), columns=(
            [f"{1e3 * t:.6g} ms" for t in T], [f"{1e3 * u:.9g}mV" if abs(u) < 0.5 else f"{u:.9g}V" for u in U],
            [f"{x:.9g} rad" for x in THETA])), None, 1.0),
    "a row for each value, with its unit": (
        "Time;Signal;Value;Unit\n" + "".join(f"{t:.6f};u;{u:.9g};V\n{t:.6f};theta;{np.rad2deg(x):.9g};deg\n"
                                             for t, u, x in zip(T, U, THETA, strict=True)), None, 1.0),
    "a name and a unit with each value": (
        "".join(f"t={t:.6f}s, u={u:.9g}V, theta={x:.9g} rad\n" for t, u, x in zip(T, U, THETA, strict=True)),
        None, 1.0),
    "lines of a program": (
        "".join(f"INFO [{t:.6f}] control: u={u:.9g} theta={x:.9g}\n" for t, u, x in zip(T, U, THETA, strict=True)),
        None, 1.0),
    "attributes of XML": (
        "".join(f'<s t="{t:.6f}" u="{u:.9g}" theta="{x:.9g}"/>\n' for t, u, x in zip(T, U, THETA, strict=True)),
        None, 1.0),
    "a serial monitor": (
        "".join(f"{s[11:23]} -> {u:.9g},{x:.9g}\n" for s, u, x in zip(STAMPS, U, THETA, strict=True)), BY_NUMBER, 1.0),
    "an analyser's blocks": (
        "Export V4.2\nBlocksize:\t400\nCoupling:\tDC\tDC\nData:\tTime\n\nX\tCh1: Force in\tCh2: Laser\ns\tV\trad\n"
        + table("\t", heads=()), {"channels": {"u": "Ch1: Force in", "theta": "Ch2: Laser"}}, 1.0),
    "topics of a bus": (
        bus(True).replace("header.stamp.sec,header.stamp.nanosec,cmd.u,joint.theta",
                          "/header/stamp/secs,/header/stamp/nsecs,/cmd/u,/joint/theta"), None, 0.1),
    "how each column is kept": ("time;u;theta\ns;V;rad\nf8;f8;f8\n" + table(";", heads=()), None, 1.0),
    "lines of JSON, nested": (
        "".join(f'{{"ts": {t:.6f}, "cmd": {{"u": {u:.9g}}}, "joint": {{"theta": {x:.9g}}}}}\n'
                for t, u, x in zip(T, U, THETA, strict=True)), None, 1.0),
    "JSON, rows beside their names": (
        f'{{"columns": ["t", "u", "theta"], "rows": {np.column_stack([T, U, THETA]).tolist()}}}', None, 1.0),
    "more than a day": (
        table(heads=("Elapsed", "u", "theta"), columns=([f"25:00:{t:06.3f}" for t in T], U, THETA)), None, 1.0),
    "readings that failed": (
        table(columns=(T, U, ["OVER" if k % 97 == 50 else f"{x:.9g}" for k, x in enumerate(THETA)])), None, 1.0),
    "a counter of 32 bits": (
        table(heads=("micros", "u", "theta"), columns=((4_294_000_000 + 5000 * K) % 2**32, U, THETA)), None, 1.0),
    "a counter of 16 bits": (
        table(heads=("t [ms]", "u", "theta"), columns=((65_000 + 5 * K) % 2**16, U, THETA)), None, 1.0),
    "a clock that begins anew": (table(columns=(np.tile(T[:200], 2), U, THETA)), None, 1.0),
    "seconds, and milliseconds beside them": (
        "NO.,Time,ms,u,theta\nNO.,time,ms,V,rad\n" + table(
            heads=(), columns=(K, [s[:19] for s in STAMPS], [s[20:23] for s in STAMPS], U, THETA)), None, 1.0),
    "seconds since 1970, and microseconds": (table(heads=("tv_sec", "tv_usec", "u", "theta"), columns=(
        1_767_225_600 + K // 200, K % 200 * 5000, U, THETA)), None, 1.0),
    "keys above the numbers' own columns": (
        '"TraceName","u","theta"\n"BlockSize",400,400\n"VUnit","V","rad"\n"HResolution",5e-3,5e-3\n"SampleRate",200,200\n\n'
        + "".join(f",{u:.9g},{x:.9g}\n" for u, x in zip(U, THETA, strict=True)), None, 1.0),
    "a unit nobody knows": ("t,u,theta,n,T,f\ns,Volt,rad,counts,°C,Hz\n"
                            + table(heads=(), columns=(T, U, THETA, K, K, K)), None, 1.0),
    "thousands": (table(";", heads=("t", "u", "theta [mrad]"), columns=(T, U, [f"{1e3 * x:,.3f}" for x in THETA])),
                  None, 1.0),
    "thousands, decimal comma": (
        table(";", ",", ("t", "u", "theta [mrad]"),
              (T, U, [f"{1e3 * x:,.3f}".translate(str.maketrans(".,", ",.")) for x in THETA])), None, 1.0),
    "thousands, whole numbers": (
        table("\t", heads=("t [us]", "u", "theta"), columns=[[f"{v:,.0f}" for v in 1e6 * x] for x in (T, U, THETA)]),
        {"time": "t [us]", "channels": {"u": {"column": "u", "unit": "uV"},
                                        "theta": {"column": 2, "scale": 1e-6, "si_unit": "rad"}}}, 1.0),
    "exponents of Fortran": (
        table(" ", columns=[[f"{v:.9E}".replace("E", "D") for v in x] for x in (T, U, THETA)]), None, 1.0),
    "a row for each value": (long_form(), None, 1.0),
    "a table for each signal": (
        ",result,_time,_value,_field\n" + "".join(
            f",0,{STAMPS[k]},{x[k]:.9g},{name}\n" for name, x in (("u", U), ("theta", THETA)) for k in K), None, 1.0),
    "a name before each value": (
        "boot v1\n" + "".join(f"t:{t:.6g}\tu:{u:.9g}\ttheta:{x:.9g}\n" for t, u, x in zip(T, U, THETA, strict=True)),
        None, 1.0),
    "a line of JSON for each row": (
        pd.DataFrame({"t": T, "u": U, "theta": THETA}).to_json(orient="records", lines=True), None, 1.0),
    "a drawn table": ("| t | u | theta |\n|---|---|---|\n"
                      + "".join(f"| {row.replace(',', ' | ')} |\n" for row in table(heads=()).splitlines()), None, 1.0),
    "an index that is the time": (table(heads=("", "u", "theta")), None, 1.0),
    "days since 1900": (
        table(heads=("Time", "u", "theta"), columns=([f"{46082.5 + t / 86400:.11f}" for t in T], U, THETA)), None, 1.0),
    "times with too few digits": (table(columns=([f"{t:.2f}" for t in T], U, THETA)), None, 1.0),
    **{f"times called {head}": (table(heads=(head, "u", "theta"), columns=(size * T, U, THETA)), None, 1.0)
       for head, size in (("__time", 1.0), ("millis()", 1e3), ("Relative Time [ms]", 1e3), ("time_elapsed", 1.0))},
    "keys beside the numbers": (beside(), {"time": 3, "channels": {"u": 4, "theta": 5}}, 1.0),
    "clocks called after their channels": (
        table(heads=("u_time", "u", "theta_time", "theta"), columns=(T, U, T, THETA)), None, 1.0),
    "us since 1970": (table(heads=("timestamp", "u", "theta"), columns=(1_766_147_454_233_218 + 5000 * K, U, THETA)),
                      None, 1.0),
    "a rate for all": ("Sample rate: 0.2 kHz\n" + table(heads=("u", "theta"), columns=(U, THETA)), None, 1.0),
    "names and units behind a #": ("# t [s]  u [V]  theta [rad]\n" + table(" ", heads=()), None, 1.0),
    "decimal comma in quotes": (
        "\n".join('"' + '","'.join(row.replace(".", "%").split(",")).replace("%", ",") + '"'
                  for row in table().rstrip("\n").split("\n")), None, 1.0),
    "each row twice": (table(columns=[np.repeat(c, 2) for c in (T, U, THETA)]), None, 1.0),
    "a line below the numbers": (table() + "end of record,,\n", None, 1.0),
}  # fmt: skip


@pytest.fixture(scope="module")
def arm():
    return nominal_rig("pendulum")


def read(content: str, mapping: dict | None, rig, folder) -> Recording:
    (folder / "log.txt").write_text(content, encoding="utf-8")
    if mapping is None:
        return read_recording(folder / "log.txt", rig=rig, trust_units=True)
    (folder / "map.yaml").write_text(yaml.safe_dump({"files": ["log.txt"], **mapping}))
    return read_recording(str(folder / "map.yaml"), rig=rig, trust_units=True)


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_log_gives_back_command_and_angle(kind, arm, tmp_path):
    content, mapping, share = KINDS[kind]
    found = read(content, mapping, arm, tmp_path)
    assert found.sample_time_s == pytest.approx(STEP_S, rel=2e-4 if "digits" in kind else 1e-6)
    assert sum(b - a for a, b in found.stretches) in (len(K) - 1, len(K))
    offset = len(K) - found.samples
    close = np.isclose(found.channels["theta"], THETA[offset:], atol=0.15 if "apart" in kind else 1e-6)
    assert close.mean() > (0.98 if "failed" in kind else 0.99)
    assert np.isclose(found.channels["u"], U[offset:], atol=1e-8).mean() >= share


def test_what_was_done_is_said(arm, tmp_path):
    said = {
        "more heads than columns": "Columns without values are not used: comment, note.",
        "message bus, ns since 1970": "Channel u has times of its own (50 values, 0.04 s apart): it is held until",
        "simulation, events on its grid": "the later one counts",
        "simulation, events in between": "the command after each holds from there",
        "readings that failed": "Column theta holds text ('OVER') in row 51 of the numbers, 4 times: missing values.",
        "LVM, two segments": "lines of text between or below the numbers left out",
    }
    for kind, words in said.items():
        assert any(words in note for note in read(*KINDS[kind][:2], arm, tmp_path).notes), kind


def test_a_command_that_changes_within_a_sample_is_its_mean(arm, tmp_path):
    found = read(*KINDS["simulation, events in between"][:2], arm, tmp_path)
    jumps = np.flatnonzero(U[1:] * U[:-1] < 0)
    assert np.allclose(found.channels["u"][jumps], 0.6 * U[jumps] + 0.4 * U[jumps + 1])


def test_a_sensor_that_is_read_seldom_is_missing_in_between(arm, tmp_path):
    slow = np.where(K % 4 == 0, THETA, np.nan)
    found = read(table(columns=(T, U, slow)), None, arm, tmp_path)
    assert np.array_equal(np.isfinite(found.channels["theta"]), K % 4 == 0)
    assert np.allclose(found.channels["theta"][::4], THETA[::4])
    said = "Channel theta has times of its own (100 values, 0.02 s apart): it is taken where it was read."
    assert said in found.notes
    again = Recording.from_frame(found.to_frame(), rig=arm, trust_units=True)
    assert np.array_equal(again.channels["theta"], found.channels["theta"], equal_nan=True)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    every=st.integers(1, 6), late_us=st.integers(0, 4000), since=st.integers(0, 2 * 10**18),
    decimal=st.sampled_from(".,"), status=st.booleans(),
)  # fmt: skip
def test_whatever_the_rows_of_a_bus_the_readings_are_those_sent(every, late_us, since, decimal, status, arm, tmp_path):
    """The command has rows of its own; a sensor that is as fast as the grid keeps each of its readings."""
    rows = [(round(1e9 * t), u, np.nan, np.nan) for t, u in zip(T[::every], U[::every], strict=True)]
    rows += [(round(1e9 * t) + 1000 * late_us + 1, np.nan, x, np.nan) for t, x in zip(T, THETA, strict=True)]
    rows += [(round(1e9 * t) + 2, np.nan, np.nan, 1.0) for t in T[::7]] if status else []
    frame = pd.DataFrame(sorted(rows, key=lambda row: row[0]), columns=["t [ns]", "u", "theta", "state"])
    frame["t [ns]"] += since
    out = io.StringIO()
    frame.to_csv(out, sep=";", decimal=decimal, index=False)
    found = read(out.getvalue(), None, arm, tmp_path)
    assert found.samples == len(K)
    assert np.allclose(found.channels["theta"], THETA, atol=1e-6)
    assert set(np.sign(found.channels["u"][found.channels["u"] != 0])) == {-1.0, 1.0}
    assert np.abs(found.channels["u"]).max() <= np.abs(U).max() + 1e-9


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    above=st.lists(st.text(alphabet="abtu =;,\t[ms]#0.:", max_size=30), max_size=6),
    below=st.lists(st.text(alphabet="abt;,\t 0.:#", max_size=20), max_size=3), separator=st.sampled_from(";,\t"),
)  # fmt: skip
def test_whatever_stands_above_and_below_a_table_it_is_read_or_refused(above, below, separator, arm, tmp_path):
    content = "\n".join([*above, table(separator).rstrip("\n"), *below])
    try:
        found = read(content, None, arm, tmp_path)
    except UserError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert np.nanmax(np.abs(found.channels["theta"])) <= np.abs(THETA).max() + 1e-6


COUNTS = np.round(THETA / (2.0 * np.pi) * 4096)
COUNTED = {"counts": 4096, "per": "rev"}


@pytest.mark.parametrize("head", ["theta [counts]", "theta [Inkremente]", "theta (digits)", "theta"])
@pytest.mark.parametrize("where", ["units", "rig", "mapping", "scale", "nowhere"])
def test_counts_are_read_where_something_says_how_large_one_is(head, where, arm, tmp_path):
    (tmp_path / "log.csv").write_text(table(heads=("t", "u", head), columns=(T, U, COUNTS)))
    theta = {"column": head, **({"unit": COUNTED} if where == "mapping" else {"scale": 2.0 * np.pi / 4096})}
    (tmp_path / "map.yaml").write_text(
        yaml.safe_dump({"files": ["log.csv"], "time": "t", "channels": {"u": "u", "theta": theta}})
    )
    counting = replace(arm.config, sensors={"theta": {**arm.config.sensors["theta"], "recorded_in": COUNTED}})
    how = {
        "units": {"units": {"theta": "rev/4096"}, "rig": arm}, "rig": {"rig": build_rig(counting)},
    }.get(where, {"rig": arm})  # fmt: skip
    source = tmp_path / ("map.yaml" if where in ("mapping", "scale") else "log.csv")
    if where == "nowhere":
        if head != "theta":
            with pytest.raises(
                UserError, match=r"say how large one is, as units=\{theta: rev/4096\}.*recorded_in: {cou"
            ):
                read_recording(source, trust_units=True, **how)
        return
    found = read_recording(str(source), trust_units=True, **how)
    assert np.allclose(found.channels["theta"], THETA, atol=np.pi / 4096 + 1e-9)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_some_of_the_rows_may_be_taken(kind, arm, tmp_path, monkeypatch, caplog):
    frame, file = pd.DataFrame({"t": T, "u": U, "theta": THETA}), tmp_path / f"log.{kind}"
    frame.to_csv(file, index=False) if kind == "csv" else frame.to_parquet(file)
    found = read_recording(file, rig=arm, rows=(50, 250))
    assert np.allclose(found.channels["theta"], THETA[50:250])
    for rows in ((5, 1), [1], (0.0, 200.0), "ab"):
        with pytest.raises(UserError, match=r"recording.rows=.*first row, row after the last"):
            read_recording(file, rig=arm, rows=rows)
    monkeypatch.setattr("dtbacklash.recording.text.MANY", 300)
    read_recording(file, rig=arm)
    said = "401 rows: reading them takes about 0 s and 0.0002 GB, and a diagnosis at least twice as long"
    assert (said in caplog.text) == (kind == "csv")


def test_a_sample_time_beside_other_times_is_refused(arm, tmp_path):
    (tmp_path / "log.csv").write_text(table())
    assert read_recording(tmp_path / "log.csv", rig=arm, sample_time_s=STEP_S).sample_time_s == STEP_S
    with pytest.raises(UserError, match=r"recording.sample_time_s=0.002: the file has times, 0.005 s apart"):
        read_recording(tmp_path / "log.csv", rig=arm, sample_time_s=0.002)


@pytest.mark.parametrize("channel", [
    "Enc [deg]", {"column": "Enc [deg]", "scale": 2.0, "offset": 1.0, "unit": "mrad"}, {"column": 2, "si_unit": "rad"},
])  # fmt: skip
def test_advice_on_a_turned_sensor_is_a_line_that_a_mapping_takes(channel, arm, tmp_path):
    mapping = {"time": "t", "channels": {"u": "u", "theta": channel}}
    content = table(heads=("t", "u", "Enc [deg]"))
    found = read(content, mapping, arm, tmp_path)
    line = _turned_back("theta", records_of(found, arm, True, True)[0])
    mapping["channels"] |= yaml.safe_load(line)
    assert np.allclose(read(content, mapping, arm, tmp_path).channels["theta"], -found.channels["theta"])
