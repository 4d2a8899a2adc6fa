"""An independent plant for the twin's tests: simulated finely, measured at 1 kHz, with noise."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import lfilter

from dtbacklash.control.chain import StructureParameters
from dtbacklash.twin.gap.estimate import Problem
from dtbacklash.twin.gap.observer import TwinModel, twin_model

Array = NDArray[np.float64]

SAMPLE_TIME_S = 1e-3
FINE = 20  # steps of the plant per sample
PAPER = StructureParameters((5.2, 5.2), (1e4, 1e4), (36.9, 36.9), 1e-3 / np.pi)


@njit
def backlash(theta_m: Array, gap: Array, theta_d0: float) -> Array:
    """Eqs (16) and (17) as they stand: theta_d moves with theta_m only in contact and when pushed."""
    theta_d = np.empty_like(theta_m)
    now = theta_d0
    for k in range(theta_m.size):
        z = theta_m[k] - now
        if z > gap[k]:
            now += z - gap[k]
        elif z < -gap[k]:
            now += z + gap[k]
        theta_d[k] = now
    return theta_d


def structure_response(structure: StructureParameters, theta_d: Array, step_s: float) -> Array:
    """Last mass [m] for theta_d with straight lines between its samples, exact, mode by mode, from rest."""
    mass = np.diag(structure.masses_kg)
    k1, k2 = structure.stiffnesses_n_per_m
    c1, c2 = structure.dampings_n_s_per_m
    stiffness, damping = np.array([[k1 + k2, -k2], [-k2, k2]]), np.array([[c1 + c2, -c2], [-c2, c2]])
    inverse = np.linalg.inv(mass)
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    drive_c = inverse @ np.array([c1, 0.0]) * structure.pitch_m_per_rad
    drive_k = inverse @ np.array([k1, 0.0]) * structure.pitch_m_per_rad
    b = np.concatenate([drive_c, drive_k - inverse @ damping @ drive_c])
    poles, vectors = np.linalg.eig(a)
    gains = np.linalg.solve(vectors, b.astype(complex)) * vectors[1]
    u = theta_d - theta_d[0]
    y = np.zeros(theta_d.size)
    for pole, gain in zip(poles, gains, strict=True):
        if pole.imag < 0.0:
            continue  # the conjugate of another: together they make twice its real part
        z = pole * step_s
        old, new = (np.exp(z) * (1 - 1 / z) + 1 / z) / pole, (np.exp(z) / z - 1 / z - 1) / pole
        y += (2.0 if pole.imag else 1.0) * (gain * lfilter([new, old], [1.0, -np.exp(z)], u)).real
    return y + structure.pitch_m_per_rad * theta_d[0]


@dataclass(frozen=True)
class Move:
    """The motor goes to ``to_deg`` from ``t_s`` on, as a first-order lag of ``tau_s``."""

    t_s: float
    to_deg: float
    tau_s: float


def motor_angle(moves: list[Move], t_s: Array) -> Array:
    """theta_m [rad] for moves in time order, from rest at zero; a second, fast lag starts it softly."""
    theta, last = np.zeros_like(t_s), 0.0
    for move in moves:
        since = np.clip(t_s - move.t_s, 0.0, None)
        slow, fast = move.tau_s, 0.01
        share = 1.0 - (slow * np.exp(-since / slow) - fast * np.exp(-since / fast)) / (slow - fast)
        theta += np.radians(move.to_deg - last) * share
        last = move.to_deg
    return theta


@dataclass(frozen=True)
class Measured:
    """What the sensors saw over a whole experiment, and the truth behind it."""

    theta_m_rad: Array
    q3_m: Array
    gap_rad: Array
    theta_d_rad: Array

    def problem(self, first: int, length: int, model: TwinModel) -> Problem:
        part = slice(first, first + length)
        return Problem(self.theta_m_rad[part], self.q3_m[part], model)


def experiment(
    moves: list[Move],
    gap_deg: float | Callable[[Array], Array],
    duration_s: float,
    q3_noise_m: float = 0.0,
    theta_m_noise_rad: float = 0.0,
    seed: int = 0,
) -> Measured:
    """The paper's gear and structure behind a motor that makes the moves; the gear starts at z = 0."""
    t = np.arange(round(duration_s / SAMPLE_TIME_S) * FINE + 1) * (SAMPLE_TIME_S / FINE)
    theta_m = motor_angle(moves, t)
    gap = np.radians(gap_deg(t) if callable(gap_deg) else np.full_like(t, gap_deg))
    theta_d = backlash(theta_m, gap, 0.0)
    q3 = structure_response(PAPER, theta_d, SAMPLE_TIME_S / FINE)
    rng = np.random.default_rng(seed)
    sampled = [x[:-1:FINE].copy() for x in (theta_m, q3, gap, theta_d)]
    sampled[0] += theta_m_noise_rad * rng.standard_normal(sampled[0].size)
    sampled[1] += q3_noise_m * rng.standard_normal(sampled[1].size)
    return Measured(*sampled)


#: the paper's twin: observer poles at -40 rad/s, 400 samples to settle
PAPER_TWIN = twin_model(PAPER, 40.0, SAMPLE_TIME_S, 400)
