"""The compiled rig along a stretch of a recording: corrected at each reading, or led on from given states."""

from dtbacklash.compiled import compiled_free
from dtbacklash.diagnose.engine.readings import OPENING
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.sample import advance, amplify, sense
from dtbacklash.physics.kernel.step import screw_angle, slip_rate


@compiled_free
def let_slip(P, S, gap):
    """What is not at rest slips: a state that is not known yet is corrected to one that moves."""
    theta = S.gear[0] if P.imposed else screw_angle(P, S, gap)
    for c in range(P.friction_ends.shape[0]):
        if S.mode[1 + c] == 0:
            rate = slip_rate(P, S, S.x, c, theta, 0.0)
            S.mode[1 + c] = 1 if rate > 0.0 else (-1 if rate < 0.0 else 0)


@compiled_free
def observe(P, S, u, rise, ramp, gap, theta, Y, K, W, which, chan, E, X, D, y):
    """Predict each sample, compare it with what was read, and correct the state by it.

    Parameters
    ----------
    u (N,), gap, theta : as for the simulation. rise (N,), ramp (n,) : by how much the command rises within a sample,
    and what a rise of 1 about its mean adds to the state. Y : (N, m) readings, NaN where one is missing, which corrects
    nothing.
    K (modes, g, n, m), W (modes, g, m, m) : gains and whitening, which (N,) : those of each sample; mode 1 while the
    gear is in contact, or where there is none. chan : (m,) sensors of the readings.
    E, D (N, m), X (N, n) : filled with whitened innovations, innovations, and states before each correction.
    """
    n, m, nx = u.shape[0], chan.shape[0], S.x.shape[0]
    for k in range(n):
        g = which[k]
        sense(P, S, gap, 0.0, y)
        mode = 0 if P.rotor >= 0 and S.mode[0] == pl.FREE else 1
        for r in range(m):
            D[k, r] = Y[k, r] - y[chan[r]] if Y[k, r] == Y[k, r] else 0.0
        for r in range(m):
            s = 0.0
            for q in range(r + 1):
                s += W[mode, g, r, q] * D[k, q]
            E[k, r] = s if Y[k, r] == Y[k, r] else 0.0
        for i in range(nx):
            X[k, i] = S.x[i]
            for r in range(m):
                S.x[i] += K[mode, g, i, r] * D[k, r]
        for s in range(P.sensor_play.shape[0]):  # what senses goes along with what it is corrected to
            at = P.sensor[s, pl.Y_INDEX]
            if P.sensor_play[s] > 0.0 and at >= 0:
                S.played[s] += S.x[int(at)] - X[k, int(at)]
        if k < OPENING:
            let_slip(P, S, gap)
        if k + 1 < n:
            advance(P, S, k * P.sample_time, u[k], gap, gap, theta, k)
            if rise[k] != 0.0:
                for i in range(nx):
                    S.x[i] += ramp[i] * rise[k]


@compiled_free
def onwards(P, S, u, gap, theta, Z, X):
    """(N, n) where one sample leads from each of the states Z (N, n)."""
    for k in range(u.shape[0] - 1):
        for i in range(min(S.x.shape[0], Z.shape[1])):
            S.x[i] = Z[k, i]
        advance(P, S, k * P.sample_time, u[k], gap, gap, theta, k)
        for i in range(Z.shape[1]):
            X[k, i] = S.x[i]


@compiled_free
def shown(P, S, gap, Z, y, Y):
    """(N, sensors) what sensors that are not late show of the states Z (N, n)."""
    for k in range(Z.shape[0]):
        for i in range(min(S.x.shape[0], Z.shape[1])):
            S.x[i] = Z[k, i]
        sense(P, S, gap, 0.0, y)
        for s in range(y.shape[0]):
            Y[k, s] = y[s]


@compiled_free
def amplified(P, u, out):
    """What the amplifier makes of each command."""
    for k in range(u.shape[0]):
        out[k] = amplify(P, u[k])
