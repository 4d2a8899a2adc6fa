"""The form of a controller that is none of the paper's: a linear law with a limit, or the plan of a predictive one.

The core computes it (``control.c``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from dtbacklash.arrays import Floats

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


def search_lengths(H: Floats) -> Floats:
    """(2,) of Nesterov's method with a constant step for a cost between mu and L: 1/L, and the momentum."""
    if not H.size:
        return np.zeros(2)
    curved = np.linalg.eigvalsh(H)
    low, high = math.sqrt(curved[0]), math.sqrt(curved[-1])
    return np.array([1.0 / curved[-1], (high - low) / (high + low)])
