"""Intervals of shares and medians beside scipy's and the binomial distribution's."""

import math

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from dtbacklash.scoring.shares import holds, median_interval, wilson


@pytest.mark.parametrize(("right", "of"), [(0, 1), (1, 1), (0, 30), (3, 7), (81, 263), (98, 98)])
def test_wilson_is_that_of_scipy(right, of):
    expected = binomtest(right, of).proportion_ci(0.95, method="wilson")
    assert wilson(right, of) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_nothing_says_nothing():
    assert wilson(0, 0) == (0.0, 1.0)
    assert all(math.isnan(value) for value in median_interval([]))


@pytest.mark.parametrize("n", [6, 7, 20, 51, 100])
def test_a_median_has_the_narrowest_interval_of_order_statistics_that_holds_it_often_enough(n):
    values = np.random.default_rng(n).permutation(n).astype(float)
    median, low, high = median_interval(values)
    assert median == np.median(values)
    assert low == n - 1 - high

    def coverage(first):
        return 1.0 - 2.0 * binom.cdf(first, n, 0.5)

    assert coverage(low) >= 0.95 > coverage(low + 1)


def test_the_interval_of_few_values_is_their_range_and_infinite_ones_stay():
    assert median_interval([3.0, 1.0, 2.0]) == (2.0, 1.0, 3.0)
    assert median_interval([math.inf, 1.0, math.inf]) == (math.inf, 1.0, math.inf)


def test_an_interval_without_ends_holds_nothing_and_an_angle_holds_modulo_its_period():
    assert holds((1.0, 2.0), 1.5)
    assert not holds((1.0, 2.0), 2.5)
    assert not holds((None, 2.0), 1.5)
    assert not holds((1.0, math.nan), 1.5)
    assert holds((3.0, 3.4), -3.1, 2.0 * math.pi)
    assert holds((-3.2, -3.0), 3.1, 2.0 * math.pi)
    assert not holds((3.0, 3.3), 2.9, 2.0 * math.pi)
