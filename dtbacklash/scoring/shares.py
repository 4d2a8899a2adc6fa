"""Shares and medians with 95 % intervals, and whether an interval holds the truth. Standard library and numpy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

#: two-sided 95 % of the normal distribution
Z95 = NormalDist().inv_cdf(0.975)


def wilson(right: int, of: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share; 0 to 1 of nothing (J. Am. Stat. Assoc. 22 (1927) 209)."""
    if not of:
        return 0.0, 1.0
    share, weight = right / of, Z95**2 / of
    middle = (share + 0.5 * weight) / (1.0 + weight)
    half = Z95 * math.sqrt(share * (1.0 - share) / of + 0.25 * weight / of) / (1.0 + weight)
    return (0.0 if right == 0 else middle - half), (1.0 if right == of else middle + half)


class Count:
    """Something of which ``right`` of ``of`` are right."""

    right: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share."""
        return wilson(self.right, self.of)


def median_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Median and its distribution-free 95 % interval by order statistics; NaN of nothing.

    Values may be infinite. The interval is the whole range where fewer than six values are given, which cover less
    than 95 % (Conover, Practical Nonparametric Statistics, chapter 3).
    """
    n = len(values)
    if not n:
        return math.nan, math.nan, math.nan
    ordered = sorted(values)
    tail, below = 0.0, 0
    while below < n // 2 and tail + math.comb(n, below) / 2**n <= 0.025:
        tail += math.comb(n, below) / 2**n
        below += 1
    first = max(below - 1, 0)
    median = ordered[n // 2] if n % 2 else float(np.mean(ordered[n // 2 - 1 : n // 2 + 1]))
    return median, ordered[first], ordered[n - 1 - first]


def holds(interval: Sequence[float | None], truth: float, period: float | None = None) -> bool:
    """Whether an interval holds the truth, for an angle modulo its period; false without an interval."""
    low, high = interval
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return False
    if period is None:
        return low <= truth <= high
    middle = 0.5 * (low + high)
    away = (truth - middle + 0.5 * period) % period - 0.5 * period
    return abs(away) <= 0.5 * (high - low)
