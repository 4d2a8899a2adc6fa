"""Jobs that do nothing but say that they were done; in a file of their own, so that workers can import them."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from joblib import Parallel, delayed

from dtbacklash.campaign.jobs import Job
from dtbacklash.errors import Failure
from dtbacklash.files import read_json, write_json


@dataclass(frozen=True)
class Note(Job):
    """Writes its record, and a line a try into ``record.log``; ``how`` it goes wrong."""

    record: Path
    how: str = ""
    wait_s: float = 0.0

    @property
    def log(self) -> Path:
        return self.record.with_suffix(".log")

    @property
    def tries(self) -> int:
        return len(self.log.read_text().splitlines()) if self.log.exists() else 0

    def done(self) -> bool:
        return read_json(self.record).get("how") == "done"

    def work(self) -> None:
        with self.log.open("a") as log:
            log.write(f"{os.getpid()}\n")
        time.sleep(self.wait_s)
        if self.how == "killed" or (self.how == "killed once" and self.tries == 1):
            self.record.with_name(f".{self.record.name}.12345678.partial").write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
        if self.how == "interrupted":
            raise KeyboardInterrupt
        if self.how == "full":
            raise Failure("out", self.record, "cannot be written: the disk is full")
        write_json(self.record, {"how": "failed" if self.how == "fails" else "done"})

    def died(self, error: Exception | None) -> None:
        write_json(self.record, {"how": f"died of {type(error).__name__}"})


@dataclass(frozen=True)
class Nested(Job):
    """Tries to spread over processes, and notes where it got."""

    record: Path

    def done(self) -> bool:
        return False

    def work(self) -> None:
        write_json(self.record, {"inside": Parallel()(delayed(os.getpid)() for _ in range(3)), "own": os.getpid()})

    def died(self, error: Exception | None) -> None:
        raise AssertionError(error)
