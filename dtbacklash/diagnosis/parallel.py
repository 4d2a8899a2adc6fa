"""Independent work over cores or machines, by joblib's backends.

The simulation releases the interpreter's lock, so that threads are enough on one machine; inside
``joblib.parallel_config(backend="dask")`` and the like the same calls go to other machines.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TypeVar

from joblib import Parallel, delayed, parallel_config

T = TypeVar("T")
R = TypeVar("R")


def spread(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """The function's value at every item, in their order; one after the other unless joblib has been told of jobs."""
    if len(items) < 2:
        return [function(item) for item in items]
    return list(Parallel()(delayed(function)(item) for item in items))


def on_cores(jobs: int | None) -> AbstractContextManager[object]:
    """Within it, work is spread over so many threads; None leaves what joblib has been told."""
    return nullcontext() if jobs is None else parallel_config(backend="threading", n_jobs=jobs)
