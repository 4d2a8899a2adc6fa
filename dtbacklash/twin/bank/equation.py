"""What the voltage leaves over on the believed motor: a torque, from the motor's own equation.

The winding and the rotor, sampled with a voltage and a torque that are held, give one difference equation between the
measured angle, the voltage and the torque that is not believed in. Its residual is that torque through a known short
response; the torque shown is the residual through two equal lags. Each law of the motor that it is compared
with passes the same lags.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import linalg

from dtbacklash.arrays import Floats
from dtbacklash.compiled import compiled_allocating, inlined
from dtbacklash.control.belief import Belief
from dtbacklash.control.chain import MotorParameters, motor_parameters

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
    return np.asarray(linalg.expm(system * time_s))


def _numerator(sampled: Floats, b: Floats) -> Floats:
    """(4,) of a single input b (3,) to the angle: det(zI - A + b c) - det(zI - A)."""
    A = sampled[:3, :3]
    return np.asarray(np.poly(A - np.outer(b, [0.0, 0.0, 1.0])) - np.poly(A), dtype=np.float64)


@inlined
def residual_torque(E, past, lags, theta, u):
    """The torque that is left over at the newest sample, through both lags, N m; and the speed, through both, rad/s.

    past : (8,) angles and voltages before, newest first. lags : (9,) of torque, speed, dry friction's mean and
    spread (at rest it takes whatever it has to, up to its level), and of the speed by a lag a quarter as long.
    """
    difference = E.a[0] * theta
    for i in range(3):
        difference += E.a[i + 1] * past[i] - E.b[i + 1] * past[4 + i]
    speed = (theta - past[0]) / E.sample_time
    for i in range(2, 0, -1):
        past[i], past[4 + i] = past[i - 1], past[3 + i]
    past[0], past[4] = theta, u
    known = E.known[1] + E.known[2] * np.sin(E.known[3] * theta + E.known[4])
    share = 1.0 - E.keep
    mean, spread = 0.0, E.known[0]
    fast = E.keep * E.keep * E.keep * E.keep
    lags[8] = fast * lags[8] + (1.0 - fast) * speed
    if abs(lags[8]) > REST_RAD_S:
        mean, spread = (-spread if lags[8] > 0.0 else spread), 0.0
    news = (difference / E.scale - known, speed, mean, spread)
    for i in range(4):
        lags[2 * i] = E.keep * lags[2 * i] + share * news[i]
        lags[2 * i + 1] = E.keep * lags[2 * i + 1] + share * lags[2 * i]
    left = lags[1] - lags[5]
    return left - min(max(left, -lags[7]), lags[7]), lags[3]


@compiled_allocating
def torque_record(E: MotorEquation, theta: Floats, u: Floats) -> tuple[Floats, Floats]:
    """(N,) torque left over, N m, and (N,) speed, rad/s, of a record of the measured angle and the voltage.

    u : (N,) V, held from its sample on. The record begins as if at rest.
    """
    torque, speed = np.empty_like(theta), np.empty_like(theta)
    past, lags = np.zeros(8), np.zeros(9)
    past[:4], past[4:] = theta[0], u[0]
    for k in range(theta.size):
        torque[k], speed[k] = residual_torque(E, past, lags, theta[k], u[k])
    return torque, speed
