"""Model predictive control of motor and structure: a quadratic program a sample, with the voltage as its bound.

The filter is that of the offset controller (:func:`.observer.kalman`). Over MOVES moves of SAMPLES samples each

    min  sum (q3 - w)^2/ERROR_M^2 + u^2/EFFORT_V^2  +  z' P z,   |u| <= limit

with w the reference behind a lag of tau_r, the paper's reference model, z the distance from the rest at w, and P the
cost that is left without the bound (the Riccati equation's). Without a bound that binds it is LQ feedback. The
states are eliminated: what is left are the moves, within a box. A fast projected gradient finds them (Nesterov;
Richter, Jones and Morari, 2012), compiled with the loop and exported with the controller: the condition number of H is
11, so that it needs some 30 steps, and no solver beside the loop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from dtbacklash.control.chain import Array, MotorParameters, StructureParameters
from dtbacklash.control.linear_law import LinearLaw
from dtbacklash.control.observer import kalman, plant
from dtbacklash.control.rivals import EFFORT_V, ERROR_M

#: the horizon with moves: 60 ms at 1 ms, in which the motor of the paper reaches its speed
MOVES, SAMPLES = 20, 3


@dataclass(frozen=True)
class Horizon:
    """The condensed cost 1/2 v' H v + v' F z of the moves v, V, and the rest (n,) of motor and structure at 1 m."""

    H: Array
    F: Array
    rest: Array


def horizon(a: Array, b: Array, c: Array) -> Horizon:
    """Of the plant x[k+1] = a x + b u, (theta_m, q3) = c x."""
    import control

    n = b.size
    cost, effort = np.outer(c[1], c[1]) / ERROR_M**2, np.array([[1.0 / EFFORT_V**2]])
    left = np.asarray(control.dlqr(a, b[:, None], cost, effort)[1])
    free, forced = np.eye(n), np.zeros((n, MOVES))
    H, F = SAMPLES * effort[0, 0] * np.eye(MOVES), np.zeros((MOVES, n))
    for k in range(MOVES * SAMPLES):
        H += forced.T @ cost @ forced
        F += forced.T @ cost @ free
        free, forced = a @ free, a @ forced
        forced[:, k // SAMPLES] += b
    H += forced.T @ left @ forced
    F += forced.T @ left @ free
    still = np.linalg.svd(a - np.eye(n))[2][-1]  # a x = x: nothing moves
    return Horizon(0.5 * (H + H.T), F, still / float(c[1] @ still))


def mpc_law(
    motor: MotorParameters, structure: StructureParameters, tau_r_s: float, sample_time_s: float,
    noise: tuple[float, float],
) -> LinearLaw:  # fmt: skip
    """The filter, the reference behind a lag of tau_r, and the cost of the moves; C: of the moves without a bound.

    Its states are those of motor and structure, the offset d, rad, the voltage l, and the reference behind the lag, m.
    noise : see :func:`.observer.kalman`.
    """
    system = plant(motor, structure, sample_time_s)
    (a, b, c), seen = system, kalman(system, noise, sample_time_s)
    n, plan = b.size, horizon(a, b, c)
    # the distance from the rest at the reference, where the motor is turned by d less, and each move has to add to l
    by_state, at_rest = plan.F @ np.column_stack([np.eye(n), c[0]]), -plan.F @ plan.rest
    f = np.column_stack([by_state, plan.H.sum(axis=1), at_rest])
    kept = math.exp(-sample_time_s / tau_r_s)
    law_b = np.zeros((n + 3, 3))
    law_b[:-1, 1:], law_b[-1, 0] = seen.L, 1.0 - kept
    first = -np.linalg.solve(plan.H, f)[0]
    law_a = scipy.linalg.block_diag(seen.A - seen.L @ seen.C, np.array([[kept]]))
    return LinearLaw(law_a, law_b, first, np.zeros(3), np.append(seen.B, 0.0), plan.H, f)
