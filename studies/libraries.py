"""The same closed loop by general libraries: python-control, all discrete, and SciPy's ``solve_ivp``.

Both are written as their users would write them, in plain Python, and are slow. A test compares their q3 with ours on
the short scenario.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.design import SampledModel
from studies.scenario import Scenario

SUBSTEPS = 10


def _motion(scenario: Scenario) -> Callable[[float, Any, float, float, float], list[float]]:
    """Rates of (i, omega, theta, q2, v2, q3, v3) for a voltage, theta_d and its rate: eqs (1)-(4) and (8)."""
    motor, structure = scenario.motor, scenario.structure
    m, k, c = structure.masses_kg[0], structure.stiffnesses_n_per_m[0], structure.dampings_n_s_per_m[0]
    p = structure.pitch_m_per_rad

    def rates(t: float, x: Any, u: float, theta_d: float, rate: float) -> list[float]:
        i, omega, _, q2, v2, q3, v3 = x[:7]
        upper = k * (q2 - q3) + c * (v2 - v3)
        lower = k * (p * theta_d - q2) + c * (p * rate - v2)
        current = (u - motor.R * i - motor.k_B * omega) / motor.L
        return [current, motor.k_T * i / motor.J, omega, v2, (lower - upper) / m, v3, upper / m]

    return rates


def _next(model: SampledModel, x: Floats, u: float) -> Floats:
    return np.asarray(model.A @ x + model.B[:, 0] * u)


class _Nimc:
    """The controller of Figure 9 in plain numpy, one call a sample; states: W, motor, structure, theta_d^."""

    def __init__(self, scenario: Scenario) -> None:
        design = scenario.design
        self.models = design.prefilter, design.motor_position, design.structure
        self.ends = np.cumsum([model.order for model in self.models])
        self.gain, self.step = design.k_theta_v_per_rad, design.sample_time_s

    def output(self, x: Floats, r: float, q3: float) -> tuple[float, float]:
        """Voltage and r - eps."""
        w, _, s = np.split(x[:-1], self.ends[:-1])
        W, _, S = self.models
        error = r - (q3 - float(S.C[0] @ s))
        return self.gain * (float(W.C[0] @ w) + W.D[0, 0] * error - x[-1]), error

    def update(self, x: Floats, r: float, theta_m: float, q3: float, gap_hat: float) -> Floats:
        """The states at the next sample."""
        w, m, s = np.split(x[:-1], self.ends[:-1])
        W, M, S = self.models
        u, error = self.output(x, r, q3)
        z, omega, theta_d = theta_m - x[-1], m[1], x[-1]
        moving = (omega > 0 and z >= gap_hat) or (omega < 0 and z <= -gap_hat)
        after = theta_d + omega * self.step if moving else theta_d
        return np.concatenate([_next(W, w, error), _next(M, m, u), _next(S, s, theta_d), [after]])

    @property
    def order(self) -> int:
        return int(self.ends[-1]) + 1


def python_control(scenario: Scenario) -> Floats:
    """q3 [m] by ``control.input_output_response`` of two discrete blocks, the plant stepped ten times a sample."""
    import control

    nimc, rates, step = _Nimc(scenario), _motion(scenario), scenario.config.sample_time_s
    gap, h = float(scenario.gap_rad[0]), step / SUBSTEPS

    def plant(t: float, x: Any, u: Any, params: Any) -> Any:
        x = [float(value) for value in x]
        for _ in range(SUBSTEPS):  # semi-implicit Euler
            i, omega, theta, q2, v2, q3, v3, theta_d = x
            i += h * rates(t, x, u[0], theta_d, 0.0)[0]
            omega += h * scenario.motor.k_T * i / scenario.motor.J
            theta += h * omega
            after = min(max(theta_d, theta - gap), theta + gap)
            moved = rates(t, (i, omega, theta, q2, v2, q3, v3), u[0], after, (after - theta_d) / h)
            v2, v3 = v2 + h * moved[4], v3 + h * moved[6]
            x = [i, omega, theta, q2 + h * v2, v2, q3 + h * v3, v3, after]
        return np.array(x)

    def controller(t: float, x: Any, u: Any, params: Any) -> Any:
        return nimc.update(x, u[0], u[1], u[2], gap)

    blocks = [
        control.nlsys(plant, lambda t, x, u, params: x[[2, 5]], inputs=["u"], outputs=["theta_m", "q3"],
                      states=8, dt=step, name="plant"),
        control.nlsys(controller, lambda t, x, u, params: np.array([nimc.output(x, u[0], u[2])[0]]),
                      inputs=["r", "theta_m", "q3"], outputs=["u"], states=nimc.order, dt=step, name="nimc"),
    ]  # fmt: skip
    closed = control.interconnect(blocks, inputs=["r"], outputs=["q3"])
    time_s = np.arange(scenario.reference_m.size) * step
    return np.asarray(control.input_output_response(closed, time_s, scenario.reference_m).outputs).ravel()


def scipy_ivp(scenario: Scenario) -> Floats:
    """q3 [m] by one ``solve_ivp`` a sample; the gear follows from its place at the sample's start."""
    from scipy.integrate import solve_ivp

    nimc, rates, step = _Nimc(scenario), _motion(scenario), scenario.config.sample_time_s
    gap = float(scenario.gap_rad[0])

    def plant(t: float, x: Any, u: float, theta_d: float) -> list[float]:
        low, high = x[2] - gap, x[2] + gap
        if low <= theta_d <= high:
            return rates(t, x, u, theta_d, 0.0)
        return rates(t, x, u, low if theta_d < low else high, x[1])

    x, theta_d, states = np.zeros(7), 0.0, np.zeros(nimc.order)
    q3 = np.zeros(scenario.reference_m.size)
    for k, r in enumerate(scenario.reference_m):
        q3[k] = x[5]
        u = nimc.output(states, r, x[5])[0]
        states = nimc.update(states, r, x[2], x[5], gap)
        x = solve_ivp(plant, (0.0, step), x, args=(u, theta_d), rtol=1e-4, atol=1e-8).y[:, -1]
        theta_d = min(max(theta_d, x[2] - gap), x[2] + gap)
    return q3
