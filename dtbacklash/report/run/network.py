"""How it went between a machine and its twin elsewhere, on the page of a run and in the terminal."""

from __future__ import annotations

from typing import Any

from dtbacklash.report.kit.numbers import number


def network(summary: dict[str, Any]) -> list[str]:
    """A sentence on the requests, one for each reason for no answer, and one for each kind of dropped message.

    Empty for a run whose twin was in its own process.
    """
    remote = summary.get("remote")
    if not remote:
        return []
    head = f"twin at {remote['broker']}, machine {remote['machine']}: "
    head += f"{remote['answered']} of {remote['requests']} requests answered"
    median_s, most_s = remote["delay_s"]["median"], remote["delay_s"]["p99"]
    if median_s is not None:
        head += f", after {number(1e3 * median_s)} ms in the median, {number(1e3 * most_s)} ms at most in 99 %"
    told = [head]
    told += [f"no answer, {_times(n)}: {reason}" for reason, n in remote["unanswered"].items()]
    return told + [f"message dropped, {_times(n)}: {reason}" for reason, n in remote["dropped"].items()]


def _times(n: int) -> str:
    return "once" if n == 1 else f"{n} times"
