"""Requests that wait for a worker, and the workers: a pool of processes, each of which keeps the twins it has made."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from typing import Generic, TypeVar

from dtbacklash.errors import UserError
from dtbacklash.remote.belief import twin_of
from dtbacklash.remote.protocol import Document
from dtbacklash.twin.link.service import Answer, Answering, Request

#: twins that a worker keeps
TWINS_KEPT = 64

Result = Answer | str
"""An answer, or why there is none."""

Item = TypeVar("Item")


class FairQueue(Generic[Item]):
    """Items that wait, at most ``depth`` a machine and of ``machines`` machines; the machines take turns.

    A machine that asks ten times as often as another one gets no more of the workers.
    """

    def __init__(self, depth: int, machines: int) -> None:
        self.depth, self.machines = depth, machines
        self._waiting: OrderedDict[str, deque[Item]] = OrderedDict()
        self._changed = threading.Condition()

    def put(self, machine: str, item: Item) -> Item | None:
        """Add an item; returns what is dropped for it: the machine's oldest, or itself where too many machines wait."""
        with self._changed:
            mine = self._waiting.get(machine)
            if mine is None:
                if len(self._waiting) >= self.machines:
                    return item
                mine = self._waiting[machine] = deque()
            dropped = mine.popleft() if len(mine) >= self.depth else None
            mine.append(item)
            self._changed.notify()
            return dropped

    def take(self, timeout_s: float) -> Item | None:
        """The oldest item of the machine whose turn it is; None where nothing comes within the time."""
        with self._changed:
            if not self._waiting and not self._changed.wait_for(lambda: bool(self._waiting), timeout_s):
                return None
            machine, mine = next(iter(self._waiting.items()))
            item = mine.popleft()
            del self._waiting[machine]
            if mine:
                self._waiting[machine] = mine  # behind all others
            return item

    def lengths(self) -> dict[str, int]:
        """How many items of each machine wait."""
        with self._changed:
            return {machine: len(mine) for machine, mine in self._waiting.items()}


class Processes:
    """``count`` processes that estimate. A process that ends by itself is replaced; its request is refused."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = self._made()

    def warm_up(self, belief: Document) -> None:
        """Have each of them load what an estimate needs."""
        for future in [self._pool.submit(answer_ready, belief) for _ in range(self.count)]:
            future.result()

    def submit(self, belief: Document, request: Request, done: Callable[[Result], None]) -> None:
        """Have a request answered; ``done`` gets the result, in a thread of the pool."""

        def finished(future: Future[Result]) -> None:
            try:
                result = future.result()
            except BrokenProcessPool:
                result = "a process of the twin has ended; it has been replaced"
            except Exception as error:  # a fault of the estimate must not end the twin
                result = f"the estimate failed: {type(error).__name__}: {error}"
            done(result)

        text = json.dumps(belief)
        try:
            future = self._pool.submit(answer, text, request)
        except BrokenProcessPool:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = self._made()
            future = self._pool.submit(answer, text, request)
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
    """In a new process: leave Ctrl-C to the parent process, and end when that one does."""
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
    """The answer of a belief's twin to a request, or why there is none."""
    try:
        return _twin(belief).answer(request)
    except UserError as mistake:
        return str(mistake)
    except (TypeError, ValueError, KeyError, AssertionError, ArithmeticError) as error:
        return f"cannot be estimated: {type(error).__name__}: {error}"


def answer_ready(belief: Document) -> bool:
    """Make the twin of a belief, and load what it needs."""
    _twin(json.dumps(belief)).warm_up()
    return True


@lru_cache(maxsize=TWINS_KEPT)
def _twin(belief: str) -> Answering:
    return twin_of(json.loads(belief))
