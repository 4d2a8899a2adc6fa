"""Machines that are not the package's: small chains of bodies under a command, open loop or PID.

One integrator of its own (semi-implicit Euler at ten steps a sample); friction, play, loads and stops that the nominal
rig does not know.
"""

from dataclasses import dataclass

import numba
import numpy as np

STEP_S = 1e-3
SUBSTEPS = 10


@dataclass(frozen=True)
class Machine:
    """What is simulated: ``n`` bodies in a row; the command drives the first, by force or through a motor."""

    inertia: tuple[float, ...]
    gain: float = 1.0  # effort per volt
    emf: float = 0.0  # volts per speed of the first body
    ground: float = 0.0  # stiffness to the ground of the last body
    ground_damping: float = 0.0
    link: float = 0.0
    link_damping: float = 0.0
    coulomb: float = 0.0  # at the first body
    viscous: float = 0.0
    far_coulomb: float = 0.0  # at the last body
    load: float = 0.0  # constant effort on the first body
    pendulum: float = 0.0  # effort times the sine of the first body's position
    gap: float = 0.0  # play in the link
    cubic: float = 0.0  # of the ground spring
    dead_zone: float = 0.0  # of the amplifier, V
    pid: tuple[float, float, float] | None = None  # on the first body
    limit: float = 1e9  # of the command, V
    start: float = 0.0  # where the bodies are at first


@numba.njit(cache=True)
def _run(m, p, pid, closed, r, noise, steps, h):
    (gain, emf, ground, ground_c, k, c, fc, fv, far, load, pend, gap, cubic, dead, limit, start) = p
    n = len(m)
    x, v = np.full(n, start), np.zeros(n)
    out, speed, u_out = np.zeros((len(r), n)), np.zeros((len(r), n)), np.zeros(len(r))
    total, before = 0.0, start
    smooth = 0.0
    for i in range(len(r)):
        seen = x[0] + noise[i]
        if closed:
            e = r[i] - seen
            total += e * h * steps
            smooth += 0.2 * ((seen - before) / (h * steps) - smooth)
            before = seen
            u = pid[0] * e + pid[1] * total - pid[2] * smooth
        else:
            u = r[i]
        u = min(max(u, -limit), limit)
        out[i], speed[i], u_out[i] = x, v, u
        w = u if dead == 0.0 else np.sign(u) * max(abs(u) - dead, 0.0)
        for _ in range(steps):
            f = np.zeros(n)
            f[0] = gain * (w - emf * v[0]) - fv * v[0] + load - pend * np.sin(x[0])
            for j in range(n - 1):
                d = x[j] - x[j + 1]
                if gap > 0.0:
                    d = np.sign(d) * max(abs(d) - gap, 0.0)
                pull = k * d
                if gap == 0.0 or d != 0.0:
                    pull += c * (v[j] - v[j + 1])
                f[j] -= pull
                f[j + 1] += pull
            f[n - 1] -= ground * x[n - 1] + ground_c * v[n - 1] + cubic * x[n - 1] ** 3
            for j in range(n):
                level = (fc if j == 0 else 0.0) + (far if j == n - 1 else 0.0)
                free = v[j] + h * f[j] / m[j]
                hold = h * level / m[j]  # friction stops a body, it does not turn it round
                v[j] = 0.0 if abs(free) <= hold else free - np.sign(free) * hold
                x[j] += h * v[j]
    return out, speed, u_out


def record(machine: Machine, command: np.ndarray, noise: float = 0.0, seed: int = 0):
    """(N, n) positions, (N, n) speeds and (N,) commands; ``command`` is the reference of a closed loop."""
    p = np.array([machine.gain, machine.emf, machine.ground, machine.ground_damping, machine.link,
                  machine.link_damping, machine.coulomb, machine.viscous, machine.far_coulomb, machine.load,
                  machine.pendulum, machine.gap, machine.cubic, machine.dead_zone, machine.limit,
                  machine.start])  # fmt: skip
    errors = noise * np.random.default_rng(seed).standard_normal((len(command), len(machine.inertia)))
    pid = np.array(machine.pid or (0.0, 0.0, 0.0))
    x, v, u = _run(
        np.array(machine.inertia), tuple(p), pid, machine.pid is not None, command, errors[:, 0], SUBSTEPS,
        STEP_S / SUBSTEPS,
    )  # fmt: skip
    return x + errors, v, u


def times(duration_s: float) -> np.ndarray:
    return STEP_S * np.arange(round(duration_s / STEP_S))


def multisine(t: np.ndarray, rms: float, top_hz: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    tones = np.arange(0.1, top_hz, 0.1)
    u = sum(
        np.sin(2 * np.pi * f * t + phase) for f, phase in zip(tones, rng.uniform(0, 2 * np.pi, len(tones)), strict=True)
    )
    return u * rms / np.std(u)


def steps(t: np.ndarray, size: float, every_s: float, seed: int = 0) -> np.ndarray:
    levels = np.random.default_rng(seed).uniform(-1, 1, int(t[-1] / every_s) + 2)
    return size * levels[(t / every_s).astype(int)]


def square(t: np.ndarray, size: float, every_s: float) -> np.ndarray:
    return size * np.where((t / every_s).astype(int) % 2 == 0, 1.0, -1.0)


def smooth(t: np.ndarray, r: np.ndarray, time_s: float) -> np.ndarray:
    """A reference that moves as a machine can follow: the mean of the last ``time_s``."""
    width = round(time_s / STEP_S)
    padded = np.concatenate([np.full(width, r[0]), r])
    total = np.concatenate([[0.0], np.cumsum(padded)])
    return ((total[width:] - total[:-width]) / width)[: len(t)]
