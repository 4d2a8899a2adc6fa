"""Times of functions, and the rows of a study's table."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

Row = dict[str, Any]


def times_s(function: Callable[[], object], repeats: int) -> list[float]:
    """Wall times [s] of some calls, after one that is not counted (it compiles, and fills the caches)."""
    function()
    found = []
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        found.append(time.perf_counter() - begin)
    return found


def interleaved_s(functions: list[Callable[[], object]], repeats: int) -> list[float]:
    """Best wall time [s] of each function, called in turn: what else the machine does hits all of them alike."""
    rounds = [[times_s(function, 1)[0] for function in functions] for _ in range(repeats)]
    return [min(column) for column in zip(*rounds, strict=True)]


def verdict(value: float, at_most: float | None) -> str:
    """``yes`` or ``no`` by a limit, nothing without one."""
    return "" if at_most is None else ("yes" if value <= at_most else "no")
