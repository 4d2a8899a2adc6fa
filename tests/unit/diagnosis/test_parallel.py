"""Work over threads: the same results in the same order."""

import threading
from operator import neg

import pytest
from joblib import parallel_config

from dtbacklash.diagnosis.parallel import on_cores, spread


def test_results_come_in_their_order():
    for jobs in (None, 1, 2):
        with on_cores(jobs):
            assert spread(neg, range(20)) == [-k for k in range(20)]
    with on_cores(2):
        assert spread(neg, []) == []


def threads_of(count: int) -> int:
    """How many threads work at once on so many items that wait for one another, as long as that many come."""
    together = threading.Barrier(2)

    def wait(_: int) -> str:
        together.wait(timeout=20.0)
        return threading.current_thread().name

    return len(set(spread(wait, range(count))))


def test_work_is_shared_by_as_many_threads_as_were_told():
    with on_cores(2):
        assert threads_of(6) == 2
    with parallel_config(backend="threading", n_jobs=2):
        assert threads_of(6) == 2
        with on_cores(1):
            assert spread(lambda _: threading.current_thread(), range(3)) == [threading.current_thread()] * 3


def test_what_threads_do_is_not_spread_again_and_what_fails_is_raised():
    with on_cores(2):
        inner = spread(lambda _: spread(lambda _: threading.current_thread().name, range(4)), range(2))
        assert [len(set(names)) for names in inner] == [1, 1]
        with pytest.raises(ZeroDivisionError):
            spread(lambda k: 1 / k, range(3))
