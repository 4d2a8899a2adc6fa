"""What a twin counts: one table of counts, which its status shows."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, OrderedDict
from dataclasses import dataclass, field
from typing import Any

from dtbacklash.twin.link.service import Answer

#: what is counted of each machine: requests that passed all checks, estimates sent, those of them that the guard
#: accepted, requests without an estimate, those of them for want of time
COUNTS = ("requests", "answered", "accepted", "refused", "dropped")
#: machines that are remembered; the one that has been silent for longest is forgotten
MACHINES_KEPT = 2000


@dataclass
class Statistics:
    """Counts of all machines, behind one lock.

    counts : by machine, by the names of ``COUNTS``. last : of each machine, what its last estimate said.
    rejected : messages that failed a check, by reason.
    """

    counts: OrderedDict[str, Counter[str]] = field(default_factory=OrderedDict)
    last: dict[str, dict[str, Any]] = field(default_factory=dict)
    rejected: Counter[str] = field(default_factory=Counter)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def count(self, machine: str, *names: str) -> None:
        """Add one to some counts of a machine, whose turn to be forgotten is the last again."""
        with self._lock:
            self.counts.setdefault(machine, Counter()).update(names)
            self.counts.move_to_end(machine)
            if len(self.counts) > MACHINES_KEPT:
                self.last.pop(self.counts.popitem(last=False)[0], None)

    def reject(self, reason: str) -> None:
        """Count a message that has failed a check."""
        with self._lock:
            self.rejected[reason] += 1

    def answer(self, machine: str, answer: Answer, delay_s: float) -> None:
        """Count an estimate that has been sent ``delay_s`` after its request came."""
        self.count(machine, "answered", *["accepted"] * answer.accepted)
        gap = answer.gap_rad if answer.accepted else answer.chosen.estimate.gap_rad
        last = {
            "time_s": round(time.time(), 3), "gap_deg": math.degrees(gap) if math.isfinite(gap) else None,
            "accepted": bool(answer.accepted), "reason": answer.chosen.verdict.reason[:500],
            "delay_s": round(delay_s, 6),
        }  # fmt: skip
        with self._lock:
            if machine in self.counts:
                self.last[machine] = last

    def document(self, queue: dict[str, int]) -> dict[str, Any]:
        """``rejected`` and ``machines`` of a status; ``queue`` : how many requests of each machine wait."""
        with self._lock:
            machines: dict[str, dict[str, Any]] = {
                name: {count: counts[count] for count in COUNTS} | {"queue": queue.get(name, 0)}
                for name, counts in self.counts.items()
            }
            for name, last in self.last.items():
                machines[name]["last"] = last
            return {"rejected": dict(self.rejected), "machines": machines}
