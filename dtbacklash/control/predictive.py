"""Model predictive control of motor and structure: a quadratic program a sample, with the voltage as its bound.

The model is that of the LQG (:func:`.rivals.plant`), with two disturbances more, which a Kalman filter estimates so
that nothing is left over at rest: a constant offset d between motor and screw, and a constant voltage l that a load or
friction eats (Muske and Badgwell, J. Process Control 12 (2002) 617). Over MOVES moves of SAMPLES samples each

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
from scipy import linalg

from dtbacklash.control.design import Array, MotorParameters, StructureParameters
from dtbacklash.control.linear_law import LinearLaw
from dtbacklash.control.rivals import ANGLE_RAD, DISTURBING_V, EFFORT_V, ERROR_M, OUTPUT_M, plant

#: the horizon with moves: 60 ms at 1 ms, in which the motor of the paper reaches its speed
MOVES, SAMPLES = 20, 3
#: how fast the offset between motor and screw may change, rad in a root of a second
OFFSET_RAD = 0.03
#: how fast the voltage that a load eats may change, V in a root of a second
LOAD_V = 1.0


@dataclass(frozen=True)
class Horizon:
    """The condensed cost 1/2 v' H v + v' F z of the moves v, V, and the rest (n,) of motor and structure at 1 m."""

    H: Array
    F: Array
    rest: Array


def horizon(a: Array, b: Array, c: Array) -> Horizon:
    """Of the plant x[k+1] = a x + b u, (theta_m, q3) = c x."""
    n = b.size
    cost, effort = np.outer(c[1], c[1]) / ERROR_M**2, np.array([[1.0 / EFFORT_V**2]])
    left = linalg.solve_discrete_are(a, b[:, None], cost, effort)
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


def mpc_law(motor: MotorParameters, structure: StructureParameters, tau_r_s: float, sample_time_s: float) -> LinearLaw:
    """The filter, the reference behind a lag of tau_r, and the cost of the moves; C: of the moves without a bound.

    Its states are those of motor and structure, the offset d, rad, the voltage l, and the reference behind the lag, m.
    """
    a, b, c = plant(motor, structure, sample_time_s)
    n, turned, plan = b.size, c[0], horizon(a, b, c)
    wide, into, seen = np.eye(n + 2), np.append(b, [0.0, 0.0]), np.zeros((2, n + 2))
    wide[:n, :n], wide[:n, n + 1], seen[:, :n] = a, b, c
    wide[:n, n] = a @ turned - turned  # an offset moves the structure as the motor's angle does
    noise = np.diag([ANGLE_RAD**2, OUTPUT_M**2])
    moving = DISTURBING_V**2 * np.outer(into, into)
    moving[n, n], moving[n + 1, n + 1] = OFFSET_RAD**2 * sample_time_s, LOAD_V**2 * sample_time_s
    spread = linalg.solve_discrete_are(wide.T, seen.T, moving, noise)
    gain = wide @ spread @ seen.T @ np.linalg.inv(seen @ spread @ seen.T + noise)
    # the distance from the rest at the reference, where the motor is turned by d less, and each move has to add to l
    by_state, at_rest = plan.F @ np.column_stack([np.eye(n), turned]), -plan.F @ plan.rest
    f = np.column_stack([by_state, plan.H.sum(axis=1), at_rest])
    kept = math.exp(-sample_time_s / tau_r_s)
    law_a, law_b = np.zeros((n + 3, n + 3)), np.zeros((n + 3, 3))
    law_a[:-1, :-1], law_a[-1, -1] = wide - gain @ seen, kept
    law_b[:-1, 1:], law_b[-1, 0] = gain, 1.0 - kept
    first = -np.linalg.solve(plan.H, f)[0]
    return LinearLaw(law_a, law_b, first, np.zeros(3), np.append(into, 0.0), plan.H, f)
