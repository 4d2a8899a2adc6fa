"""Simulations and passes along a recording in plain Python: as ``simulation`` and ``passes``."""

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.resampling import OPENING
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant, State
from oracle.kernel.sample import advance, amplify, sense
from oracle.kernel.step import screw_angle, slip_rate


@np.errstate(all="ignore")
def run(P: Plant, S: State, u: Floats, gap: Floats, theta: Floats, y: Floats, x: Floats, theta_d: Floats) -> None:
    """Simulate N samples from a state."""
    for k in range(len(u)):
        rate = (gap[k + 1] - gap[k]) / P.sample_time
        advance(P, S, k * P.sample_time, u[k], gap[k], gap[k + 1], theta, k)
        sense(P, S, gap[k + 1], rate, y[k + 1])
        x[k + 1] = S.x
        theta_d[k + 1] = S.gear[0] if P.rotor < 0 else screw_angle(P, S, gap[k + 1])


@np.errstate(all="ignore")
def observe(P, S, u, rise, ramp, gap, theta, Y, K, W, which, chan, E, X, D):
    """Predict each sample, compare it with what was read, and correct the state by it."""
    y = np.zeros(len(P.sensor))
    for k, g in enumerate(which.tolist()):
        sense(P, S, gap, 0.0, y)
        mode = 0 if P.rotor >= 0 and S.mode[0] == pl.FREE else 1
        there = Y[k] == Y[k]
        D[k] = np.where(there, Y[k] - y[chan], 0.0)
        for r in range(len(chan)):
            s = 0.0
            for q in range(r + 1):
                s += W[mode, g, r, q] * D[k, q]
            E[k, r] = s if there[r] else 0.0
        X[k] = S.x
        for r in range(len(chan)):
            S.x[:] += K[mode, g, :, r] * D[k, r]
        for s, width in enumerate(P.sensor_play):
            at = P.sensor[s, pl.Y_INDEX]
            if width > 0.0 and at >= 0:
                S.played[s] += S.x[int(at)] - X[k, int(at)]
        if k < OPENING:
            _let_slip(P, S, gap)
        if k + 1 < len(u):
            advance(P, S, k * P.sample_time, u[k], gap, gap, theta, k)
            S.x[:] += ramp * rise[k] if rise[k] != 0.0 else 0.0


def _let_slip(P, S, gap):
    theta = S.gear[0] if P.imposed else screw_angle(P, S, gap)
    for c in range(len(P.friction_ends)):
        if S.mode[1 + c] == 0:
            S.mode[1 + c] = int(np.sign(slip_rate(P, S, S.x, c, theta, 0.0)))


@np.errstate(all="ignore")
def onwards(P, S, u, gap, theta, Z, X):
    """Where one sample leads from each of the states Z (N, n), into X (N, n)."""
    n = min(len(S.x), Z.shape[1])
    for k in range(len(u) - 1):
        S.x[:n] = Z[k, :n]
        advance(P, S, k * P.sample_time, u[k], gap, gap, theta, k)
        X[k] = S.x[: Z.shape[1]]


@np.errstate(all="ignore")
def shown(P, S, gap, Z, Y):
    """What sensors that are not late show of the states Z (N, n), into Y (N, sensors)."""
    n = min(len(S.x), Z.shape[1])
    for k in range(len(Z)):
        S.x[:n] = Z[k, :n]
        sense(P, S, gap, 0.0, Y[k])


@np.errstate(all="ignore")
def amplified(P: Plant, u: Floats, out: Floats) -> None:
    """What the amplifier makes of each command."""
    out[:] = [amplify(P, float(one)) for one in u]
