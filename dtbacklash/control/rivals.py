"""The controllers that one would use instead: a PID with two degrees of freedom, an LQG, and one with an offset state.

All are linear laws of reference, measured angle and measured output, with a voltage that is limited:
``x[k+1] = A x + B (r, theta_m, q3) + E u``, ``u = limited(C x + D (r, theta_m, q3))``. PID and offset controller lead
motor and structure along the motion that the prefilter makes of the reference (:func:`led`), and feed back the rest.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy

from dtbacklash.control.chain import Array, MotorParameters, StructureParameters, dominant_frequency
from dtbacklash.control.design import ControllerDesign, SampledModel, prefilter, sampled
from dtbacklash.control.linear_law import LinearLaw
from dtbacklash.control.margins import Curves, DesignedLoop, response
from dtbacklash.control.observer import OUTPUT_M, kalman, plant
from dtbacklash.errors import UserError

#: the derivative's filter over the derivative time, as PID controllers are shipped
FILTER_SHARE = 0.1
#: of the PID's outer loop: largest sensitivity (Astrom and Hagglund, Advanced PID Control, 2006: 1.2 to 2)
SENSITIVITY = 2.0
#: and where it is looked for: gain over that of the reference at rest, Ti and Td times the dominant mode's frequency
PID_BOUNDS = ((0.01, 1.0), (0.05, 5.0), (0.5, 20.0))
#: LQG, Bryson's rule: the output error (m) and the voltage that are as bad as each other; the integral of the error is
#: as bad after the time constant of the prefilter
ERROR_M, EFFORT_V = 1e-3, 12.0
#: the same of the offset controller: errors of the output, of the motor's angle as the screw moves the output by it,
#: and of the output's speed over the dominant mode's frequency, m, and the voltage
OUTPUT_ERROR_M, ANGLE_ERROR_M, SPEED_ERROR_M, OFFSET_EFFORT_V = 2e-3, 1e-3, 0.75e-3, 3.0
#: share of the servo's lag by which the reference leads it
LEAD = 0.5
#: how near the small-gain bound comes to the one that is asked for, and the output's largest noise for it, m
NEAR, LARGEST_NOISE_M = 0.995, 1e-2


def led(filtered: SampledModel, system: tuple[Array, Array, Array], gain: float) -> tuple[LinearLaw, int]:
    """r -> the voltage that leads the plant a, b, c along W r by ``gain`` (V/rad) (theta_ref - theta_m); no feedback.

    States: of the prefilter, then, from the index that is returned, of the plant on its way.
    """
    a, b, c = system
    n, first = b.size, filtered.order
    law_c = gain * np.append(filtered.C[0], -c[0])
    d = gain * filtered.D[0, 0]
    law_a, law_b = np.zeros((first + n, first + n)), np.zeros((first + n, 3))
    law_a[:first, :first], law_b[:first, 0] = filtered.A, filtered.B[:, 0]
    law_a[first:, first:] = a
    law_a[first:] += np.outer(b, law_c)
    law_b[first:, 0] = b * d
    return LinearLaw(law_a, law_b, law_c, np.array([d, 0.0, 0.0]), np.zeros(first + n)), first


def pid_law(design: ControllerDesign, motor: MotorParameters, structure: StructureParameters) -> LinearLaw:
    """W r, and a PID on what the output lacks of the motion along it, over ``u = k_theta (theta_ref - theta_m)``.

    The PID behind a filter of Td/10 has those of all gains, Ti and Td whose slowest pole of the closed loop decays
    fastest while the sensitivity of the outer loop stays below SENSITIVITY. Back-calculation with the time 1/omega_d
    keeps the integral from winding up. Sampled exactly for an error that is held.
    """
    step, k_theta = design.sample_time_s, design.k_theta_v_per_rad
    system = plant(motor, structure, step)
    _, _, c = system
    ahead, first = led(design.prefilter, system, k_theta)
    direct, slow, fast, kept = pid_parts(design, system, 1.0 / structure.static_gain_m_per_rad)
    n = ahead.C.size
    error = np.append(np.zeros((2 + first,)), c[1])  # of the states, without what is measured
    law_a = scipy.linalg.block_diag(np.diag([1.0, kept]), ahead.A)
    law_b = np.vstack([np.zeros((2, 3)), ahead.B])
    for row, share in enumerate((step, 1.0 - kept)):
        law_a[row] += share * error
        law_b[row, 2] = -share
    law_c = np.append(k_theta * np.array([slow, fast]), np.zeros(n)) + k_theta * direct * error
    law_c[2 : 2 + first], law_d = ahead.C[:first], k_theta * np.array([0.0, -1.0, -direct])
    back = np.zeros(2 + n)  # what the limit takes away, led back: back (u - C x - D y)
    back[0] = step * design.dominant_frequency_rad_s / (k_theta * slow)
    law_d += ahead.D
    return LinearLaw(law_a - np.outer(back, law_c), law_b - np.outer(back, law_d), law_c, law_d, back)


def pid_parts(
    design: ControllerDesign, system: tuple[Array, Array, Array], per_m: float
) -> tuple[float, float, float, float]:
    """Of the tuned PID in rad/m: what passes at once, the integral's rate (1/s), the filtered rest, the filter's pole.

    per_m : rad of the screw for a metre of the output at rest.
    """
    a, b, c = system
    step, k_theta, mode = design.sample_time_s, design.k_theta_v_per_rad, design.dominant_frequency_rad_s
    n = b.size
    omega = np.geomspace(0.02 * mode, min(50.0 * mode, math.pi / step), 300)
    servo = k_theta * response(design.motor_position, omega, step)
    process = servo / (1.0 + servo) * response(design.structure, omega, step)
    z = np.exp(1j * omega * step)

    def parts(x: Array) -> tuple[float, float, float, float]:
        gain, ti, td = per_m * math.exp(x[0]), math.exp(x[1]) / mode, math.exp(x[2]) / mode
        tf = FILTER_SHARE * td
        # gain (1 + 1/(ti s) + td s)/(tf s + 1) = direct + slow/s + fast/(tf s + 1)
        direct, slow = gain * td / tf, gain / ti
        return direct, slow, gain - direct - slow * tf, math.exp(-step / tf)

    def slowest(x: Array) -> float:
        """The decay of the slowest pole over the mode's frequency, negative, and what is too much of sensitivity."""
        direct, slow, fast, kept = parts(x)
        loop = np.zeros((n + 2, n + 2))
        loop[:n, :n] = a - k_theta * np.outer(b, c[0] + direct * c[1])
        loop[:n, n:] = k_theta * np.outer(b, [slow, fast])
        loop[n:, :n], loop[n, n], loop[n + 1, n + 1] = -np.outer([step, 1.0 - kept], c[1]), 1.0, kept
        decay = math.log(np.abs(np.linalg.eigvals(loop)).max()) / step / mode
        pid = direct + slow * step / (z - 1.0) + fast * (1.0 - kept) / (z - kept)
        return decay + 10.0 * max(0.0, float(np.max(1.0 / np.abs(1.0 + process * pid))) - SENSITIVITY)

    bounds = scipy.optimize.Bounds(*np.log(np.transpose(PID_BOUNDS)))
    return parts(scipy.optimize.differential_evolution(slowest, bounds, seed=0, tol=1e-6, polish=False).x)


def lqg_law(
    motor: MotorParameters, structure: StructureParameters, tau_r_s: float, sample_time_s: float,
    noise: tuple[float, float],
) -> LinearLaw:  # fmt: skip
    """A Kalman filter of motor and structure, and LQ feedback of its state and of the integral of r - q3.

    Weights by Bryson's rule from ERROR_M, EFFORT_V and tau_r. noise : see :func:`.observer.kalman`. The observer is
    driven by the limited voltage, and the integral stops while the voltage is limited (back-calculation).
    """
    import control

    system = plant(motor, structure, sample_time_s)
    (a, b, c), seen = system, kalman(system, noise, sample_time_s, disturbed=False)
    n = b.size
    wide, into = np.zeros((n + 1, n + 1)), np.append(b, 0.0)
    wide[:n, :n], wide[n, :n], wide[n, n] = a, -sample_time_s * c[1], 1.0
    cost = scipy.linalg.block_diag(np.outer(c[1], c[1]) / ERROR_M**2, np.array([[1.0 / (ERROR_M * tau_r_s) ** 2]]))
    k = np.asarray(control.dlqr(wide, into[:, None], cost, [[1.0 / EFFORT_V**2]])[0])[0]
    # the reference comes in by the integral alone: beside it, a share of its own would make every step overshoot
    law_c, law_d = -k, np.zeros(3)
    law_a, law_b = scipy.linalg.block_diag(a - seen.L @ c, np.eye(1)), np.zeros((n + 1, 3))
    law_b[:n, 1:], law_b[n, 0], law_b[n, 2] = seen.L, sample_time_s, -sample_time_s
    led_back = np.zeros(n + 1)
    led_back[n] = -sample_time_s / (k[n] * tau_r_s)
    return LinearLaw(law_a - np.outer(led_back, law_c), law_b, law_c, law_d, into + led_back)


def offset_law(
    motor: MotorParameters, structure: StructureParameters, kind: str, tau_r_s: float, sample_time_s: float,
    noise: tuple[float, float],
) -> LinearLaw:  # fmt: skip
    """A Kalman filter with the offset d and the voltage l, and LQ feedback of what differs from the motion along W r.

    ``u = u_ref - k (x + d - x_ref) - l``: the motor makes up for d. W is :func:`.design.prefilter`, its time
    constant less LEAD times the servo's lag. Weights by Bryson's rule. noise : see :func:`.observer.kalman`.
    """
    import control

    system = plant(motor, structure, sample_time_s)
    (a, b, c), seen = system, kalman(system, noise, sample_time_s)
    n, screw = b.size, structure.static_gain_m_per_rad * c[0]
    speed = (c[1] @ a - c[1]) / (sample_time_s * dominant_frequency(structure))
    weighed = ((c[1], OUTPUT_ERROR_M), (screw, ANGLE_ERROR_M), (speed, SPEED_ERROR_M))
    cost = sum(np.outer(row, row) / size**2 for row, size in weighed)
    k = np.asarray(control.dlqr(a, b[:, None], cost, [[1.0 / OFFSET_EFFORT_V**2]])[0])[0]
    gain = float(k @ c[0])
    lag = 1.0 / (gain * float(np.linalg.solve(np.eye(2) - a[:2, :2], b[:2])[1]))
    filtered = sampled(prefilter(structure, kind, max(tau_r_s - LEAD * lag, 0.5 * tau_r_s)), sample_time_s)
    ahead, first = led(filtered, system, gain)
    on_the_way = ahead.C.copy()
    on_the_way[first:] += k
    return LinearLaw(
        scipy.linalg.block_diag(seen.A - seen.L @ seen.C, ahead.A),
        np.vstack([np.hstack([np.zeros((n + 2, 1)), seen.L]), ahead.B]),
        np.concatenate([-k, [-gain, -1.0], on_the_way]), ahead.D, np.append(seen.B, np.zeros(ahead.C.size)),
    )  # fmt: skip


def robust_law(
    loop: DesignedLoop, motor: MotorParameters, structure: StructureParameters, kind: str, noise: tuple[float, float],
    bound: float | None,
) -> LinearLaw:  # fmt: skip
    """The :func:`offset_law` of the least noise of the output, not below its own, whose small-gain bound is ``bound``.

    loop : what it controls, and its variations. bound : None for none.
    """
    step, mode = loop.design.sample_time_s, loop.design.dominant_frequency_rad_s
    omega = np.geomspace(0.1 * mode, min(30.0 * mode, math.pi / step), 600)

    def law_of(output: float) -> LinearLaw:
        return offset_law(motor, structure, kind, loop.tau_r_s, step, (noise[0], output))

    def too_large(output: float) -> bool:
        tried = replace(loop, design=replace(loop.design, law=law_of(output)))
        return bound is not None and bool(np.max(Curves(tried, omega).moved) > NEAR * bound)

    low, high = max(noise[1], OUTPUT_M), max(noise[1], LARGEST_NOISE_M)
    if not too_large(low):
        return law_of(low)
    if too_large(high):
        raise UserError(
            "controller.robust", bound, "a larger one, or null: the tolerances of the motor alone exceed it"
        )
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if too_large(middle) else (low, middle)
    return law_of(high)
