"""The paper's closed loop as one would write it by hand for numba: one function, scalars, ten substeps a sample.

The same equations as the package's loop: motor (1)-(4), backlash (16)-(17), structure (8), NIMC with the paper's
internal model. The plant is stepped by semi-implicit Euler, the cheapest method that is stable here (the motor's
electrical pole lies at -12000 rad/s), so that the comparison favours this loop in speed. It records what the
paper plots, and has no sensors, no novelty index, no friction and no other rig.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.scenario import Scenario

Floats = NDArray[np.float64]
SUBSTEPS = 10


@njit(error_model="numpy")
def _loop(r, gap, gap_hat, motor, structure, gain, W, M, S, step, out):  # type: ignore[no-untyped-def]
    J, L, R, k_T, k_B = motor
    m, k, c, p = structure
    wa, wb, wc, wd = W
    ma, mb = M
    sa, sb, sc = S
    xw, xm, xs = np.zeros(wb.size), np.zeros(3), np.zeros(4)
    new_w, new_m, new_s = np.zeros(wb.size), np.zeros(3), np.zeros(4)
    h = step / SUBSTEPS
    i = omega = theta = q2 = v2 = q3 = v3 = theta_d = model_d = 0.0
    for n in range(r.size):
        # controller
        eps = q3
        for a in range(4):
            eps -= sc[a] * xs[a]
        error = r[n] - eps
        theta_ref = wd * error
        for a in range(wb.size):
            theta_ref += wc[a] * xw[a]
            new_w[a] = wb[a] * error
            for b in range(wb.size):
                new_w[a] += wa[a, b] * xw[b]
        u = gain * (theta_ref - model_d)
        for a in range(4):
            new_s[a] = sb[a] * model_d
            for b in range(4):
                new_s[a] += sa[a, b] * xs[b]
        z = theta - model_d
        if (xm[1] > 0.0 and z >= gap_hat[n]) or (xm[1] < 0.0 and z <= -gap_hat[n]):
            model_d += xm[1] * step
        for a in range(3):
            new_m[a] = mb[a] * u
            for b in range(3):
                new_m[a] += ma[a, b] * xm[b]
        xw[:], xm[:], xs[:] = new_w, new_m, new_s
        out[0, n], out[1, n], out[2, n], out[3, n], out[4, n] = q3, u, theta, theta_d, eps
        # plant
        half = gap[n]
        growth = (gap[min(n + 1, r.size - 1)] - half) / SUBSTEPS
        for _ in range(SUBSTEPS):
            i += h * (u - R * i - k_B * omega) / L
            omega += h * k_T * i / J
            theta += h * omega
            half += growth
            was = theta_d
            theta_d = min(max(theta_d, theta - half), theta + half)
            q1, v1 = p * theta_d, p * (theta_d - was) / h
            a2 = (k * (q1 - q2) + c * (v1 - v2) - k * (q2 - q3) - c * (v2 - v3)) / m
            a3 = (k * (q2 - q3) + c * (v2 - v3)) / m
            v2 += h * a2
            v3 += h * a3
            q2 += h * v2
            q3 += h * v3


def hand_written(scenario: Scenario) -> Floats:
    """q3 [m] by the hand-written loop; the first call compiles it."""
    design, motor, structure = scenario.design, scenario.motor, scenario.structure
    W, M, S = design.prefilter, design.motor_position, design.structure
    out = np.zeros((5, scenario.reference_m.size))
    _loop(
        scenario.reference_m, scenario.gap_rad, scenario.gap_hat_rad,
        (motor.J, motor.L, motor.R, motor.k_T, motor.k_B),
        (structure.masses_kg[0], structure.stiffnesses_n_per_m[0], structure.dampings_n_s_per_m[0],
         structure.pitch_m_per_rad),
        design.k_theta_v_per_rad,
        (W.A, W.B.ravel(), W.C.ravel(), float(W.D[0, 0])), (M.A, M.B.ravel()), (S.A, S.B.ravel(), S.C.ravel()),
        scenario.config.sample_time_s, out,
    )  # fmt: skip
    return out[0]
