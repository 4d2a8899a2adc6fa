"""A folder of results is complete or not there at all."""

import errno
import os

import pytest

from dtbacklash import runfolder
from dtbacklash.errors import UserError
from dtbacklash.runfolder import run_folder


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


def test_an_empty_folder_made_by_somebody_else_is_filled(tmp_path):
    target = tmp_path / "run"
    target.mkdir()
    write_run(target)
    assert (target / "summary.json").read_text() == "new"


@pytest.mark.parametrize("what", [RuntimeError("bug"), KeyboardInterrupt(), UserError("a", 1, "b"), SystemExit(3)])
def test_whatever_goes_wrong_nothing_is_left(tmp_path, what):
    with pytest.raises(type(what)), run_folder(tmp_path / "day" / "run") as scratch:
        (scratch / "summary.json").write_text("{}")
        raise what
    assert listing(tmp_path) == []


def test_folders_that_hydra_made_for_a_failed_run_go_too_but_not_older_ones(tmp_path):
    (tmp_path / "outputs").mkdir()
    target = tmp_path / "outputs" / "day" / "run"
    runfolder.note_missing(target)
    target.mkdir(parents=True)
    with pytest.raises(RuntimeError), run_folder(target):
        raise RuntimeError
    assert listing(tmp_path) == ["outputs"]


def test_the_neighbours_of_a_failed_run_stay(tmp_path):
    write_run(tmp_path / "day" / "first")
    with pytest.raises(RuntimeError), run_folder(tmp_path / "day" / "second"):
        raise RuntimeError
    assert "day/first/summary.json" in listing(tmp_path)


def test_an_earlier_run_is_replaced_as_a_whole(tmp_path):
    write_run(tmp_path / "run", "old")
    (tmp_path / "run" / "metrics.csv").write_text("old")
    write_run(tmp_path / "run", "new")
    assert listing(tmp_path) == ["run", "run/figures", "run/figures/a.png", "run/summary.json"]
    assert (tmp_path / "run" / "summary.json").read_text() == "new"


def test_an_earlier_run_survives_a_failing_one(tmp_path):
    write_run(tmp_path / "run", "old")
    with pytest.raises(RuntimeError), run_folder(tmp_path / "run") as scratch:
        (scratch / "summary.json").write_text("new")
        raise RuntimeError
    assert (tmp_path / "run" / "summary.json").read_text() == "old"


def test_an_earlier_run_survives_a_failing_exchange(tmp_path, monkeypatch):
    write_run(tmp_path / "run", "old")
    rename = runfolder.Path.rename

    def fails_the_second_time(self, target):
        if self.name.endswith(runfolder.PARTIAL) and not target.exists():
            raise OSError(errno.EIO, "Input/output error")
        return rename(self, target)

    monkeypatch.setattr(runfolder.Path, "rename", fails_the_second_time)
    with pytest.raises(UserError, match="input/output error"):
        write_run(tmp_path / "run", "new")
    assert (tmp_path / "run" / "summary.json").read_text() == "old"
    assert listing(tmp_path) == ["run", "run/figures", "run/figures/a.png", "run/summary.json"]


@pytest.mark.parametrize("content", [["thesis.tex"], ["summary.json", "thesis.tex"]])
def test_a_folder_with_other_content_is_refused(tmp_path, content):
    for name in content:
        (tmp_path / name).write_text("precious")
    with pytest.raises(UserError, match=r"^hydra\.run\.dir=.*not an earlier run"):
        write_run(tmp_path)
    assert listing(tmp_path) == sorted(content)


def test_a_file_is_refused(tmp_path):
    (tmp_path / "run").write_text("precious")
    with pytest.raises(UserError, match="is a file"):
        write_run(tmp_path / "run")


def test_the_current_folder_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match="below the current one"):
        write_run(tmp_path)


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path):
    with pytest.raises(UserError, match="the disk is full"), run_folder(tmp_path / "run") as scratch:
        (scratch / "trace.parquet").write_text("half of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert listing(tmp_path) == []


def test_an_error_that_is_not_about_writing_is_not_hidden(tmp_path):
    with pytest.raises(ConnectionError), run_folder(tmp_path / "run"):
        raise ConnectionRefusedError(errno.ECONNREFUSED, "refused")


def test_a_place_below_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="not a directory"):
        write_run(tmp_path / "file" / "run")
