"""The compiled loop of a comparison: a block is simulated and pulled towards its measurement, sample by sample."""

from dtbacklash.compiled import compiled_free
from dtbacklash.physics.kernel.sample import advance, sense


@compiled_free
def track(P, S, u, gap, theta, target, pulled, where, gains, y, from_s):
    """Simulate all samples into ``y`` (N, sensors), each before it pulls the state towards ``target``.

    The first one is at ``from_s`` seconds of the rig's time.
    """
    n = u.shape[0]
    S.now[0] = from_s
    for k in range(n):
        sense(P, S, gap, 0.0, y[k])
        if pulled >= 0:
            e = target[k] - y[k, pulled]
            S.x[where] += gains[0] * e
            S.x[where + P.n_bodies] += gains[1] * e
        if k + 1 < n:
            advance(P, S, from_s + k * P.sample_time, u[k], gap, gap, theta, k)
