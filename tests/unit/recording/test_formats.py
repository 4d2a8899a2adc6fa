"""Every format gives the same channels; nothing but a UserError comes out of garbage."""

import gzip
import io
import json

import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

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
        scaled = frame.assign(t=frame.t * 1e3, q3=frame.q3 * 1e3)
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
    for name, factor in (("r", 1e-3), ("u", 1.0), ("theta_m", 1.0), ("q3", 1e-3)):
        assert np.allclose(recording.channels[name], factor * frame[name], rtol=1e-9, atol=1e-13)
    assert recording.notes == []


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
    assert np.allclose(read_recording(tmp_path / "seen.mat").channels["q3"], 1e-3 * frame.q3)


def test_columns_of_a_trace_are_known_by_their_suffixes(frame, save):
    trace = frame.rename(columns={"t": "t_s", "r": "r_mm", "u": "u_v", "theta_m": "theta_m_deg", "q3": "q3 [m]"})
    trace["i_m_a"], trace["gap_deg"] = trace["u_v"] / 12, 1.0
    recording = read_recording(save(trace))
    assert recording.units["i_m"] == "A"
    assert np.allclose(recording.channels["q3"], frame.q3)
    assert np.allclose(recording.channels["theta_m"], np.radians(frame.theta_m))
    assert recording.notes == ["Columns that are no channels of the rig are not used: gap_deg."]


def test_in_open_loop_the_reference_is_the_command(frame, save):
    recording = read_recording(save(frame.assign(r=frame.u)))
    assert recording.units["r"] == "V"
    assert np.array_equal(recording.channels["r"], frame.u)


def test_a_column_in_a_unit_of_another_kind_is_refused(frame, save, refusal):
    assert "column q3_deg is in rad" in refusal(save(frame.rename(columns={"q3": "q3_deg"})))


def test_two_columns_for_one_channel_are_refused(frame, save, refusal):
    assert "two columns for q3" in refusal(save(frame.assign(q3_mm=frame.q3)))


def test_without_a_header_the_columns_have_to_be_named(frame, tmp_path, refusal):
    frame.to_csv(tmp_path / "x.csv", index=False, header=False)
    assert "has no header" in refusal(tmp_path / "x.csv")


def test_text_among_the_numbers_is_located(frame, save, refusal):
    spoilt = frame.astype({"q3": object})
    spoilt.loc[41, "q3"] = "over"
    line = refusal(save(spoilt))
    assert "column q3 holds text ('over') in row 42" in line


def test_lines_of_different_lengths_are_refused(frame, save, refusal):
    file = save(frame)
    lines = file.read_text().split("\n")
    lines[7] += ",1,2,3"
    file.write_text("\n".join(lines))
    assert "lines of different lengths" in refusal(file)


@pytest.mark.parametrize("kind", ["parquet", "mat", "npz", "json_columns"])
def test_a_file_cut_short_is_refused(kind, frame, tmp_path, refusal):
    content = as_bytes(kind, frame)
    (tmp_path / f"seen.{kind}").write_bytes(content[: len(content) // 2])
    assert "damaged" in refusal(tmp_path / f"seen.{kind}")


def test_a_gzip_cut_short_is_refused(frame, tmp_path, refusal):
    content = gzip.compress(as_bytes("csv", frame))
    (tmp_path / "seen.csv.gz").write_bytes(content[: len(content) // 2])
    assert "its gzip ends too early" in refusal(tmp_path / "seen.csv.gz")


@pytest.mark.parametrize("content", [b"", b"   \n\n", gzip.compress(b"", mtime=0)])
def test_an_empty_file_is_refused(content, tmp_path, refusal):
    (tmp_path / "x.csv").write_bytes(content)
    assert "is empty" in refusal(tmp_path / "x.csv")


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


@RELAXED
@given(
    kind=st.sampled_from(["csv", "parquet"]),
    samples=st.integers(100, 300),
    step_s=st.sampled_from([1e-4, 2.5e-4, 1e-3, 1 / 1024, 0.01]),
    scale=st.floats(1e-9, 1e6),
    seed=st.integers(0, 2**32 - 1),
)
def test_what_a_run_writes_comes_back(kind, samples, step_s, scale, seed, tmp_path):
    noise = np.random.default_rng(seed).standard_normal((3, samples)) * scale
    t = np.arange(samples) * step_s
    written = pd.DataFrame({"t": t, "r": noise[0], "u": noise[1], "q3": noise[2]})
    file = tmp_path / "seen.bin"
    file.write_bytes(as_bytes(kind, written))
    recording = read_recording(file)
    assert recording.samples == samples
    assert recording.sample_time_s == pytest.approx(step_s, rel=1e-9)
    assert np.allclose(recording.t_s, t, rtol=0, atol=1e-9 * step_s * samples)
    assert np.allclose(recording.channels["u"], noise[1], rtol=1e-12, atol=0)
    assert np.allclose(recording.channels["q3"], 1e-3 * noise[2], rtol=1e-12, atol=0)
