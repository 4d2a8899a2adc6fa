"""A run in real time: every sample at its instant of the wall clock, and how late each of them was."""

from __future__ import annotations

import gc
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.experiment.loop import RAN

#: how long before its instant the loop stops sleeping and looks at the clock only: a sleep ends up to so much late, s
SPIN_S = 2e-4
#: how long another thread of this process (the bar that shows the progress) may keep the interpreter, s
SWITCH_S = 1e-4
#: how often the progress is told, s
TELL_S = 0.2
#: the share of the samples that the second figure of the summary covers
MOST = 0.999

#: (first, stop, novelty before) -> (sample after the last one, why it ended): a stretch of the compiled loop
Advance = Callable[[int, int, float], tuple[int, int]]


@dataclass
class RealTime:
    """The wall clock of a run.

    Sample k is due k sample times after the first one, whatever was late before it (absolute deadlines). Its work, from
    the sensors to the command and the plant's way to the next sample, has to be done when the next one is due.

    done_s : (N+1,) when the work of each sample was done, after its instant, s; NaN where it was not run.
    """

    sample_time_s: float
    done_s: Floats
    _began_s: float | None = field(default=None, repr=False)

    @classmethod
    def of(cls, samples: int, sample_time_s: float) -> RealTime:
        """Before the first of ``samples`` + 1 samples."""
        return cls(sample_time_s, np.full(samples + 1, math.nan))

    @property
    def chunk(self) -> int:
        """Samples between two signs of progress."""
        return max(1, round(TELL_S / self.sample_time_s))

    def run(self, advance: Advance, novelty: Floats, first: int, stop: int, before: float) -> tuple[int, int]:
        """Run the samples ``first <= k < stop``, one by one, each at its instant.

        advance : runs a stretch of samples. novelty : (N+1,) the index that it fills, m. before : the index before the
            first sample, m.

        Returns (k, why) : as :func:`.loop.run_segment`, which one call for all of them would give.
        """
        if self._began_s is None:
            self._began_s = time.perf_counter() - first * self.sample_time_s
        for k in range(first, stop):
            due_s = self._began_s + k * self.sample_time_s
            _wait(due_s)
            after, why = advance(k, k + 1, before)
            self.done_s[k] = time.perf_counter() - due_s
            if why != RAN:
                return after, why
            before = novelty[k]
        return stop, RAN

    def summary(self) -> dict[str, Any]:
        """Deadlines met and missed; times in ms from the instant of a sample to the end of its work."""
        done = self.done_s[np.isfinite(self.done_s)]
        missed = int(np.count_nonzero(done > self.sample_time_s))
        return {
            "deadline_ms": 1e3 * self.sample_time_s,
            "deadlines": done.size,
            "missed": missed,
            "met_share": 1.0 - missed / done.size,
            "median_ms": 1e3 * float(np.median(done)),
            "most_ms": 1e3 * float(np.quantile(done, MOST)),
            "worst_ms": 1e3 * float(done.max()),
        }


def _wait(until_s: float) -> None:
    """Until ``time.perf_counter`` shows ``until_s``: asleep at first, awake at the end."""
    while (left_s := until_s - time.perf_counter()) > 0.0:
        if left_s > SPIN_S:
            time.sleep(left_s - SPIN_S)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Keep this process's other threads and the garbage collector from disturbing the loop."""
    before, collects = sys.getswitchinterval(), gc.isenabled()
    gc.collect()
    sys.setswitchinterval(SWITCH_S)
    gc.disable()
    try:
        yield
    finally:
        sys.setswitchinterval(before)
        if collects:
            gc.enable()
