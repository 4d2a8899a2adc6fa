"""Where recordings come from: paths, mappings, folders, downloads."""

import gzip
import hashlib
import io
import threading
import zipfile
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from dtbacklash.errors import UserError
from dtbacklash.recording import load_mapping, mapping_names, read_pair, read_recording, refined
from dtbacklash.recording.fetch import fetch
from dtbacklash.recording.locate import cache_folder, find

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


def test_the_packaged_mappings_are_whole():
    public = {"emps", "silverbox", "brfd", "disk", "anticogging"}
    assert public <= set(mapping_names())
    assert "none" not in mapping_names()
    for name in public:
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
        ("no/such.csv", {}, "recording=no/such.csv: no such file; give the path of a file or one of anticogging, brfd"),
        ("", {}, "recording=null: give the path"),
        (".", {}, "recording=.: is a folder"),
        ("mine", {"path": "nope.csv"}, "recording.path=nope.csv: no such file; give the path of a file or one of log"),
        ("mine", {"path": "."}, "recording.path=.: is a folder"),
        ("mine", {"path": "log.csv"}, "recording.path=log.csv: is not here"),
        ("mine:best", {}, "recording=mine:best: choose one of train, test"),
        ("disk:train", {}, "disk has no parts: write recording=disk"),
        ("other.yaml", {}, "recording=other.yaml: no such file: give the path of a mapping, or one of anticogging"),
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
        (
            "{train: [0, 300], test",
            "{on: [0, 300], test",
            "recording.parts.true=[0, 300]: YAML reads on, off, yes, no so",
        ),
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


OWN = """
rig: carriage.yaml
files: [slow.csv, fast.csv]
time: {column: Time, unit: ms}
channels:
  u: {column: AO 0, scale: 2.0}
  x1: {column: LVDT, scale: 5.0, offset: -12.5, unit: mm}
  x2: Laser [um]
parts: {train: [0, 300], test: [300, 500]}
"""


@pytest.fixture
def bench(tmp_path):
    """A folder with a mapping of one's own and two recordings: no checksum, no source."""
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "mine.yaml").write_text(OWN)
    k = np.arange(500)
    for name, speed in (("slow.csv", 0.05), ("fast.csv", 0.2)):
        rows = "\n".join(f"{i},{np.sin(speed * i)},{np.cos(speed * i)},{1e3 * np.cos(speed * i)}" for i in k)
        (tmp_path / "bench" / name).write_text(f"Time,AO 0,LVDT,Laser [um]\n{rows}\n")
    return tmp_path / "bench"


def test_a_mapping_of_ones_own_needs_no_checksum(bench):
    slow = read_recording("bench/mine.yaml:test")
    assert (slow.source, slow.rig, slow.samples) == (Path("bench/slow.csv"), "carriage.yaml", 200)
    k = np.arange(300, 500)
    assert np.allclose(slow.channels["u"], 2.0 * np.sin(0.05 * k))
    assert np.allclose(slow.channels["x1"], 1e-3 * (5.0 * np.cos(0.05 * k) - 12.5))
    assert np.allclose(slow.channels["x2"], 1e-3 * np.cos(0.05 * k))
    assert slow.assumed_units == {"t": "ms (mapping)", "u": "V (assumed)", "x1": "mm (mapping)", "x2": "um (header)"}
    assert slow.notes == ["Units: u in V (taken as SI, since nothing is said)."]
    fast = read_recording("bench/mine.yaml", path="fast.csv", part="")
    assert np.allclose(fast.channels["u"], 2.0 * np.sin(0.2 * np.arange(500)))
    given = read_recording("bench/mine.yaml", units={"x1": "um"})
    assert given.assumed_units["x1"] == "um (given)"
    one, other = read_pair("bench/mine.yaml", "fast.csv")
    assert (one.samples, other.samples) == (300, 500)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("scale: 2.0", "scale: [2]", "recording.channels.u.scale=[2]: must be a number"),
        ("offset: -12.5", "offset: .nan", "recording.channels.x1.offset=nan: must be a number"),
        ("[slow.csv, fast.csv]", "{slow.csv: {sha: 3}}", "must be a mapping with some of url, member, sha256"),
        ("[slow.csv, fast.csv]", "3", "must be a list of names"),
        ("[slow.csv, fast.csv]", "[gone.csv]", "gone.csv is not here; put it beside the mapping, into $DTB_RECORDINGS"),
        ("rig: carriage.yaml", "rig: [1]", "must be the name of a rig"),
        ("rig: carriage.yaml", "title: ${oc.env:HOME}", "${...} is not resolved in a file"),
        ("rig: carriage.yaml", "a: &a [x]\nb: &b [*a, *a]\nc: &c [*b, *b", "is not valid YAML"),
    ],
)
def test_a_mistake_in_a_mapping_of_ones_own_is_one_line(old, new, said, bench):
    file = bench / "mine.yaml"
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(UserError) as caught:
        read_recording("bench/mine.yaml")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


# --- downloads


@pytest.fixture
def serve():
    """Answer every request with one body; returns the address and the list of what was asked for."""
    servers = []

    def start(body: bytes, code: int = 200) -> tuple[str, list[str]]:
        asked = []

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                asked.append(self.path)
                self.send_response(code)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *arguments):
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}/log.zip", asked

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


def zipped() -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("readme.txt", "hello")
        archive.writestr("deep/log.csv", content())
    return out.getvalue()


@pytest.mark.parametrize("body", [zipped(), content(), gzip.compress(content())])
def test_a_download_is_unpacked_checked_and_used(body, mine, serve, capfd):
    url, asked = serve(body)
    seen, file = [], replace(mine.files["log.csv"], url=url)
    target = fetch(mine, file, seen.append)
    assert target.read_bytes() == content()
    assert seen[-1] == 1.0
    assert all(0.0 <= share <= 1.0 for share in seen)
    assert read_recording("mine").samples == 300
    assert fetch(mine, file) == target
    assert asked == ["/log.zip"]  # once
    assert [path.name for path in target.parent.iterdir()] == ["log.csv"]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("body", [b"", b"<html>sign in</html>", zipped()[:-40], content() + b"\n", zipped()[:9]])
def test_anything_else_is_refused_and_nothing_is_left(body, mine, serve):
    file = replace(mine.files["log.csv"], url=serve(body)[0])
    with pytest.raises(UserError, match=r"SHA-256 differs.*; get log\.csv"):
        fetch(mine, file)
    assert find(mine, "log.csv") is None


def test_a_source_that_answers_with_an_error_is_one_line(mine, serve):
    with pytest.raises(UserError, match="the source answers 404"):
        fetch(mine, replace(mine.files["log.csv"], url=serve(b"gone", 404)[0]))


def test_without_a_network_it_says_where_to_put_the_file(mine):
    file = replace(mine.files["log.csv"], url="http://127.0.0.1:9/log.zip")
    with pytest.raises(UserError) as caught:
        fetch(mine, file)
    line = str(caught.value)
    assert "the source cannot be reached" in line
    assert f"put it into {cache_folder() / 'mine'} or into $DTB_RECORDINGS" in line
    assert not cache_folder().exists()


def test_a_file_without_a_source_cannot_be_fetched(mine):
    with pytest.raises(UserError, match=r"names no public source of log\.csv"):
        fetch(mine, replace(mine.files["log.csv"], url=""))


def test_a_cache_that_cannot_be_written_is_one_line(mine, serve, monkeypatch, tmp_path):
    file = replace(mine.files["log.csv"], url=serve(content())[0])
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(UserError, match="cannot be written"):
        fetch(mine, file)
