"""The twin's output error, its derivatives, profile and simulation, in plain Python: as ``twin.gap``."""

import numpy as np

from oracle.kernel.sample import advance, sense

COARSE_STARTS = 9  # first tries for theta_d0 across the gap
POLISH_STEPS = 6  # Newton steps that follow, each halved until it helps
HALVINGS = 4


def in_order(values):
    """Sum of values, added one after another: NumPy's own sums are pairwise."""
    return np.add.accumulate(np.append(0.0, values))[-1]


@np.errstate(all="ignore")
def play(theta_m, half_gap, theta_d0, growth):
    """theta_d of the backlash (16)-(17), driven by the samples theta_m; both (N,) [rad].

    theta_d stays until theta_m has crossed the gap and then follows at the distance half_gap [rad, >= 0].
    theta_d0 [rad] is where it rests before the first sample; it is pushed if the gap does not allow it.
    growth [rad/sample]: half_gap is that of the middle of the buffer, and grows by this much per sample.
    """
    theta_d = np.empty_like(theta_m)
    now = theta_d0
    middle = 0.5 * (theta_m.size - 1)
    for k in range(theta_m.size):
        gap = max(half_gap + growth * (k - middle), 0.0)
        now = min(max(now, theta_m[k] - gap), theta_m[k] + gap)
        theta_d[k] = now
    return theta_d


@np.errstate(all="ignore")
def filtered(u, path):
    """Response of a path to the samples u, (N,), from rest at u[0]."""
    out = u.copy()
    filter_in_place(out, path)
    return out


def filter_in_place(u, path):
    """Samples u, (N,), become the response of a path to them, from rest at u[0]."""
    state = (path.start * u[0]).tolist()
    phi, b = path.phi.tolist(), path.b.tolist()
    for k, now in enumerate(u.tolist()):
        u[k] = state[0] + path.d * now
        go_on(phi, b, state, now)


def go_on(phi, b, state, now):
    """The state of a path, a list, goes on by one sample with an input."""
    for i, row in enumerate(phi):
        following = b[i] * now
        for j in range(i, len(b)):
            following += row[j] * state[j]
        state[i] = following


@np.errstate(all="ignore")
def cost(theta_m, eps_q, half_gap, theta_d0, growth, path, settle):
    """Mean square output error [m^2] from sample ``settle`` on, eq. (18).

    theta_m: (N,) [rad]. eps_q: (N,) [m], the measured q3 through ``from_q3``: it depends on no parameter.
    path: ``from_theta_d``. half_gap and theta_d0 [rad], growth [rad/sample] as in :func:`play`; a negative
    half_gap counts as its magnitude, which makes the cost smooth where the true gap is zero.
    """
    phi, b, state = path.phi.tolist(), path.b.tolist(), []
    middle, theta_d, total = 0.5 * (theta_m.size - 1), theta_d0, 0.0
    for k, (theta, eps) in enumerate(zip(theta_m.tolist(), eps_q.tolist(), strict=True)):
        gap = max(abs(half_gap) + growth * (k - middle), 0.0)
        theta_d = min(max(theta_d, theta - gap), theta + gap)
        if k == 0:
            state = [start * theta_d for start in path.start.tolist()]
        if k >= settle:
            error = eps + state[0] + path.d * theta_d
            total += error * error
        go_on(phi, b, state, theta_d)
    return np.float64(total) / (theta_m.size - settle)


@np.errstate(all="ignore")
def play_sensitivities(theta_m, half_gap, theta_d0, growth, out):
    """theta_d and its derivatives by half_gap, theta_d0 and growth into the rows of ``out``, (4, N).

    Exact wherever the play is smooth: theta_d moves with theta_d0 until the first contact, and from then on
    by -1 or +1 with the gap, by the side that pushed last.
    """
    sign = -1.0 if half_gap < 0.0 else 1.0
    middle = 0.5 * (theta_m.size - 1)
    theta_d, by_gap, by_start, by_growth = theta_d0, 0.0, 1.0, 0.0
    for k in range(theta_m.size):
        gap = max(abs(half_gap) + growth * (k - middle), 0.0)
        side = 0.0
        if theta_d < theta_m[k] - gap:
            side = -1.0
        elif theta_d > theta_m[k] + gap:
            side = 1.0
        if side != 0.0:
            theta_d = theta_m[k] + side * gap
            by_gap, by_start, by_growth = side * sign, 0.0, side * (k - middle)
        out[0, k], out[1, k], out[2, k], out[3, k] = theta_d, by_gap, by_start, by_growth


@np.errstate(all="ignore")
def sensitivities(theta_m, eps_q, half_gap, theta_d0, growth, path, settle):
    """Output error and its derivatives by half_gap, theta_d0 and growth: rows of (4, N - settle), SI.

    Arguments as for :func:`cost`.
    """
    rows = np.empty((4, theta_m.size))
    play_sensitivities(theta_m, half_gap, theta_d0, growth, rows)
    for row in range(4):
        filter_in_place(rows[row], path)
    for k in range(eps_q.size):
        rows[0, k] += eps_q[k]
    return rows[:, settle:].copy()


@np.errstate(all="ignore")
def cost_and_gradient(theta_m, eps_q, half_gap, theta_d0, path, settle):
    """:func:`cost` [m^2] and its derivatives by half_gap and theta_d0 [m^2/rad], without growth."""
    rows = np.empty((4, theta_m.size))
    play_sensitivities(theta_m, half_gap, theta_d0, 0.0, rows)
    error = (filtered(rows[0], path) + eps_q)[settle:]
    scale = 2.0 / error.size
    by_gap = scale * in_order(error * filtered(rows[1], path)[settle:])
    by_start = scale * in_order(error * filtered(rows[2], path)[settle:])
    return 0.5 * scale * in_order(error * error), by_gap, by_start


@np.errstate(all="ignore")
def start_sensitivity(theta_m, eps_q, half_gap, theta_d0, path, settle):
    """Output error and its derivative by theta_d0 alone: rows of (2, N - settle), SI; half_gap >= 0."""
    rows = np.empty((4, theta_m.size))
    play_sensitivities(theta_m, half_gap, theta_d0, 0.0, rows)
    filter_in_place(rows[0], path)
    filter_in_place(rows[2], path)
    out = np.empty((2, theta_m.size - settle))
    for k in range(settle, theta_m.size):
        out[0, k - settle], out[1, k - settle] = rows[0, k] + eps_q[k], rows[2, k]
    return out


@np.errstate(all="ignore")
def profile_point(theta_m, eps_q, half_gap, path, settle):
    """Least cost [m^2] over theta_d0 for one gap, and that theta_d0 [rad]. Arguments as observer.cost.

    theta_d0 lies within the gap around theta_m[0]. Where it matters the cost is piecewise quadratic in it, so
    that Newton's method from the best of a few points ends at rounding.
    """
    best, best_start = np.inf, theta_m[0]
    for i in range(COARSE_STARTS):
        start = theta_m[0] + half_gap * (2.0 * i / (COARSE_STARTS - 1) - 1.0)
        value = cost(theta_m, eps_q, half_gap, start, 0.0, path, settle)
        if value < best:
            best, best_start = value, start
    for _ in range(POLISH_STEPS):
        rows = start_sensitivity(theta_m, eps_q, half_gap, best_start, path, settle)
        curvature = in_order(rows[1] * rows[1])
        if curvature <= 0.0:
            break
        step = -in_order(rows[0] * rows[1]) / curvature
        gained = 0.0
        for _ in range(HALVINGS):
            start = min(max(best_start + step, theta_m[0] - half_gap), theta_m[0] + half_gap)
            value = cost(theta_m, eps_q, half_gap, start, 0.0, path, settle)
            if value < best:
                gained = best - value
                best, best_start = value, start
                break
            step *= 0.5
        if gained <= 1e-9 * best:
            break
    return best, best_start


@np.errstate(all="ignore")
def _profile(theta_m, eps_q, gaps, path, settle):
    out = np.empty((2, gaps.size))
    for i in range(gaps.size):
        out[0, i], out[1, i] = profile_point(theta_m, eps_q, gaps[i], path, settle)
    return out


@np.errstate(all="ignore")
def follow(P, S, theta_m, gap, index, y, q3):
    """q3 at every sample of the buffer; the gap's own change does not push the screw before the motor does."""
    for k in range(theta_m.shape[0]):
        sense(P, S, gap[k], 0.0, y)
        q3[k] = y[index]
        if k + 1 < theta_m.shape[0]:
            advance(P, S, k * P.sample_time, 0.0, gap[k], gap[k + 1], theta_m, k)
