"""The engine: everything once, whatever happens to who does it, and however many do it."""

import threading
import time

import pytest
from campaigns import Note

from dtbacklash import files
from dtbacklash.campaign import engine
from dtbacklash.campaign.backends import Workers
from dtbacklash.campaign.jobs import taken
from dtbacklash.campaign.progress import _Lines, duration
from dtbacklash.errors import Failure
from dtbacklash.files import read_json

HERE, TWO = Workers(jobs=1), Workers(jobs=2)


def silent(stage, ended, total):
    pass


def notes(folder, *hows, wait_s=0.0):
    return [Note(folder / f"{j}.json", how, wait_s) for j, how in enumerate(hows)]


def outcomes(jobs):
    return [read_json(job.record).get("how") for job in jobs]


def hidden(folder):
    return [path.name for path in folder.rglob(".*")]


@pytest.mark.parametrize("by", [HERE, TWO], ids=["here", "loky"])
def test_every_job_is_done_once_and_never_again(tmp_path, by):
    jobs, told = notes(tmp_path, "", "", "fails", ""), []
    engine.complete(jobs, by, lambda *words: told.append(words), "noting")
    assert outcomes(jobs) == ["done", "done", "failed", "done"]
    assert told[0] == ("noting", 0, 4)
    assert told[-1] == ("noting", 4, 4)
    engine.complete(jobs, by, silent)
    assert [job.tries for job in jobs] == [1, 1, 2, 1]  # what failed is tried again by the next command
    assert hidden(tmp_path) == []


def test_what_a_dead_worker_leaves_is_tried_once_more_alone(tmp_path):
    jobs = notes(tmp_path, "", "killed once", "", "", "")
    killed = Note(tmp_path / "killed.json", "killed", wait_s=1.0)  # long after the other, which is tried twice so
    engine.complete([*jobs, killed], TWO, silent)
    assert outcomes(jobs) == ["done"] * 5
    assert outcomes([killed]) == ["died of TerminatedWorkerError"]
    assert killed.tries <= 2
    assert hidden(tmp_path) == []


def test_ctrl_c_says_what_stays(tmp_path):
    jobs = notes(tmp_path, "", "", "interrupted", "")
    with pytest.raises(KeyboardInterrupt, match=r"^: 2 of 4 notes are done and stay; the same command does the rest$"):
        engine.complete(jobs, HERE, silent, noun="notes")
    assert outcomes(jobs) == ["done", "done", None, None]
    assert hidden(tmp_path) == []


@pytest.mark.parametrize("by", [HERE, TWO], ids=["here", "loky"])
def test_a_full_disk_ends_it_and_says_what_stays(tmp_path, by):
    jobs = notes(tmp_path, "", "full")
    with pytest.raises(Failure, match=r"the disk is full; [01] of 2 jobs are done and stay") as caught:
        engine.complete(jobs, by, silent)
    assert caught.value.exit_code == 1


def test_two_campaigns_at_once_share_the_jobs(tmp_path):
    jobs = notes(tmp_path, *[""] * 12, wait_s=0.05)
    told = [[], []]
    both = [
        threading.Thread(target=engine.complete, args=(jobs, HERE, lambda *words, mine=mine: mine.append(words)))
        for mine in told
    ]
    for one in both:
        one.start()
    for one in both:
        one.join(60)
    assert outcomes(jobs) == ["done"] * 12
    assert [job.tries for job in jobs] == [1] * 12
    assert [mine[-1] for mine in told] == [("", 12, 12)] * 2
    assert hidden(tmp_path) == []


def test_a_job_that_another_process_gives_up_is_done_here(tmp_path):
    (job,) = notes(tmp_path, "")
    held = threading.Event()

    def other():
        with files.claim(job.lock) as mine:
            assert mine
            held.set()
            time.sleep(3 * engine.POLL_S)

    thread = threading.Thread(target=other)
    thread.start()
    held.wait(10)
    assert taken(job)
    engine.complete([job], HERE, silent)
    thread.join(10)
    assert outcomes([job]) == ["done"]


def test_the_lock_of_a_process_that_was_killed_holds_nobody_up(tmp_path):
    (job,) = notes(tmp_path, "")
    job.lock.write_text("")
    job.record.with_name(".0.json.12345678.partial").write_text("half")
    assert not taken(job)
    engine.complete([job], HERE, silent)
    assert outcomes([job]) == ["done"]
    assert hidden(tmp_path) == []


def test_lines_now_and_then_with_the_time_left(capsys, monkeypatch):
    clock = iter([0.0, 1.0, 10.0, 20.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    tell = _Lines("cases")
    for ended in (10, 11, 12, 30):
        tell("asking", ended, 30)
    assert capsys.readouterr().err.splitlines() == [
        "asking: 10 of 30 cases finished",
        "asking: 12 of 30 cases finished, about 2 min left",  # 11 came too soon after the line before
        "asking: 30 of 30 cases finished",
    ]
    assert [duration(s) for s in (40, 400, 40_000)] == ["40 s", "7 min", "11.1 h"]
