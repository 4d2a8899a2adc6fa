"""Estimates on a pool of processes; each keeps the twins that it has made."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache

from dtbacklash.errors import UserError
from dtbacklash.remote.documents import Document
from dtbacklash.twin.service import Answer, Answering, Request

#: twins that a worker keeps
TWINS_KEPT = 64

Result = Answer | str
"""An answer, or why there is none."""


class Workers:
    """``count`` processes that estimate. A process that ends by itself is replaced; its request is refused."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = self._made()

    def warm_up(self, belief: Document) -> None:
        """Have each of them load (the first time on a machine: compile) what an estimate needs."""
        answer_ready(belief)  # here first: several that compile the same would only compete
        for future in [self._pool.submit(answer_ready, belief) for _ in range(self.count)]:
            future.result()

    def submit(self, belief: Document, request: Request, done: Callable[[Result], None]) -> None:
        """Have a request answered; ``done`` is called with what comes of it, in a thread of the pool."""

        def finished(future: Future[Result]) -> None:
            try:
                result = future.result()
            except BrokenProcessPool:
                result = "a process of the twin has ended; it has been replaced"
            except Exception as error:  # a fault of the estimate must not end the twin
                result = f"the estimate failed: {type(error).__name__}: {error}"
            done(result)

        try:
            future = self._pool.submit(answer, _text(belief), request)
        except BrokenProcessPool:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = self._made()
            future = self._pool.submit(answer, _text(belief), request)
        future.add_done_callback(finished)

    def close(self) -> None:
        """End the processes, also in the middle of an estimate."""
        processes = list((getattr(self._pool, "_processes", None) or {}).values())
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        for process in processes:
            process.join(2.0)

    def _made(self) -> ProcessPoolExecutor:
        # not fork: threads and locks of the network are here
        return ProcessPoolExecutor(self.count, multiprocessing.get_context("spawn"), _begin, (os.getpid(),))


def _begin(parent: int) -> None:
    """In a new process: Ctrl-C is its parent's affair, and it ends when that one does."""
    import threading
    import time

    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threadpool_limits(1, "blas")

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def answer(belief: str, request: Request) -> Result:
    """What the twin of a belief says of a request, or why it says nothing."""
    try:
        return _twin(belief).answer(request)
    except UserError as mistake:
        return str(mistake)
    except (TypeError, ValueError, KeyError, AssertionError, ArithmeticError) as error:
        return f"cannot be estimated: {type(error).__name__}: {error}"


def answer_ready(belief: Document) -> bool:
    """Make the twin of a belief, and load what it needs."""
    _twin(_text(belief)).warm_up()
    return True


def _text(belief: Document) -> str:
    import json

    return json.dumps(belief)


@lru_cache(maxsize=TWINS_KEPT)
def _twin(belief: str) -> Answering:
    import json

    from dtbacklash.remote.belief import twin_of

    return twin_of(json.loads(belief))
