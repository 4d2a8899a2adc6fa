"""Where recordings come from: paths, mappings, folders, downloads."""

import gzip
import hashlib
import io
import urllib.error
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dtbacklash.errors import UserError
from dtbacklash.recording import load_mapping, mapping_names, read_pair, read_recording
from dtbacklash.recording.command import refined
from dtbacklash.recording.fetch import fetch
from dtbacklash.recording.locate import cache_folder, find
from dtbacklash.recording.units import PLAIN, UNITS

MAPPING = """
title: a test
rig: lead_screw
sample_time_s: 0.001
file: log.csv
files: {log.csv: {url: "https://example.org/log.zip", member: deep/log.csv, sha256: %s}}
channels:
  u: {column: Volts, unit: mV}
  q3: {column: pos, scale: 0.5, si_unit: m}
parts: {train: [0, 300], test: [300, 450]}
"""


def content() -> bytes:
    k = np.arange(500)
    rows = [f"{1000 * np.sin(0.1 * i)},{np.cos(0.1 * i)}" for i in k]
    return ("volts,pos\n" + "\n".join(rows)).encode()


@pytest.fixture
def mine(tmp_path):
    """A mapping of the user's own, in conf/recording."""
    (tmp_path / "conf" / "recording").mkdir(parents=True)
    text = MAPPING % hashlib.sha256(content()).hexdigest()
    (tmp_path / "conf" / "recording" / "mine.yaml").write_text(text)
    return load_mapping("mine")


def test_plain_units_are_those_that_a_run_writes():
    from dtbacklash.scenario import TRACE_UNITS

    for unit, (_, factor) in TRACE_UNITS.items():
        assert UNITS[PLAIN[unit]] == (unit, pytest.approx(1 / factor))


def test_the_packaged_mappings_are_whole():
    assert {"emps", "silverbox", "brfd"} <= set(mapping_names())
    assert "none" not in mapping_names()
    for name in ("emps", "silverbox", "brfd"):
        mapping = load_mapping(name)
        assert mapping.name == name
        assert mapping.file in mapping.files
        assert all([mapping.title, mapping.rig, mapping.citation, mapping.licence, mapping.page, mapping.channels])


def test_places_in_their_order(mine, tmp_path, monkeypatch):
    with pytest.raises(UserError, match=r"recording=mine: log.csv is not here; run `dtb recordings fetch mine`"):
        read_recording("mine")
    cached = cache_folder() / "mine" / "log.csv"
    cached.parent.mkdir(parents=True)
    cached.write_bytes(content())
    assert find(mine, "log.csv") == cached
    folder = tmp_path / "folder"
    (folder / "mine").mkdir(parents=True)
    monkeypatch.setenv("DTB_RECORDINGS", str(folder))
    assert find(mine, "log.csv") == cached
    (folder / "mine" / "log.csv.gz").write_bytes(gzip.compress(content()))
    assert read_recording("mine").source == folder / "mine" / "log.csv.gz"
    (folder / "log.csv").write_bytes(content())
    assert read_recording("mine").source == folder / "log.csv"
    (tmp_path / "own.csv").write_bytes(content())
    assert read_recording("mine", path="own.csv").source == Path("own.csv")


def test_a_mapping_gives_channels_parts_and_units(mine, tmp_path):
    (tmp_path / "own.csv").write_bytes(content())
    train = read_recording("mine", path="own.csv")
    assert (train.part, train.samples, train.rig, train.notes) == ("train", 300, "lead_screw", [])
    assert np.allclose(train.channels["u"], np.sin(0.1 * np.arange(300)))
    assert np.allclose(train.channels["q3"], 0.5 * np.cos(0.1 * np.arange(300)))
    test = read_recording("mine:test", path="own.csv")
    assert np.allclose(test.channels["u"], np.sin(0.1 * np.arange(300, 450)))
    assert read_recording("own.csv", "mine", part="").samples == 500
    one, other = read_pair("mine", "own.csv", path="own.csv")
    assert (one.samples, other.samples) == (300, 500)
    one, other = read_pair("mine", share=0.4, path="own.csv")
    assert (one.samples, other.samples) == (180, 120)


def test_what_differs_from_the_published_file_is_noted(mine, tmp_path):
    (tmp_path / "log.csv").write_bytes(content().replace(b"0.0,", b"0.1,", 1))
    notes = read_recording("mine", path="log.csv").notes
    assert notes == ["log.csv differs from the published file (SHA-256)."]


@pytest.mark.parametrize(
    ("source", "options", "said"),
    [
        ("no/such.csv", {}, "recording=no/such.csv: no such file; give the path of a file or one of brfd, emps"),
        ("", {}, "recording=null: give the path"),
        (".", {}, "recording=.: is a folder"),
        ("mine", {"path": "nope.csv"}, "recording.path=nope.csv: no such file; give the path of a file or one of log"),
        ("mine", {"path": "."}, "recording.path=.: is a folder"),
        ("mine", {"path": "log.csv"}, "recording.path=log.csv: is not here"),
        ("mine:best", {}, "recording=mine:best: choose one of train, test"),
        ("emps:train", {}, "emps has no parts"),
        ("other.yaml", {}, "recording=other.yaml: choose one of brfd"),
        ("plain.csv", {"path": "x.csv"}, "recording.path=x.csv: belongs to a mapping"),
        ("mine", {"path": "plain.csv"}, "has no column Volts, which the mapping mine needs; it has a, b"),
    ],
)
def test_what_leads_nowhere_is_one_line(source, options, said, mine, tmp_path, refusal):
    (tmp_path / "plain.csv").write_text("a,b\n" + "1,2\n" * 500)
    assert said in refusal(source, **options)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("unit: mV", "unit: furlong", "recording.channels.u.unit=furlong: choose one of s, ms"),
        ("scale: 0.5", "scale: 0", "recording.channels.q3.scale=0: must be a number other than 0"),
        ("[0, 300]", "[300, 0]", "recording.parts.train=[300, 0]: must be [first row"),
        ("[300, 450]", "[300, 501]", "has 500 rows, and the part test ends at row 501"),
        ("rig:", "rigg:", "recording.rigg=lead_screw: no such key"),
        ("sample_time_s: 0.001", "sample_time_s: -1", "must be positive"),
        ("https:", "http:", "must start with https://"),
        ("title: a test", "command: smooth", "choose one of held, band_limited"),
        ("title: a test", "title: [", "not valid YAML"),
    ],
)
def test_a_mistake_in_a_mapping_is_one_line(old, new, said, mine, tmp_path):
    file = tmp_path / "conf" / "recording" / "mine.yaml"
    file.write_text(file.read_text().replace(old, new))
    (tmp_path / "own.csv").write_bytes(content())
    with pytest.raises(UserError) as caught:
        read_recording("mine:test", path="own.csv")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_band_limited_command_is_interpolated(mine, tmp_path):
    (tmp_path / "own.csv").write_bytes(content())
    recording = read_recording("mine", path="own.csv")
    assert refined(recording)[1] == 1
    assert np.array_equal(refined(recording)[0], recording.channels["u"][:-1])
    file = tmp_path / "conf" / "recording" / "mine.yaml"
    file.write_text(file.read_text() + "command: band_limited\n")
    fine, parts = refined(read_recording("mine", path="own.csv"))
    assert len(fine) == 4 * 299
    middle = (np.arange(len(fine)) + 0.5) / parts
    assert np.abs(fine - np.sin(0.1 * middle))[100:-100].max() < 1e-3


# --- downloads


class Answer(io.BytesIO):
    """What urlopen gives."""

    @property
    def headers(self):
        return {"Content-Length": str(len(self.getvalue()))}


def serve(monkeypatch, body: bytes) -> list[str]:
    """Answer every request with ``body``; returns the list of what was asked for."""
    asked = []

    def urlopen(request, timeout):
        asked.append(request.full_url)
        return Answer(body)

    monkeypatch.setattr("urllib.request.urlopen", urlopen)
    return asked


def zipped() -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("readme.txt", "hello")
        archive.writestr("deep/log.csv", content())
    return out.getvalue()


@pytest.mark.parametrize("body", [zipped(), content(), gzip.compress(content())])
def test_a_download_is_unpacked_checked_and_used(body, mine, monkeypatch):
    asked, seen = serve(monkeypatch, body), []
    file = mine.files["log.csv"]
    target = fetch(mine, file, seen.append)
    assert target.read_bytes() == content()
    assert seen[-1] == 1.0
    assert read_recording("mine").samples == 300
    assert fetch(mine, file) == target
    assert asked == ["https://example.org/log.zip"]  # once
    assert [path.name for path in target.parent.iterdir()] == ["log.csv"]


@pytest.mark.parametrize("body", [b"", b"<html>sign in</html>", zipped()[:-40], content() + b"\n", zipped()[:9]])
def test_anything_else_is_refused_and_nothing_is_left(body, mine, monkeypatch):
    serve(monkeypatch, body)
    with pytest.raises(UserError, match=r"SHA-256 differs.*; get log\.csv"):
        fetch(mine, mine.files["log.csv"])
    assert find(mine, "log.csv") is None


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (urllib.error.URLError("no route"), "the source cannot be reached"),
        (urllib.error.HTTPError("https://example.org", 404, "gone", None, None), "the source answers 404"),  # type: ignore[arg-type]
        (TimeoutError("timed out"), "the download failed (timed out)"),
    ],
)
def test_without_a_network_it_says_where_to_put_the_file(error, said, mine, monkeypatch):
    def urlopen(request, timeout):
        raise error

    monkeypatch.setattr("urllib.request.urlopen", urlopen)
    with pytest.raises(UserError) as caught:
        fetch(mine, mine.files["log.csv"])
    line = str(caught.value)
    assert said in line
    assert f"put it into {cache_folder() / 'mine'} or into $DTB_RECORDINGS" in line


def test_a_cache_that_cannot_be_written_is_one_line(mine, monkeypatch, tmp_path):
    serve(monkeypatch, content())
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(UserError, match="cannot be written"):
        fetch(mine, mine.files["log.csv"])
