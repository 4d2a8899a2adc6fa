"""What a twin counts, for Prometheus: on a port of this machine, by the official client. Off unless a port is given."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dtbacklash.errors import UserError
from dtbacklash.remote.connection import EXTRA
from dtbacklash.remote.statistics import Statistics

if TYPE_CHECKING:
    from prometheus_client.core import Metric

HOST = "127.0.0.1"


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
            yield from metrics(statistics, queue())

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


def metrics(statistics: Statistics, queue: dict[str, int]) -> Iterator[Metric]:
    """The counts as Prometheus wants them."""
    from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily

    document = statistics.document(queue)
    for name, about in (
        ("requests", "Requests that passed all checks"), ("answered", "Estimates sent"),
        ("accepted", "Estimates sent that the guard accepted"), ("refused", "Requests without an estimate"),
        ("dropped", "Requests without an estimate for want of time"),
    ):  # fmt: skip
        family = CounterMetricFamily(f"dtb_twin_{name}", about, labels=["machine"])
        for machine, counts in document["machines"].items():
            family.add_metric([machine], counts[name])
        yield family
    waiting = GaugeMetricFamily("dtb_twin_queue", "Requests that wait", labels=["machine"])
    for machine, length in queue.items():
        waiting.add_metric([machine], length)
    yield waiting
    rejected = CounterMetricFamily("dtb_twin_rejected", "Messages that failed a check", labels=["reason"])
    for reason, count in document["rejected"].items():
        rejected.add_metric([reason], count)
    yield rejected
    buckets, total_s = statistics.histogram()
    yield HistogramMetricFamily(
        "dtb_twin_delay_seconds", "From a request's coming to its answer's going", buckets=buckets, sum_value=total_s
    )
