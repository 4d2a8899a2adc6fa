"""How far a campaign is, on stderr: a bar with the time left in a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from dtbacklash.campaign.engine import Tell

#: in the text of a stage: what is being done stands before it, what is known so far behind
SO_FAR = "; so far "
#: where no terminal is: one line in this time, and the last
LINE_EVERY_S = 2.0


@contextmanager
def shown(noun: str = "jobs") -> Iterator[Tell]:
    """Give what :func:`.engine.complete` tells: the stage, the jobs that have ended, the jobs in all."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines(noun)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = "{task.description}", BarColumn(), MofNCompleteColumn(), noun, TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        rows = {}

        def tell(stage: str, ended: int, total: int) -> None:
            if stage not in rows:
                rows[stage] = bar.add_task(stage, total=total, completed=ended)
            bar.update(rows[stage], completed=ended)

        yield tell


class _Lines:
    """A line now and then: ``diagnosing: 12 of 500 recordings finished, about 3 min left``."""

    def __init__(self, noun: str) -> None:
        self.noun = noun
        self.stage: str | None = None
        self.begin_s = self.told_s = 0.0
        self.kept = 0

    def __call__(self, stage: str, ended: int, total: int) -> None:
        now_s = time.monotonic()
        first = stage != self.stage
        if first:
            self.stage, self.begin_s, self.kept = stage, now_s, ended
        elif ended < total and now_s - self.told_s < LINE_EVERY_S:
            return
        self.told_s = now_s
        new = ended - self.kept
        left = ""
        if new and ended < total:
            left = f", about {duration((total - ended) / new * (now_s - self.begin_s))} left"
        line = f"{ended} of {total} {self.noun} finished{left}"
        print(f"{stage}: {line}" if stage else line, file=sys.stderr, flush=True)


def duration(seconds: float) -> str:
    """A time to wait, as exactly as one wants to know it: ``40 s``, ``3 min``, ``2.5 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 90 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
