"""Every format gives the same channels; nothing but a UserError comes out of garbage."""

import gzip
import io
import json
import warnings

import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dtbacklash import units
from dtbacklash.errors import UserError
from dtbacklash.recording import read_recording

RELAXED = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True
)


def as_bytes(kind: str, frame: pd.DataFrame) -> bytes:  # noqa: PLR0912
    """The frame as the content of a file of some format."""
    columns = {name: frame[name].to_numpy() for name in frame}
    out = io.BytesIO()
    if kind == "parquet":
        frame.to_parquet(out, index=False)
    elif kind == "mat":
        scipy.io.savemat(out, columns)
    elif kind == "mat_struct":
        scipy.io.savemat(out, {"log": columns, "note": "a text", "gain": 3.0})
    elif kind == "npz":
        np.savez(out, **columns)
    elif kind == "json_columns":
        out.write(json.dumps({"columns": list(columns), "data": frame.to_numpy().tolist(), "by": "me"}).encode())
    elif kind == "json_arrays":
        out.write(json.dumps({name: values.tolist() for name, values in columns.items()}).encode())
    elif kind == "json_records":
        out.write(frame.to_json(orient="records", double_precision=15).encode())
    elif kind == "semicolon":
        frame.to_csv(out, index=False, sep=";", decimal=",")
    elif kind == "blanks":
        out.write(("  ".join(frame) + "\n").encode())
        np.savetxt(out, frame.to_numpy(), fmt="%.17g")
    elif kind == "savetxt":
        np.savetxt(out, frame.to_numpy(), fmt="%.17g", header=" ".join(frame), delimiter="\t")
    elif kind == "preamble":
        out.write(b"Logger 3\r\ndate;2024-01-02\r\n\r\n")
        out.write(frame.to_csv(index=False, lineterminator="\r\n").encode())
    elif kind == "units":
        scaled = frame.assign(t=frame.t * 1e3, r=frame.r * 1e3, q3=frame.q3 * 1e6)
        lines = scaled.to_csv(index=False).split("\n", 1)
        out.write(f"{lines[0]}\n[ms],[mm],[V],[rad],[um]\n{lines[1]}".encode())
    elif kind == "trailing":
        out.write("\n".join(f"{line}," for line in frame.to_csv(index=False).split("\n") if line).encode())
    else:
        frame.to_csv(out, index=False)
    return out.getvalue()


KINDS = [
    "csv", "parquet", "mat", "mat_struct", "npz", "json_columns", "json_arrays", "json_records", "semicolon",
    "blanks", "savetxt", "preamble", "units", "trailing",
]  # fmt: skip


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_every_format_gives_the_same_channels_in_si(kind, packed, frame, tmp_path):
    content = as_bytes(kind, frame)
    file = tmp_path / "seen.dat"
    file.write_bytes(gzip.compress(content) if packed else content)
    recording = read_recording(file)
    assert recording.sample_time_s == pytest.approx(1e-3, rel=1e-9)
    assert recording.units == {"r": "m", "u": "V", "theta_m": "rad", "q3": "m"}
    assert np.allclose(recording.t_s, frame.t, atol=1e-9)
    for name in ("r", "u", "theta_m", "q3"):
        assert np.allclose(recording.channels[name], frame[name], rtol=1e-9, atol=1e-13)
    if kind == "units":
        assert recording.notes == []
        assert recording.assumed_units["q3"] == "um (header)"
    else:
        said = "t in s, r, q3 in m, u in V, theta_m in rad (taken as SI, since nothing is said)"
        assert recording.notes == [f"Units: {said}."]
        assert recording.assumed_units["q3"] == "m (assumed)"


def test_matlab_73_is_read_or_its_extra_is_named(frame, tmp_path, refusal):
    try:
        import h5py
    except ImportError:
        (tmp_path / "seen.mat").write_bytes(b"MATLAB 7.3 MAT-file" + 200 * b"\0")
        assert "dtbacklash[matlab]" in refusal(tmp_path / "seen.mat")
        return
    with h5py.File(tmp_path / "seen.mat", "w") as file:
        for name in frame:
            file[name] = frame[name].to_numpy()[None, :]
    assert np.allclose(read_recording(tmp_path / "seen.mat").channels["q3"], frame.q3)


def test_in_open_loop_the_reference_is_the_command(frame, save):
    recording = read_recording(save(frame.assign(r=frame.u)))
    assert recording.units["r"] == "V"
    assert np.array_equal(recording.channels["r"], frame.u)


def test_a_column_in_a_unit_of_another_kind_is_refused(frame, save, refusal, lead_screw):
    file = save(frame.rename(columns={"q3": "q3_deg"}))
    assert "column q3_deg is in deg (header), and q3 is measured in m" in refusal(file, rig=lead_screw)


def cut(kind):
    def half(frame):
        content = as_bytes(kind, frame)
        return content[: len(content) // 2]

    return half


def ragged(frame):
    lines = as_bytes("csv", frame).split(b"\n")
    lines[7] += b",1,2,3"
    return b"\n".join(lines)


#: what a file holds, and what is said of it
BAD = {
    **{f"a {kind} cut short": (cut(kind), "damaged") for kind in ("parquet", "mat", "npz", "json_columns")},
    "a gzip cut short": (lambda f: gzip.compress(as_bytes("csv", f))[:30_000], "its gzip ends too early"),
    "nothing": (lambda f: b"", "is empty"),
    "blanks": (lambda f: b"   \n\n", "is empty"),
    "a gzip of nothing": (lambda f: gzip.compress(b"", mtime=0), "is empty"),
    "one row": (lambda f: f.head(1).to_csv(index=False).encode(), "holds one row of numbers"),
    "two rows": (lambda f: f.head(2).to_csv(index=False).encode(), "2 samples, at least 100"),
    "a head alone": (lambda f: f.head(0).to_csv(index=False).encode(), "holds no table of numbers"),
    "no header": (lambda f: f.to_csv(index=False, header=False).encode(), "has no header"),
    "text among numbers": (
        lambda f: as_bytes("csv", f.astype({"q3": object}).replace({"q3": dict.fromkeys(f.q3[41:400], "over")})),
        "column q3 holds text ('over') in row 42"),
    "lines of different lengths": (ragged, "lines of different lengths"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused(case, frame, tmp_path, refusal):
    content, said = BAD[case]
    (tmp_path / "seen.dat").write_bytes(content(frame))
    assert said in refusal(tmp_path / "seen.dat")


def test_an_unreadable_file_is_refused(frame, save, refusal, monkeypatch):
    file = save(frame)

    def denied(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.read_bytes", denied)
    assert "cannot be read: permission denied" in refusal(file)


HEADS = (b"", b"PAR1", b"MATLAB 5.0 MAT-file" + 105 * b" " + b"\x00\x01IM", b"PK\x03\x04", b"{", b"[[",
         b"\x1f\x8b\x08\x00", b"\x89HDF\r\n\x1a\n", b"\x93NUMPY", b"t,u,q3\n",
         b"t;u;q3\n0,1;2;3\n", b"# t u\n1 2\n")  # fmt: skip


@RELAXED
@given(head=st.sampled_from(HEADS), body=st.binary(max_size=400))
def test_garbage_gives_a_user_error_and_nothing_else(head, body, tmp_path):
    file = tmp_path / "garbage.bin"
    file.write_bytes(head + body)
    with pytest.raises(UserError) as caught:
        read_recording(file)
    assert "\n" not in str(caught.value)


@RELAXED
@given(body=st.text(alphabet="tuq3,;\t \n.-+e0123456789na#", max_size=300))
def test_text_that_looks_like_a_table_gives_a_user_error_and_nothing_else(body, tmp_path):
    file = tmp_path / "garbage.csv"
    file.write_text("t,u,q3\n" + body)
    with pytest.raises(UserError):
        read_recording(file)


# --- what files hold that nobody expects


def arrays(frame: pd.DataFrame, **changes: object) -> dict[str, object]:
    return {**{name: frame[name].to_numpy() for name in frame}, **changes}


def test_an_object_array_of_matlab_is_passed_over_or_named(frame, tmp_path, refusal):
    mixed = np.array([1, "a", np.arange(3)], dtype=object)
    scipy.io.savemat(tmp_path / "a.mat", arrays(frame, cells=mixed, deep={"x": mixed}))
    assert "not used: cells, deep.x." in read_recording(tmp_path / "a.mat").notes[0]
    scipy.io.savemat(tmp_path / "b.mat", arrays(frame, q3=np.array([np.arange(3), *range(3999)], dtype=object)))
    assert "recording=b.mat: column q3 holds no numbers" in refusal("b.mat")


def test_a_complex_column_is_refused_unless_it_is_real(frame, tmp_path, refusal):
    np.savez(tmp_path / "a.npz", **arrays(frame, q3=frame.q3 * (1 + 1j)))
    assert "a.npz: column q3 is complex" in refusal("a.npz")
    np.savez(tmp_path / "b.npz", **arrays(frame, q3=frame.q3 + 0j, other=frame.q3 * 1j))
    recording = read_recording("b.npz")
    assert np.array_equal(recording.channels["q3"], frame.q3)


def test_a_column_of_the_wrong_length_is_named(frame, tmp_path, refusal):
    np.savez(tmp_path / "a.npz", **arrays(frame, u=frame.u[:-1], gains=np.arange(3)))
    assert "a.npz: column u has 3999 values, and the others 4000" in refusal("a.npz")
    np.savez(tmp_path / "b.npz", **arrays(frame, gains=np.arange(3)))
    assert "not used: gains." in read_recording("b.npz").notes[0]


@pytest.mark.parametrize("column", ["t", "u", "q3"])
@pytest.mark.parametrize("value", [1e300, -1.7e308, 1e200, 1e13])
def test_a_value_beyond_all_measure_is_refused(column, value, frame, save, refusal):
    frame.loc[77, column] = value
    line = refusal(save(frame))
    assert "seen.csv" in line
    assert "in row 78 of the numbers" in line


NASTY = st.sampled_from([0.0, -0.0, 1e300, -1e300, 1.7e308, 5e-324, 1e-300, 1e12, np.nan, np.inf, -np.inf, 1.0, -3.5])


@RELAXED
@given(
    column=st.sampled_from(["t", "r", "u", "theta_m", "q3"]), values=st.lists(NASTY, min_size=1, max_size=60),
    everywhere=st.booleans(), kind=st.sampled_from(["csv", "npz", "parquet"]), rig=st.booleans(),
)  # fmt: skip
def test_nasty_values_give_a_recording_or_one_line_and_no_warning(
    column, values, everywhere, kind, rig, frame, tmp_path, lead_screw
):
    spoilt = frame[:300].copy()
    count = len(spoilt) if everywhere else len(values)
    spoilt.loc[: count - 1, column] = np.resize(values, count)
    file = tmp_path / "nasty.bin"
    file.write_bytes(as_bytes(kind, spoilt))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            recording = read_recording(file, rig=lead_screw if rig else None)
        except UserError as error:
            assert "\n" not in str(error)  # noqa: PT017
            assert "nasty.bin" in str(error)  # noqa: PT017
        else:
            assert all(np.isfinite(values).all() for values in recording.channels.values())


WRITTEN = st.sampled_from(
    [
        (name, unit)
        for name, si in (("q3", "m"), ("theta_m", "rad"), ("i_m", "A"), ("u", "V"))
        for unit in units.of_kind(si)
    ]
)


@RELAXED
@given(
    written=WRITTEN, style=st.sampled_from(["{} [{}]", "{}[{}]", "{} ({})", "{}_{}", "{} [ {} ]"]),
    capitals=st.booleans(), with_rig=st.booleans(),
)  # fmt: skip
def test_a_head_may_carry_its_unit(written, style, capitals, with_rig, frame, tmp_path, lead_screw):
    name, unit = written
    full = frame.assign(i_m=frame.u / 12)
    factor = units.UNITS[unit].factor
    head = style.format(name.upper() if capitals else name, unit)
    file = tmp_path / "seen.csv"
    full.assign(**{name: full[name] / factor}).rename(columns={name: head}).to_csv(file, index=False)
    rig = lead_screw if with_rig else None
    recording = read_recording(file, rig=rig, trust_units=True)
    assert np.allclose(recording.channels[name], full[name], rtol=1e-12, atol=0)
    assert recording.assumed_units[name] == f"{unit} (header)"


@RELAXED
@given(label=st.text(alphabet="qtuxθ_ [](){}mµ°/0139\"';-", max_size=14))
def test_a_strange_head_gives_a_recording_or_one_line(label, frame, tmp_path):
    table = frame[:200].assign(extra=1.0).rename(columns={"extra": label})
    file = tmp_path / "seen.parquet"
    if not table.columns.is_unique:
        return
    table.to_parquet(file, index=False)
    try:
        assert read_recording(file).samples == 200
    except UserError as error:
        assert "\n" not in str(error)  # noqa: PT017
