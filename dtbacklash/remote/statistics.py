"""What a twin counts: one table of counts, which its status and its metrics for Prometheus show."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from dtbacklash.errors import UserError
from dtbacklash.remote.connection import EXTRA
from dtbacklash.twin.link.service import Answer

if TYPE_CHECKING:
    from prometheus_client.core import Metric

#: what is counted of each machine, by its name in a status; the dropped requests are among the refused ones
COUNTS = {
    "requests": "Requests that passed all checks",
    "answered": "Estimates sent",
    "accepted": "Estimates sent that the guard accepted",
    "refused": "Requests without an estimate",
    "dropped": "Requests without an estimate for want of time",
}
#: upper ends of the classes of delays, s
CLASSES_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, math.inf)
#: machines that are remembered; the one that has been silent for longest is forgotten
MACHINES_KEPT = 2000
#: where Prometheus is answered
HOST = "127.0.0.1"


@dataclass
class Statistics:
    """Counts of all machines, behind one lock.

    counts : by machine, by the names of ``COUNTS``. last : of each machine, what its last estimate said.
    rejected : messages that failed a check, by reason. delays : answers, by the index in ``CLASSES_S``.
    """

    counts: OrderedDict[str, Counter[str]] = field(default_factory=OrderedDict)
    last: dict[str, dict[str, Any]] = field(default_factory=dict)
    rejected: Counter[str] = field(default_factory=Counter)
    delays: Counter[int] = field(default_factory=Counter)
    delay_sum_s: float = 0.0
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
            self.delay_sum_s += delay_s
            self.delays[next(i for i, end in enumerate(CLASSES_S) if delay_s <= end)] += 1

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

    def metrics(self, queue: dict[str, int]) -> Iterator[Metric]:
        """The counts in the form that Prometheus expects; ``queue`` : how many requests of each machine wait."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily

        document = self.document(queue)
        tables: list[tuple[type[CounterMetricFamily | GaugeMetricFamily], str, str, str, dict[str, int]]] = [
            (CounterMetricFamily, name, about, "machine", {m: one[name] for m, one in document["machines"].items()})
            for name, about in COUNTS.items()
        ]
        tables.append((GaugeMetricFamily, "queue", "Requests that wait", "machine", queue))
        tables.append((CounterMetricFamily, "rejected", "Messages that failed a check", "reason", document["rejected"]))
        for kind, name, about, label, values in tables:
            family = kind(f"dtb_twin_{name}", about, labels=[label])
            for key, value in values.items():
                family.add_metric([key], value)
            yield family
        with self._lock:
            sums = [(end, sum(self.delays[j] for j in range(i + 1))) for i, end in enumerate(CLASSES_S)]
            buckets = [("+Inf" if math.isinf(end) else f"{end:g}", total) for end, total in sums]
            yield HistogramMetricFamily(
                "dtb_twin_delay_seconds", "From a request's arrival to its answer", buckets=buckets,
                sum_value=self.delay_sum_s,
            )  # fmt: skip


@contextmanager
def serve_metrics(statistics: Statistics, queue: Callable[[], dict[str, int]], port: int) -> Iterator[None]:
    """Answer Prometheus on ``port`` of 127.0.0.1 meanwhile; 0: do not.

    Raises
    ------
    UserError : the port cannot be had; the extra is not installed.
    """
    if port == 0:
        yield
        return
    try:
        from prometheus_client import CollectorRegistry, start_http_server
        from prometheus_client.registry import Collector
    except ImportError as error:
        raise UserError("metrics_port", port, EXTRA) from error

    class Counts(Collector):
        def collect(self) -> Iterator[Metric]:
            yield from statistics.metrics(queue())

    registry = CollectorRegistry()
    registry.register(Counts())
    try:
        server, thread = start_http_server(port, HOST, registry)
    except OSError as error:
        raise UserError("metrics_port", port, f"cannot be had: {(error.strerror or str(error)).lower()}") from error
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join(1.0)
