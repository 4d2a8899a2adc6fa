"""The form of a controller that is none of the paper's: a linear law with a limit, or the plan of a predictive one.

The compiled functions are those of :mod:`.laws`, whose `Controller` C and `ControllerState` X they take.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.compiled import inlined

#: steps towards the moves of a predictive law in a sample, at most, and the change, V, below which none follows
SEARCH_STEPS, FOUND_V = 60, 1e-9


@dataclass(frozen=True)
class LinearLaw:
    """x[k+1] = A x + B y + E u, u = limited(C x + D y), with y = (r m, theta_m rad, q3 m) and u in V.

    Shapes (n, n), (n, 3), (n,), (3,), (n,). H (m, m), F (m, n): of a predictive law, whose u is the first of the m
    moves v within the limit at which 1/2 v' H v + v' F x is least; C is then that of no limit.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    E: Floats
    H: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    F: Floats = field(default_factory=lambda: np.zeros((0, 0)))


@inlined
def advance_model(A, B, u, x, spare):
    """x = A x + B u."""
    n = x.shape[0]
    for i in range(n):
        total = B[i] * u
        for j in range(n):
            total += A[i, j] * x[j]
        spare[i] = total
    for i in range(n):
        x[i] = spare[i]


@inlined
def output(C, x):
    total = 0.0
    for i in range(x.shape[0]):
        total += C[i] * x[i]
    return total


@inlined
def limited(C, u):
    return min(max(u, -C.limit), C.limit)


def search_lengths(H: Floats) -> Floats:
    """(2,) of Nesterov's method with a constant step for a cost between mu and L: 1/L, and the momentum."""
    if not H.size:
        return np.zeros(2)
    curved = np.linalg.eigvalsh(H)
    low, high = math.sqrt(curved[0]), math.sqrt(curved[-1])
    return np.array([1.0 / curved[-1], (high - low) / (high + low)])


@inlined
def _planned(C, X, forward):
    """The first move of a predictive law, V: projected fast gradient steps from the moves of the sample before."""
    last, ahead = X.moves[0], X.moves[1]
    n = last.shape[0]
    for i in range(n):
        ahead[i] = last[i]
        X.spare[i] = output(C.lf[i], X.law)
    for _ in range(SEARCH_STEPS):
        changed = 0.0
        for i in range(n):
            X.spare[n + i] = ahead[i] - C.search[0] * (output(C.lh[i], ahead) + X.spare[i])
        for i in range(n):
            found = min(max(X.spare[n + i], -C.limit - forward), C.limit - forward)
            changed = max(changed, abs(found - last[i]))
            ahead[i] = found + C.search[1] * (found - last[i])
            last[i] = found
        if changed < FOUND_V:
            break
    return last[0]


@inlined
def linear_step(C, X, r, theta_m, q3, forward):
    """One sample of a linear law; returns the voltage."""
    x = X.law
    if C.lh.shape[0] > 0:
        u = _planned(C, X, forward) + forward
    else:
        u = limited(C, output(C.lc, x) + C.ld[0] * r + C.ld[1] * theta_m + C.ld[2] * q3 + forward)
    for i in range(x.shape[0]):
        total = C.lb[i, 0] * r + C.lb[i, 1] * theta_m + C.lb[i, 2] * q3 + C.le[i] * (u - forward)
        for j in range(x.shape[0]):
            total += C.la[i, j] * x[j]
        X.spare[i] = total
    for i in range(x.shape[0]):
        x[i] = X.spare[i]
    return u
