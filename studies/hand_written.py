"""The paper's closed loop as one would write it by hand for numba, for speed: one function, every number a scalar.

The same equations as the package's loop: motor (1)-(4), backlash (16)-(17), structure (8), NIMC with the paper's
internal model. The plant is stepped by its exact solution, a sample at a time, in two versions: gear out of contact and
in contact. Where the gear closes or opens, the sample is halved until the event is found; that is rare, and written
with loops. Products are summed in whatever order is fast. It records what the paper plots and knows this rig alone:
no sensors, no effects, no delays, no other sizes, nobody who listens for alarms. With ``lock_in`` it does what the
package's loop does on this scenario: the novelty index, and all columns of the trace.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from scipy.linalg import expm

from dtbacklash.arrays import Floats
from studies.scenario import Scenario

#: halvings of a sample down to the time to which an event is found
HALVINGS = 16
#: what the gear may move beyond an event that counts as found, rad
NEAR_RAD = 1e-12
#: columns of the solution: the states i, omega, theta, q2, q3, v2, v3, then voltage, theta_d - theta and its rate
STATES, INPUTS = 7, 3


def _solution(scenario: Scenario, step_s: float, contact: bool) -> Floats:
    """(7, 10) states after a step, from states and inputs; out of contact the second input is theta_d itself."""
    motor, structure = scenario.motor, scenario.structure
    m, k, c = structure.masses_kg[0], structure.stiffnesses_n_per_m[0], structure.dampings_n_s_per_m[0]
    p = structure.pitch_m_per_rad
    A = np.zeros((STATES + INPUTS, STATES + INPUTS))
    A[0, [0, 1, 7]] = -motor.R / motor.L, -motor.k_B / motor.L, 1.0 / motor.L
    A[1, 0] = motor.k_T / motor.J
    A[2, 1] = A[3, 5] = A[4, 6] = A[8, 9] = 1.0
    A[5, 3:7] = -2.0 * k / m, k / m, -2.0 * c / m, c / m
    A[6, 3:7] = k / m, -k / m, c / m, -c / m
    A[5, 8:10] = k * p / m, c * p / m
    if contact:
        A[5, [2, 1]] = k * p / m, c * p / m
    return np.asarray(expm(A * step_s)[:STATES])


@njit(error_model="numpy")
def _halve(contact, free, x, y, u, is_free, side, theta_d, gap, rate, step):  # type: ignore[no-untyped-def]
    """One sample in which the gear closes or opens: (out of contact?, side, theta_d) at its end, x in place."""
    last = contact.shape[0] - 1
    ticks = 1 << last
    tick = least = 0
    while tick < ticks:
        level = least
        while (ticks >> level) > ticks - tick:
            level += 1
        h = step * (ticks >> level) / ticks
        begin = gap + rate * step * tick / ticks
        end = begin + rate * h
        E = free[level] if is_free else contact[level]
        offset, speed = (theta_d, 0.0) if is_free else (-side * begin, -side * rate)
        for i in range(7):
            y[i] = E[i, 7] * u + E[i, 8] * offset + E[i, 9] * speed
            for j in range(7):
                y[i] += E[i, j] * x[j]
        beyond = abs(y[2] - theta_d) - end if is_free else (rate - side * y[1]) * h
        if beyond > NEAR_RAD and level < last:
            least = level + 1
            continue
        x[:] = y
        tick += ticks >> level
        least = 0 if beyond > 0.0 or least == last else least + (least > 0)
        if beyond > 0.0 and is_free:
            is_free, side = False, 1.0 if x[2] > theta_d else -1.0
        elif beyond > 0.0:
            is_free, theta_d = True, x[2] - side * end
    return is_free, side, theta_d


@njit(error_model="numpy")
def _loop(r, gap, gap_hat, contact, free, gain, W, M, S, lock_in, step, out):  # type: ignore[no-untyped-def]  # noqa: PLR0915
    wa00, wa01, wa02, wa10, wa11, wa12, wa20, wa21, wa22, wb0, wb1, wb2, wc0, wc1, wc2 = W
    ma00, ma01, ma10, ma11, mb0, mb1 = M
    sa00, sa01, sa02, sa03, sa10, sa11, sa12, sa13, sa20, sa21, sa22, sa23, sa30, sa31, sa32, sa33 = S[:16]
    sb0, sb1, sb2, sb3 = S[16:]
    F = contact[0]
    ii, io, oi, oo, ti, to, iu, ou, tu = F[0, 0], F[0, 1], F[1, 0], F[1, 1], F[2, 0], F[2, 1], F[0, 7], F[1, 7], F[2, 7]
    a30, a31, _, a33, a34, a35, a36, a37, a38, a39 = F[3]
    a40, a41, _, a43, a44, a45, a46, a47, a48, a49 = F[4]
    a50, a51, _, a53, a54, a55, a56, a57, a58, a59 = F[5]
    a60, a61, _, a63, a64, a65, a66, a67, a68, a69 = F[6]
    f3, f4, f5, f6 = free[0, 3:7, 8]
    x, y = np.zeros(7), np.zeros(7)
    i = omega = theta = q2 = q3 = v2 = v3 = theta_d = 0.0
    w0 = w1 = w2 = m0 = m1 = model_d = s0 = s1 = s2 = s3 = 0.0
    is_free, side, last = False, 0.0, r.size - 1
    if lock_in is not None:
        g0, g1, g2, g3, g4, h0, h1, h2, h3, h4, cosine, sine = lock_in
        real, imag = 1.0, 0.0
        c0 = c1 = c2 = c3 = d0 = d1 = d2 = d3 = 0.0
    for n in range(r.size):
        half = gap[n]
        if not is_free:
            theta_d = theta - side * half
        # controller
        eps = q3 - s1
        error = r[n] - eps
        u = gain * (wc0 * w0 + wc1 * w1 + wc2 * w2 - model_d)
        w0, w1, w2 = (
            wa00 * w0 + wa01 * w1 + (wa02 * w2 + wb0 * error),
            wa10 * w0 + wa11 * w1 + (wa12 * w2 + wb1 * error),
            wa20 * w0 + wa21 * w1 + (wa22 * w2 + wb2 * error),
        )
        s0, s1, s2, s3 = (
            (sa00 * s0 + sa01 * s1) + (sa02 * s2 + sa03 * s3) + sb0 * model_d,
            (sa10 * s0 + sa11 * s1) + (sa12 * s2 + sa13 * s3) + sb1 * model_d,
            (sa20 * s0 + sa21 * s1) + (sa22 * s2 + sa23 * s3) + sb2 * model_d,
            (sa30 * s0 + sa31 * s1) + (sa32 * s2 + sa33 * s3) + sb3 * model_d,
        )
        z = theta - model_d
        if (m1 > 0.0 and z >= gap_hat[n]) or (m1 < 0.0 and z <= -gap_hat[n]):
            model_d += m1 * step
        m0, m1 = ma00 * m0 + ma01 * m1 + mb0 * u, ma10 * m0 + ma11 * m1 + mb1 * u
        out[0, n], out[1, n], out[2, n], out[3, n], out[4, n] = q3, u, theta, theta_d, eps
        if lock_in is not None:
            error = 2.0 * eps * real
            value = g0 * error + c0
            c0 = g1 * error - g3 * value + c1
            c1 = g2 * error - g4 * value
            cos = h0 * value + c2
            c2 = h1 * value - h3 * cos + c3
            c3 = h2 * value - h4 * cos
            error = 2.0 * eps * imag
            value = g0 * error + d0
            d0 = g1 * error - g3 * value + d1
            d1 = g2 * error - g4 * value
            sin = h0 * value + d2
            d2 = h1 * value - h3 * sin + d3
            d3 = h2 * value - h4 * sin
            real, imag = real * cosine - imag * sine, real * sine + imag * cosine
            pull = 1.5 - 0.5 * (real * real + imag * imag)
            real, imag = real * pull, imag * pull
            out[5, n], out[6, n], out[7, n], out[8, n] = np.sqrt(cos * cos + sin * sin), gap_hat[n], q2, omega
            out[9, n], out[10, n], out[11, n], out[12, n] = q3, theta, q2, omega
        if n == last:
            break
        # plant
        after = gap[n + 1]
        rate = (after - half) / step
        if side == 0.0 and not is_free:
            if half > 0.0 or after > 0.0:
                is_free = True
        elif side * omega < rate and not is_free:
            theta_d, is_free = theta - side * half, True
        next_omega = oi * i + oo * omega + ou * u
        next_theta = ti * i + to * omega + tu * u + theta
        if abs(next_theta - theta_d) > after if is_free else side != 0.0 and side * next_omega < rate:
            x[0], x[1], x[2], x[3], x[4], x[5], x[6] = i, omega, theta, q2, q3, v2, v3
            is_free, side, theta_d = _halve(contact, free, x, y, u, is_free, side, theta_d, half, rate, step)
            i, omega, theta, q2, q3, v2, v3 = x[0], x[1], x[2], x[3], x[4], x[5], x[6]
            continue
        if is_free:
            q2, q3, v2, v3 = (
                (a33 * q2 + a34 * q3) + (a35 * v2 + a36 * v3) + f3 * theta_d,
                (a43 * q2 + a44 * q3) + (a45 * v2 + a46 * v3) + f4 * theta_d,
                (a53 * q2 + a54 * q3) + (a55 * v2 + a56 * v3) + f5 * theta_d,
                (a63 * q2 + a64 * q3) + (a65 * v2 + a66 * v3) + f6 * theta_d,
            )
        else:
            d, s = theta - side * half, -side * rate
            q2, q3, v2, v3 = (
                ((a33 * q2 + a34 * q3) + (a35 * v2 + a36 * v3))
                + ((a30 * i + a31 * omega) + (a37 * u + a38 * d) + a39 * s),
                ((a43 * q2 + a44 * q3) + (a45 * v2 + a46 * v3))
                + ((a40 * i + a41 * omega) + (a47 * u + a48 * d) + a49 * s),
                ((a53 * q2 + a54 * q3) + (a55 * v2 + a56 * v3))
                + ((a50 * i + a51 * omega) + (a57 * u + a58 * d) + a59 * s),
                ((a63 * q2 + a64 * q3) + (a65 * v2 + a66 * v3))
                + ((a60 * i + a61 * omega) + (a67 * u + a68 * d) + a69 * s),
            )  # fmt: skip
        i, omega, theta = ii * i + io * omega + iu * u, next_omega, next_theta


def _flat(*arrays: Any) -> tuple[float, ...]:
    return tuple(float(value) for array in arrays for value in np.ravel(array))


def _arguments(scenario: Scenario, everything: bool) -> tuple[Any, ...]:
    """All arguments of the loop but where it writes."""
    design, step_s = scenario.design, scenario.config.sample_time_s
    W, M, S = design.prefilter, design.motor_position, design.structure
    solved = [
        np.array([_solution(scenario, step_s / 2**level, contact) for level in range(HALVINGS + 1)])
        for contact in (True, False)
    ]
    lock_in = None
    if everything:
        first, second = (np.delete(row, 3) for row in scenario.detector.sos)
        lock_in = _flat(first, second, scenario.detector.cos_step, scenario.detector.sin_step)
    return (
        scenario.reference_m, scenario.gap_rad, scenario.gap_hat_rad, *solved, design.k_theta_v_per_rad,
        _flat(W.A, W.B, W.C), _flat(M.A[:2, :2], M.B[:2]), _flat(S.A, S.B), lock_in, step_s,
    )  # fmt: skip


class HandWritten:
    """The loop, ready for a scenario: called, it gives q3 [m]. The first call compiles.

    everything : with the novelty index and all columns that the package's loop records.
    """

    def __init__(self, scenario: Scenario, everything: bool = False) -> None:
        self.arguments = _arguments(scenario, everything)
        self.shape = (13 if everything else 5, scenario.reference_m.size)

    def __call__(self) -> Floats:
        out = np.zeros(self.shape)
        _loop(*self.arguments, out)
        return out[0]
