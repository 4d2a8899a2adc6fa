"""What is written is complete or not there at all; JSON."""

import errno
import json
import math
import os
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest

from dtbacklash import files
from dtbacklash.errors import Failure, UserError
from dtbacklash.files import run_folder


def full_disk(*arguments, **options):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def listing(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def write_run(folder, text="new"):
    with run_folder(folder) as scratch:
        (scratch / "summary.json").write_text(text)
        (scratch / "figures").mkdir()
        (scratch / "figures" / "a.png").write_text("png")


def test_nothing_is_seen_before_the_end_and_nothing_hidden_after_it(tmp_path):
    target = tmp_path / "day" / "run"
    with run_folder(target) as scratch:
        (scratch / "summary.json").write_text("{}")
        assert not target.exists()
        assert scratch.name.startswith(".")
    assert listing(tmp_path) == ["day", "day/run", "day/run/summary.json"]


@pytest.mark.parametrize("what", [RuntimeError("bug"), KeyboardInterrupt(), UserError("a", 1, "b"), SystemExit(3)])
def test_whatever_goes_wrong_nothing_is_left(tmp_path, what):
    with pytest.raises(type(what)), run_folder(tmp_path / "day" / "run") as scratch:
        (scratch / "summary.json").write_text("{}")
        raise what
    assert listing(tmp_path) == []


def test_folders_that_hydra_made_for_a_failed_run_go_too_but_not_older_ones(tmp_path):
    (tmp_path / "outputs").mkdir()
    target = tmp_path / "outputs" / "day" / "run"
    files.note_missing(target)
    target.mkdir(parents=True)
    with pytest.raises(RuntimeError), run_folder(target):
        raise RuntimeError
    assert listing(tmp_path) == ["outputs"]


def test_an_empty_folder_is_filled_and_an_earlier_run_is_replaced_as_a_whole(tmp_path):
    (tmp_path / "run").mkdir()
    write_run(tmp_path / "run", "old")
    (tmp_path / "run" / "metrics.csv").write_text("old")
    write_run(tmp_path / "run", "new")
    assert listing(tmp_path) == ["run", "run/figures", "run/figures/a.png", "run/summary.json"]
    assert (tmp_path / "run" / "summary.json").read_text() == "new"


def test_an_earlier_run_and_its_neighbours_survive_a_failing_one(tmp_path):
    write_run(tmp_path / "day" / "run", "old")
    for name in ("run", "second"):
        with pytest.raises(ConnectionError), run_folder(tmp_path / "day" / name) as scratch:
            (scratch / "summary.json").write_text("new")
            raise ConnectionRefusedError(errno.ECONNREFUSED, "refused")  # not about writing: it is not hidden
    assert (tmp_path / "day" / "run" / "summary.json").read_text() == "old"
    assert not (tmp_path / "day" / "second").exists()


def test_an_earlier_run_survives_a_failing_exchange(tmp_path, monkeypatch):
    write_run(tmp_path / "run", "old")
    rename = files.Path.rename

    def fails_the_second_time(self, target):
        if self.name.endswith(files.PARTIAL) and not target.exists():
            raise OSError(errno.EIO, "Input/output error")
        return rename(self, target)

    monkeypatch.setattr(files.Path, "rename", fails_the_second_time)
    with pytest.raises(UserError, match="input/output error"):
        write_run(tmp_path / "run", "new")
    assert (tmp_path / "run" / "summary.json").read_text() == "old"
    assert listing(tmp_path) == ["run", "run/figures", "run/figures/a.png", "run/summary.json"]


@pytest.mark.parametrize(
    ("there", "target", "said"),
    [
        (["thesis.tex"], "", r"^hydra\.run\.dir=.*not an earlier run"),
        (["summary.json", "thesis.tex"], "", r"^hydra\.run\.dir=.*not an earlier run"),
        (["run"], "run", "is a file"), (["file"], "file/run", "not a directory"), ([], "", "below the current one"),
    ],
)  # fmt: skip
def test_a_place_with_something_else_is_refused(tmp_path, monkeypatch, there, target, said):
    for name in there:
        (tmp_path / name).write_text("precious")
    if not there:
        monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=said):
        write_run(tmp_path / target)
    assert listing(tmp_path) == sorted(there)


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path):
    with pytest.raises(Failure, match="the disk is full") as caught, run_folder(tmp_path / "run") as scratch:
        (scratch / "trace.parquet").write_text("half of it")
        full_disk()
    assert caught.value.exit_code == 1
    assert listing(tmp_path) == []


def test_while_a_folder_is_exchanged_another_one_is_refused(tmp_path, monkeypatch):
    write_run(tmp_path / "run", "old")
    rename, refused = files.Path.rename, []

    def disturbed(self, target):
        result = rename(self, target)
        if str(target).endswith(".old"):
            with pytest.raises(UserError, match="another run is being written there"):  # while the place is empty
                write_run(tmp_path / "run", "another's")
            refused.append(target)
        return result

    monkeypatch.setattr(files.Path, "rename", disturbed)
    write_run(tmp_path / "run", "new")
    assert len(refused) == 1
    assert (tmp_path / "run" / "summary.json").read_text() == "new"
    assert listing(tmp_path) == ["run", "run/figures", "run/figures/a.png", "run/summary.json"]


def test_of_two_runs_that_write_one_folder_at_once_the_second_is_refused(tmp_path):
    (tmp_path / ".run.0123abcd.partial").mkdir()  # of a run that was killed
    with run_folder(tmp_path / "run") as scratch:
        with pytest.raises(UserError, match="another run is being written there"), run_folder(tmp_path / "run"):
            pass
        (scratch / "summary.json").write_text("first")
    write_run(tmp_path / "run", "second")
    assert (tmp_path / "run" / "summary.json").read_text() == "second"


def test_a_file_is_whole_or_as_it_was(tmp_path, monkeypatch):
    target = tmp_path / "new" / "a.json"
    files.write_json(target, {"old": 1})
    monkeypatch.setattr(files.Path, "replace", full_disk)
    with pytest.raises(Failure, match=r"^cache=here: cannot be written: the disk is full$"):
        files.write_json(target, {"new": 2}, "cache", "here")
    assert files.read_json(target) == {"old": 1}
    assert listing(tmp_path) == ["new", "new/a.json"]


def test_a_place_that_cannot_be_written_to_is_the_users_choice(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written: file exists") as caught:
        files.write_text(tmp_path / "file" / "a.txt", "a")
    assert caught.value.exit_code == 2
    with pytest.raises(UserError, match="no such file"), files.written(tmp_path / "no" / "a", parents=False) as scratch:
        scratch.write_text("a")


def test_a_folder_is_written_at_once_and_of_two_that_write_once_the_first_holds(tmp_path):
    with files.written(tmp_path / "case") as scratch:
        scratch.mkdir()
        (scratch / "a").write_text("a")
        assert not (tmp_path / "case").exists()
    for content in (b"first", b"second"):
        files.write_once(tmp_path / "key", content)
    assert (tmp_path / "key").read_bytes() == b"first"
    assert (tmp_path / "key").stat().st_mode & 0o777 == 0o600
    assert listing(tmp_path) == ["case", "case/a", "key"]


def test_leftovers_are_those_of_this_name_alone(tmp_path):
    for name in ("seed=1", "seed=1.5", "seed=10", "seed=[1]", "ä" * 100):
        files.hidden_sibling(tmp_path / name).write_text("half")
    for name in ("seed=1", "seed=[1]", "ä" * 100):
        assert len(files.leftovers(tmp_path / name)) == 1
    assert files.leftovers(tmp_path / "seed=2") == files.leftovers(tmp_path / "nowhere" / "a") == []


def test_json_of_what_json_does_not_know():
    @dataclass
    class Point:
        x: float
        y: object

    value = {
        "a": np.float64(1.5), "b": [np.int64(2), math.nan, math.inf], "c": (np.bool_(True), None), "d": np.arange(2),
        "e": {2}, "f": Point(1.0, np.array([math.nan])), "ä": "Ω",
    }  # fmt: skip
    expected = {
        "a": 1.5, "b": [2, None, None], "c": [True, None], "d": [0, 1], "e": [2], "f": {"x": 1.0, "y": [None]},
        "ä": "Ω",
    }  # fmt: skip
    text = files.json_text(value)
    assert json.loads(text) == expected
    assert '"ä": "Ω"' in text


def test_a_path_that_is_no_text_can_be_written_and_read(tmp_path):
    name = os.fsdecode(b"b\xff.csv")
    files.write_json(tmp_path / "a.json", {"file": name})
    assert files.read_json(tmp_path / "a.json") == {"file": name}


@pytest.mark.parametrize("content", [b"", b"[1]", b"{", b"\xff", None])
def test_what_is_no_document_is_an_empty_one(tmp_path, content):
    if content is not None:
        (tmp_path / "a.json").write_bytes(content)
    assert files.read_json(tmp_path / "a.json") == {}


def test_a_table_comes_back_from_parquet_to_the_last_bit(tmp_path):
    values = np.random.default_rng(1).standard_normal(1000)
    table = pd.DataFrame({"t_s": np.arange(1000) / 3, "q3_mm": np.where(values > 2, np.nan, values)})
    files.write_parquet(tmp_path / "a.parquet", table)
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "a.parquet"), table, check_exact=True)
