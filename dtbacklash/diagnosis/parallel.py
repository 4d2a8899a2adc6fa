"""Independent work over cores or machines, by threads or by joblib's backends.

The simulation releases the interpreter's lock, so that threads are enough on one machine; inside
``joblib.parallel_config(backend="dask")`` and the like the same calls go to other machines.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

#: threads that share the work; None: joblib knows, if it was imported (that takes 0.1 s). A thread begins with None.
_jobs: ContextVar[int | None] = ContextVar("jobs", default=None)


def spread(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """The function's value at every item, in their order; one after the other unless somebody has told of jobs."""
    jobs = _jobs.get()
    if len(items) < 2 or jobs == 1 or (jobs is None and "joblib" not in sys.modules):
        return [function(item) for item in items]
    if jobs is None:
        from joblib import Parallel, delayed

        return list(Parallel()(delayed(function)(item) for item in items))
    threads = ThreadPoolExecutor(jobs)
    try:
        return list(threads.map(function, items))
    finally:
        threads.shutdown(cancel_futures=True)


@contextmanager
def on_cores(jobs: int | None) -> Iterator[None]:
    """Within it, work is spread over so many threads; None leaves what joblib has been told."""
    before = _jobs.set(jobs)
    try:
        yield
    finally:
        _jobs.reset(before)
