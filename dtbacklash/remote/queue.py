"""Requests that wait for a worker: in turn over the machines, a few of each, the oldest dropped for a newer one."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from typing import Generic, TypeVar

Item = TypeVar("Item")


class FairQueue(Generic[Item]):
    """At most ``depth`` items a machine, at most ``machines`` machines that wait.

    A machine that asks ten times as often as another gets no more of the workers.
    """

    def __init__(self, depth: int, machines: int) -> None:
        self.depth, self.machines = depth, machines
        self._waiting: OrderedDict[str, deque[Item]] = OrderedDict()
        self._changed = threading.Condition()

    def put(self, machine: str, item: Item) -> Item | None:
        """Add an item; gives what is dropped for it: the machine's oldest, or itself where too many machines wait."""
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
