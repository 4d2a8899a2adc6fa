"""The controllers that one would use instead: a PID in cascade and an LQG with integral action, each by a stated rule.

Both are linear laws of reference, measured angle and measured output, with a voltage that is limited:
``x[k+1] = A x + B (r, theta_m, q3) + E u``, ``u = limited(C x + D (r, theta_m, q3))``.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg

from dtbacklash.control.design import (
    Array,
    MotorParameters,
    StructureParameters,
    motor_ss,
    reduced_structure,
    structure_ss,
)
from dtbacklash.control.linear_law import LinearLaw

#: the derivative's filter over the derivative time, as PID controllers are shipped
FILTER_SHARE = 0.1
#: LQG, Bryson's rule: the output error (m) and the voltage that are as bad as each other; the integral of the error is
#: as bad after the time constant of the prefilter
ERROR_M, EFFORT_V = 1e-3, 12.0
#: Kalman filter: disturbing voltage (V), and the noise of angle (rad: counts of 4096 a turn) and output (m), rms
DISTURBING_V, ANGLE_RAD, OUTPUT_M = 1.0, 2.0 * math.pi / 4096 / math.sqrt(12.0), 1e-6


def pid_law(structure: StructureParameters, k_theta: float, tau_r_s: float, sample_time_s: float) -> LinearLaw:
    """PID on the output in cascade over ``u = k_theta (theta_ref - theta_m)``, tuned by IMC rules (lambda tuning).

    For the dominant mode with tau^2 s^2 + 2 zeta tau s + 1 and a closed loop of the time constant tau_r:
    Kc = 2 zeta tau/(p tau_r), Ti = 2 zeta tau, Td = tau/(2 zeta) (Rivera, Morari and Skogestad, 1986, Table 1), here
    behind a filter of Td/10. Back-calculation with the time tau keeps the integral from winding up. Sampled exactly for
    an error that is held.

    Raises
    ------
    UserError : the structure has no damping.
    """
    pole = _slowest(reduced_structure(structure).poles())
    tau, zeta = 1.0 / abs(pole), -pole.real / abs(pole)
    ti, td = 2.0 * zeta * tau, tau / (2.0 * zeta)
    gain, tf = ti / (structure.static_gain_m_per_rad * tau_r_s), FILTER_SHARE * td
    # gain (1 + 1/(ti s) + td s)/(tf s + 1) = direct + slow/s + fast/(tf s + 1)
    direct, slow = gain * td / tf, gain / ti
    fast = gain - direct - slow * tf
    kept, back = math.exp(-sample_time_s / tf), sample_time_s / (k_theta * slow * tau)
    error = np.array([1.0, 0.0, -1.0])
    c = k_theta * np.array([slow, fast])
    d = k_theta * (direct * error - np.array([0.0, 1.0, 0.0]))
    a, b = np.diag([1.0, kept]), np.outer([sample_time_s, 1.0 - kept], error)
    e = np.array([back, 0.0])  # what the limit takes away, led back: back (u - C x - D y)
    return LinearLaw(a - np.outer(e, c), b - np.outer(e, d), c, d, e)


def lqg_law(motor: MotorParameters, structure: StructureParameters, tau_r_s: float, sample_time_s: float) -> LinearLaw:
    """A Kalman filter of motor and structure, and LQ feedback of its state and of the integral of r - q3.

    Weights by Bryson's rule from ERROR_M, EFFORT_V and tau_r; noises DISTURBING_V, ANGLE_RAD, OUTPUT_M. The observer is
    driven by the limited voltage, and the integral stops while the voltage is limited (back-calculation).
    """
    a, b, c = plant(motor, structure, sample_time_s)
    n = a.shape[0]
    noise = np.diag([ANGLE_RAD**2, OUTPUT_M**2])
    spread = linalg.solve_discrete_are(a.T, c.T, DISTURBING_V**2 * np.outer(b, b), noise)
    gain = a @ spread @ c.T @ np.linalg.inv(c @ spread @ c.T + noise)
    wide, into = np.zeros((n + 1, n + 1)), np.append(b, 0.0)
    wide[:n, :n], wide[n, :n], wide[n, n] = a, -sample_time_s * c[1], 1.0
    cost = np.zeros_like(wide)
    cost[:n, :n] = np.outer(c[1], c[1]) / ERROR_M**2
    cost[n, n] = 1.0 / (ERROR_M * tau_r_s) ** 2
    effort = np.array([[1.0 / EFFORT_V**2]])
    bad = linalg.solve_discrete_are(wide, into[:, None], cost, effort)
    k = np.linalg.solve(effort + into[None, :] @ bad @ into[:, None], into[None, :] @ bad @ wide)[0]
    # the reference comes in by the integral alone: beside it, a share of its own would make every step overshoot
    law_c, law_d = -k, np.zeros(3)
    law_a, law_b, law_e = np.zeros_like(wide), np.zeros((n + 1, 3)), np.append(b, 0.0)
    law_a[:n, :n], law_a[n, n] = a - gain @ c, 1.0
    law_b[:n, 1:], law_b[n, 0], law_b[n, 2] = gain, sample_time_s, -sample_time_s
    led_back = np.zeros(n + 1)
    led_back[n] = -sample_time_s / (k[n] * tau_r_s)
    return LinearLaw(law_a - np.outer(led_back, law_c), law_b, law_c, law_d, law_e + led_back)


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
    held = linalg.expm(sample_time_s * wide)
    c = np.zeros((2, n + m))
    c[0, :n], c[1, n:] = angle[0], np.asarray(second.C)[0]
    return held[:-1, :-1], held[:-1, -1], c


def _slowest(poles: Array) -> complex:
    """The pole that decays most slowly."""
    return complex(poles[np.argmax(poles.real)])
