"""What LQG, MPC and the offset controller share: the sampled plant, and a Kalman filter of it, by python-control.

The filter may have two disturbances more, so that nothing is left over at rest: a constant offset d between motor and
screw, and a constant voltage l that a load or friction eats (Muske and Badgwell, J. Process Control 12 (2002) 617).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from dtbacklash.control.chain import Array, MotorParameters, StructureParameters, motor_ss, structure_ss

#: disturbing voltage, V rms, and the least noise of angle (rad: counts of 4096 a turn) and output (m), rms
DISTURBING_V, ANGLE_RAD, OUTPUT_M = 1.0, 2.0 * math.pi / 4096 / math.sqrt(12.0), 1e-6
#: how fast the offset between motor and screw may change, and the voltage that a load eats, in a root of a second
OFFSET_RAD, LOAD_V = 0.03, 1.0


@dataclass(frozen=True)
class Observer:
    """x[k+1] = A x + B u + L (y - C x), y = (theta_m, q3): shapes (n, n), (n,), (2, n), (n, 2)."""

    A: Array
    B: Array
    C: Array
    L: Array


def plant(motor: MotorParameters, structure: StructureParameters, sample_time_s: float) -> tuple[Array, Array, Array]:
    """A (n, n), B (n,), C (2, n): u -> (theta_m, q3), sampled as one with a hold of the voltage."""
    first, second = motor_ss(motor), structure_ss(structure)
    angle = np.asarray(first.C)[1:]
    n, m = first.nstates, second.nstates
    a, b = np.zeros((n + m, n + m)), np.zeros(n + m)
    a[:n, :n], a[n:, n:], a[n:, :n] = first.A, second.A, second.B @ angle
    b[:n] = np.asarray(first.B)[:, 0]
    wide = np.zeros((n + m + 1, n + m + 1))
    wide[:-1, :-1], wide[:-1, -1] = a, b
    held = scipy.linalg.expm(sample_time_s * wide)
    c = np.zeros((2, n + m))
    c[0, :n], c[1, n:] = angle[0], np.asarray(second.C)[0]
    return held[:-1, :-1], held[:-1, -1], c


def kalman(
    system: tuple[Array, Array, Array], noise: tuple[float, float], sample_time_s: float, disturbed: bool = True
) -> Observer:
    """The filter of the plant a, b, c; ``disturbed``: with d, rad, and l, V, behind its states.

    noise : rms of the measured angle, rad, and of the output, m; at least ANGLE_RAD and OUTPUT_M.
    """
    import control

    a, b, c = system
    n, more = b.size, 2 * disturbed
    wide, into, seen = np.eye(n + more), np.append(b, np.zeros(more)), np.zeros((2, n + more))
    wide[:n, :n], seen[:, :n] = a, c
    moving = DISTURBING_V**2 * np.outer(into, into)
    if disturbed:
        wide[:n, n], wide[:n, n + 1] = a @ c[0] - c[0], b  # an offset moves the structure as the motor's angle does
        moving[n, n], moving[n + 1, n + 1] = OFFSET_RAD**2 * sample_time_s, LOAD_V**2 * sample_time_s
    least = np.maximum(noise, (ANGLE_RAD, OUTPUT_M))
    gain, _, _ = control.dlqe(wide, np.eye(n + more), seen, moving, np.diag(least**2))
    return Observer(wide, into, seen, np.asarray(gain))
