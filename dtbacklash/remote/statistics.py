"""What a twin counts: for its status and its metrics."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, OrderedDict
from dataclasses import dataclass, field
from typing import Any

from dtbacklash.twin.service import Answer

#: upper ends of the classes of delays, s
CLASSES_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
#: machines that are remembered; the one that has been silent for longest is forgotten
MACHINES_KEPT = 2000


@dataclass
class Machine:
    """Counts of one machine. refused : told that there is no estimate; dropped : of those, for want of time."""

    requests: int = 0
    answered: int = 0
    accepted: int = 0
    refused: int = 0
    dropped: int = 0
    last: dict[str, Any] | None = None


@dataclass
class Statistics:
    """Counts of all, behind one lock."""

    machines: OrderedDict[str, Machine] = field(default_factory=OrderedDict)
    rejected: Counter[str] = field(default_factory=Counter)
    delays: Counter[int] = field(default_factory=Counter)
    delay_sum_s: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def asked(self, machine: str) -> None:
        """A request has come that passed all checks."""
        with self._lock:
            self.machines.setdefault(machine, Machine()).requests += 1
            self.machines.move_to_end(machine)
            if len(self.machines) > MACHINES_KEPT:
                self.machines.popitem(last=False)

    def reject(self, reason: str) -> None:
        """A message has failed a check."""
        with self._lock:
            self.rejected[reason] += 1

    def refuse(self, machine: str, dropped: bool) -> None:
        """A request gets no estimate; ``dropped`` : as there is no time for it."""
        with self._lock:
            one = self.machines.setdefault(machine, Machine())
            one.refused += 1
            one.dropped += dropped

    def answer(self, machine: str, answer: Answer, delay_s: float) -> None:
        """An estimate has been sent, ``delay_s`` after its request came."""
        gap = answer.gap_rad if answer.accepted else answer.chosen.estimate.gap_rad
        with self._lock:
            one = self.machines.setdefault(machine, Machine())
            one.answered += 1
            one.accepted += answer.accepted
            one.last = {
                "time_s": round(time.time(), 3), "gap_deg": math.degrees(gap) if math.isfinite(gap) else None,
                "accepted": bool(answer.accepted), "reason": answer.chosen.verdict.reason[:500],
                "delay_s": round(delay_s, 6),
            }  # fmt: skip
            self.delay_sum_s += delay_s
            self.delays[next((i for i, end in enumerate(CLASSES_S) if delay_s <= end), len(CLASSES_S))] += 1

    def document(self, queue: dict[str, int]) -> dict[str, Any]:
        """``rejected`` and ``machines`` of a status; ``queue`` : how many requests of each machine wait."""
        with self._lock:
            machines = {
                name: {
                    "requests": m.requests, "answered": m.answered, "accepted": m.accepted, "refused": m.refused,
                    "dropped": m.dropped, "queue": queue.get(name, 0), **({"last": m.last} if m.last else {}),
                }
                for name, m in self.machines.items()
            }  # fmt: skip
            return {"rejected": dict(self.rejected), "machines": machines}

    def histogram(self) -> tuple[list[tuple[str, int]], float]:
        """Cumulative counts by the upper end of each class of delays, and their sum, s."""
        with self._lock:
            total, found = 0, []
            for i, end in enumerate([*CLASSES_S, math.inf]):
                total += self.delays[i]
                found.append(("+Inf" if math.isinf(end) else f"{end:g}", total))
            return found, self.delay_sum_s
