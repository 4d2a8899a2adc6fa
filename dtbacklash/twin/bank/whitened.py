"""Least squares on whitened residuals of a buffer, and whether what they leave is only noise.

A residual of N samples is taken by means over blocks of ``BLOCK`` samples: what the laws of a machine do is slower, and
a tenth of the numbers is left. The means are whitened by the Cholesky factor of their covariance, which the sensors'
noise and counts give. Then the sum of squares is chi-square distributed where the model is right: its mean is the
degrees of freedom n, its variance 2 n. A model that is slightly wrong leaves something slow, which sums over
``SLOW`` neighbours show best.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats

BLOCK = 10
SLOW = 6
#: Levenberg-Marquardt: steps, and a chi-square, or a share of it, by which one has to improve to be followed by another
STEPS, WORTH, SLOWER = 14, 0.05, 1e-3
#: of several starts: steps, and how many are then left
ROUNDS = ((1, 4), (3, 2))
FAR = 1e8  # a residual that stands for any greater one, or for none
DIFFERENCE = 3e-3  # of a variable of the fit, for its derivative

Residual = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Fit:
    """Variables x (n,) at the minimum, their covariance, the whitened residual there (m,), its derivatives (m, n).

    priors : how many of the residual's last rows are the variables' own priors.
    """

    x: Floats
    covariance: Floats
    residual: Floats
    jacobian: Floats
    priors: int = 0

    @property
    def chi2(self) -> float:
        """Sum of squares, priors included."""
        return float(self.residual @ self.residual)

    @property
    def std(self) -> Floats:
        """(n,) standard errors; inf for what the data do not see."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def excess(self) -> float:
        """By how many standard deviations of chi-square too much is left: the larger of all blocks and of slow sums."""
        data = self.residual[: self.residual.size - self.priors]
        count = data.size // SLOW
        slow = data[: count * SLOW].reshape(count, SLOW).sum(axis=1) / math.sqrt(SLOW)
        free = max(data.size - self.x.size, 1)
        # chi-square of n, by the cube root of which it is nearly normal (Wilson & Hilferty, 1931)
        return max(_normal(float(data @ data), free), _normal(float(slow @ slow), max(count - self.x.size / SLOW, 1)))


def _normal(chi2: float, n: float) -> float:
    spread = 2.0 / (9.0 * n)
    return ((chi2 / n) ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread)


def blocks(y: Floats) -> Floats:
    """(N // BLOCK, ...) means over blocks along the first axis."""
    count = y.shape[0] // BLOCK
    means: Floats = y[: count * BLOCK].reshape(count, BLOCK, *y.shape[1:]).mean(axis=1)
    return means


def fitted(residual: Residual, x: Floats, priors: int = 0, longest: Floats | float = np.inf, steps: int = STEPS) -> Fit:
    """Minimise the sum of squares from ``x`` by Levenberg and Marquardt's method, with forward differences.

    longest : (n,) by how much a variable may change in a step.
    """
    x = np.array(x, dtype=np.float64)

    def bounded(x: Floats) -> Floats:  # a simulation far from any minimum may leave all bounds
        return np.clip(np.nan_to_num(residual(x), nan=FAR), -FAR, FAR)

    r = bounded(x)
    damping = 1e-3
    jacobian = _jacobian(bounded, x, r)
    for _ in range(steps):
        gain, moved = 0.0, x
        for _ in range(6):
            moved = x - np.clip(_solve(jacobian, r, damping), -longest, longest)
            trial = bounded(moved)
            gain = float(r @ r - trial @ trial)
            if gain > 0.0:
                break
            damping = max(damping * 8.0, 1e-3)
        if not gain > 0.0:
            break
        x, r, damping = moved, trial, damping / 8.0
        if gain < max(WORTH, SLOWER * float(r @ r)):
            break
        jacobian = _jacobian(bounded, x, r)
    return Fit(x, _covariance(jacobian), r, jacobian, priors)


def best_fitted(residual: Residual, starts: list[Floats], priors: int, longest: Floats) -> Fit:
    """The best fit from several starts; the less promising are dropped after a step, and after some more."""
    for steps, kept in ROUNDS if len(starts) > 1 else ():
        begun = sorted((fitted(residual, x, priors, longest, steps) for x in starts), key=lambda fit: fit.chi2)
        starts = [fit.x for fit in begun[:kept]]
    return min((fitted(residual, x, priors, longest) for x in starts), key=lambda fit: fit.chi2)


def _jacobian(residual: Residual, x: Floats, r: Floats) -> Floats:
    columns = []
    for i in range(x.size):
        moved = x.copy()
        moved[i] += DIFFERENCE
        columns.append((residual(moved) - r) / DIFFERENCE)
    return np.array(columns).T


def _solve(jacobian: Floats, r: Floats, damping: float) -> Floats:
    normal = jacobian.T @ jacobian
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / np.outer(scale, scale) + damping * np.eye(scale.size)
    return np.asarray(np.linalg.solve(scaled, jacobian.T @ r / scale) / scale)


def _covariance(jacobian: Floats) -> Floats:
    """Of the variables; a variance of inf for those that the data do not see."""
    normal = jacobian.T @ jacobian
    seen = np.diag(normal) > 1e-9
    found = np.diag(np.where(seen, 0.0, np.inf))
    if np.any(seen):
        found[np.ix_(seen, seen)] = inverse(normal[np.ix_(seen, seen)])
    return found


def inverse(normal: Floats) -> Floats:
    """Of a normal matrix; what it hardly decides is nearly free, not fixed."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-30))
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    return np.asarray((vectors / np.maximum(values, 1e-12)) @ vectors.T * np.outer(scale, scale))


def count_of(y: Floats) -> float:
    """The size of a sensor's count, from its record; 0 where it has none."""
    steps = np.abs(np.diff(y))
    steps = steps[steps > 0.0]
    if steps.size == 0:
        return 0.0
    count = float(steps.min())
    ratio = steps / count
    if np.abs(ratio - np.round(ratio)).max() > 1e-3 or np.count_nonzero(ratio < 1.5) < 0.02 * steps.size:
        return 0.0
    return count


def noise_of(y: Floats) -> float:
    """Standard deviation of white noise on a smooth record, by its third differences; robust against their jumps."""
    third = np.abs(np.diff(y, 3))
    quiet = third[third <= np.quantile(third, 0.9)]
    # the rms of the smaller nine tenths of a normal variable is 0.7886 of its own
    return float(np.sqrt(np.mean(quiet**2)) / 0.7886 / math.sqrt(20.0))


def without_counts(y: Floats, half_window: int = 7) -> Floats:
    """(N,) the record of a sensor in counts, smoothed as far as the counts allow; without counts as it is.

    A parabola through the neighbours (Savitzky & Golay, Anal. Chem. 36 (1964) 1627), held within half a count of what
    was shown: where the motion has a corner, nothing is rounded off.
    """
    count = count_of(y)
    if count == 0.0 or y.size <= 2 * half_window:
        return y
    t = np.arange(-half_window, half_window + 1, dtype=np.float64)
    weights = np.linalg.pinv(np.vander(t, 3, increasing=True))[0]
    smooth = y.copy()
    smooth[half_window:-half_window] = np.convolve(y, weights[::-1], "valid")
    return np.asarray(np.clip(smooth, y - 0.5 * count, y + 0.5 * count))
