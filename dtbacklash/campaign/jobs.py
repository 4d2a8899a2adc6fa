"""What a job is, and how one process tells the others that it is doing it."""

from __future__ import annotations

import os
import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dtbacklash import files

_directors: set[int] = set()  # the processes that direct a campaign: this one, or those that it was forked from


class Job(ABC):
    """One piece of a campaign. What it needs it carries with it: a worker may be another process or another machine.

    record : the file or folder that appears, or is replaced as a whole, when the job has ended, well or not.
    """

    record: Path

    @abstractmethod
    def done(self) -> bool:
        """Whether its result is there and is what the job would make now."""

    @abstractmethod
    def work(self) -> None:
        """Do it and leave the record. What the job itself can fail by is a result, and stands in the record.

        Raises UserError: the record cannot be written.
        """

    @abstractmethod
    def died(self, error: Exception | None) -> None:
        """Record that who worked on it died twice, of ``error`` if that is known; or raise."""

    @property
    def lock(self) -> Path:
        """The file that is there, and locked, while somebody works on the job."""
        return self.record.with_name(f".{self.record.name}.lock")

    def tidy(self) -> None:
        """Remove what a killed worker left half-written; nobody works on the job now."""
        for path in files.leftovers(self.record):
            files.remove(path)


def perform(job: Job) -> None:
    """Do a job, unless it is done already, or another process is doing it."""
    from joblib import parallel_config

    _leave_ctrl_c_to_the_director()
    with files.claim(job.lock) as mine:
        if mine:
            job.tidy()  # behind a worker that was killed
        if mine and not job.done():
            with parallel_config("sequential"):  # the workers fill the cores: nothing is spread further
                job.work()


def taken(job: Job) -> bool:
    """Whether another process is doing the job; clears up behind one that was killed while it did."""
    if job.lock.exists():
        with suppress(OSError), files.claim(job.lock) as mine:
            if mine:
                job.tidy()
            return not mine
    return False


@contextmanager
def directing() -> Iterator[None]:
    """While this lasts, Ctrl-C is for this process; its workers do not hear it."""
    number = os.getpid()
    fresh = number not in _directors
    _directors.add(number)
    try:
        yield
    finally:
        if fresh:
            _directors.discard(number)


def _leave_ctrl_c_to_the_director() -> None:
    """In a worker: Ctrl-C goes to all processes of the terminal; who directs ends the others and tidies up."""
    if os.getpid() not in _directors and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
