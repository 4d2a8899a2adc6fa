"""What the voltage leaves over on the believed motor: a torque, from the motor's own equation.

The winding and the rotor, sampled with a voltage and a torque that are held, give one difference equation between the
measured angle, the voltage and the torque that is not believed in. Its residual is that torque through a known short
response; the torque shown is the residual through two equal lags. Each law of the motor that it is compared
with passes the same lags.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy

from dtbacklash.arrays import Floats
from dtbacklash.control.belief import Belief
from dtbacklash.control.chain import MotorParameters, motor_parameters
from dtbacklash.core.library import buffer, lib, struct

#: slower than this, rad/s, the rotor may be at rest: an encoder's counts are no motion
REST_RAD_S = 0.3


class MotorEquation(NamedTuple):
    """The believed motor, ``sum a theta = sum b u + scale torque``, and what it is known to do beside.

    a, b : (4,) of the newest sample first. scale : rad per N m. keep : of a lag, per sample.
    known : (5,) Coulomb friction N m, constant load N m, cogging N m, its periods a radian, its phase.
    """

    a: Floats
    b: Floats
    scale: float
    keep: float
    sample_time: float
    known: Floats


def motor_equation(belief: Belief, pole_rad_s: float, sample_time_s: float) -> MotorEquation:
    """The equation of a believed motor; both lags have the pole ``pole_rad_s``."""
    a, b, by_torque = difference_equation(motor_parameters(belief.rig), sample_time_s)
    rotor = belief.rig.motor_rotor()
    there = belief.rig.effects.get(rotor.name, {}) if rotor else {}
    cogging = there.get("cogging", {})
    known = np.array([
        there.get("coulomb_friction", {}).get("torque", 0.0), there.get("constant_load", {}).get("torque", 0.0),
        cogging.get("torque", 0.0), cogging.get("periods", 0.0), cogging.get("phase", 0.0),
    ])  # fmt: skip
    return MotorEquation(a, b, float(by_torque.sum()), float(np.exp(-pole_rad_s * sample_time_s)), sample_time_s, known)


def difference_equation(motor: MotorParameters, sample_time_s: float) -> tuple[Floats, Floats, Floats]:
    """(4,) each, the newest sample first: ``sum a theta = sum b u + sum c torque``, voltage and torque held."""
    sampled = _sampled(motor, sample_time_s)
    a = np.poly(sampled[:3, :3]).astype(np.float64)
    by_voltage, by_torque = (_numerator(sampled, sampled[:3, j]) for j in (3, 4))
    return a, by_voltage, by_torque


def _sampled(motor: MotorParameters, time_s: float) -> Floats:
    """(5, 5): states current, speed, angle, and the held inputs voltage, torque, after a time."""
    system = np.zeros((5, 5))
    system[0, :2] = -motor.R / motor.L, -motor.k_B / motor.L
    system[1, :2] = motor.k_T / motor.J, -motor.viscous_n_m_s / motor.J
    system[2, 1] = 1.0
    system[0, 3], system[1, 4] = motor.gain / motor.L, 1.0 / motor.J
    return np.asarray(scipy.linalg.expm(system * time_s))


def _numerator(sampled: Floats, b: Floats) -> Floats:
    """(4,) of a single input b (3,) to the angle: det(zI - A + b c) - det(zI - A)."""
    A = sampled[:3, :3]
    return np.asarray(np.poly(A - np.outer(b, [0.0, 0.0, 1.0])) - np.poly(A), dtype=np.float64)


def motor_struct(E: MotorEquation) -> Any:
    """The equation as the core takes it."""
    return struct("MotorEquation", **E._asdict(), rest=REST_RAD_S)


def torque_record(E: MotorEquation, theta: Floats, u: Floats) -> tuple[Floats, Floats]:
    """(N,) torque left over, N m, and (N,) speed, rad/s, of a record of the measured angle and the voltage.

    u : (N,) V, held from its sample on. The record begins as if at rest.
    """
    theta, u = (np.ascontiguousarray(values, dtype=float) for values in (theta, u))
    torque, speed = np.empty_like(theta), np.empty_like(theta)
    past, lags = np.repeat([theta[0], u[0]], 4), np.zeros(9)
    records = (buffer(one, theta.size) for one in (theta, u, torque, speed))
    lib.dtb_residual_torque(motor_struct(E), buffer(past), buffer(lags), theta.size, *records)
    return torque, speed
