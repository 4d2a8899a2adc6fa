"""The engine of every campaign: do what is missing, once, whatever happens to who does it."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from dtbacklash.campaign.jobs import Job, directing, taken
from dtbacklash.errors import Failure, UserError

log = logging.getLogger("dtbacklash.campaign")

#: (stage, jobs that have ended, jobs in all)
Tell = Callable[[str, int, int], None]

POLL_S = 0.25
#: looking takes at most this share of the time
LOOK_SHARE = 0.05
#: a job of which nothing comes back, with no reason given, is tried this often
TRIES = 5


class Backend(Protocol):
    """Who does the work."""

    def do(self, jobs: Sequence[Job]) -> None:
        """Have :func:`.jobs.perform` called for each job once, in any order and anywhere.

        Raises UserError: it cannot work at all. Exception: what a worker died of.
        """

    def alone(self) -> Backend:
        """The same for one job, in a process that may die."""


def complete(jobs: Sequence[Job], backend: Backend, tell: Tell, stage: str = "", noun: str = "jobs") -> None:
    """See to it that every job has ended. What is done already is not done again.

    Other processes may work on the same jobs, with the same call: they share the work. Where a worker dies, each job
    that has not ended is tried once more, alone.

    tell : is told the stage and how many jobs have ended, of how many.
    noun : what the jobs are called.

    Raises KeyboardInterrupt: finished jobs stay; says how many. UserError: the backend or a job cannot work at all.
    Failure: the disk is full; finished jobs stay.
    """
    before = {job.record: _stamp(job.record) for job in jobs}  # first: what ends from here on, by whomever, is news
    todo = [job for job in jobs if not job.done()]
    tell(stage, len(jobs) - len(todo), len(jobs))
    if not todo:
        return

    def ended(job: Job) -> bool:
        return _stamp(job.record) != before[job.record]

    _tidy(todo)
    try:
        with directing(), _watched(todo, ended, lambda count: tell(stage, len(jobs) - len(todo) + count, len(jobs))):
            _all_at_once(todo, backend)
            for job in todo:
                _see_to(job, backend, ended)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f": {what_stays(jobs, noun)}") from None
    except Failure as error:
        raise Failure(error.key, error.value, f"{error.allowed}; {what_stays(jobs, noun)}") from error
    finally:
        _tidy(todo)


def what_stays(jobs: Sequence[Job], noun: str) -> str:
    """What to say of a campaign that has been stopped."""
    return f"{sum(job.done() for job in jobs)} of {len(jobs)} {noun} are done and stay; the same command does the rest"


def _all_at_once(jobs: list[Job], backend: Backend) -> None:
    try:
        backend.do(jobs)
    except UserError:
        raise
    except Exception as error:  # a job records what it fails by: this is the backend's
        why = next(iter(str(error).splitlines()), type(error).__name__)
        log.warning("a worker died (%s): the unfinished jobs are tried once more, one by one", why)


def _see_to(job: Job, backend: Backend, ended: Callable[[Job], bool]) -> None:
    """Wait for a job while another process does it; else try it once more, alone."""
    for _ in range(TRIES):
        while not ended(job) and taken(job):
            time.sleep(POLL_S)
        if ended(job):
            return
        try:
            backend.alone().do([job])
        except UserError:
            raise
        except Exception as error:
            if not ended(job):
                job.died(error)
            return
    if not ended(job):
        job.died(None)


@contextmanager
def _watched(jobs: list[Job], ended: Callable[[Job], bool], tell: Callable[[int], None]) -> Iterator[None]:
    """Tell how many jobs have ended, by their records, whoever does them and wherever."""
    stop = threading.Event()

    def look() -> None:
        left, last, pause = jobs, False, POLL_S
        while not last:
            last = stop.wait(pause)  # it looks once more before it ends
            begin = time.perf_counter()
            still = [job for job in left if not ended(job)]
            pause = max(POLL_S, (time.perf_counter() - begin) / LOOK_SHARE)
            if len(still) != len(left):
                left = still
                tell(len(jobs) - len(left))

    watcher = threading.Thread(target=look, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        stop.set()
        watcher.join()


def _stamp(path: Path) -> tuple[int, int, int] | None:
    """What changes when a file or a folder is replaced as a whole."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ino, found.st_size


def _tidy(jobs: Sequence[Job]) -> None:
    """Clear up behind workers that were killed: their locks are still there, and nobody holds them."""
    for job in jobs:
        taken(job)
