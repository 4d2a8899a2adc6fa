"""The form of a controller that is none of the paper's: a linear law with a limit, or the plan of a predictive one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dtbacklash.arrays import Floats


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
