"""The concealing simulator's inner loop: Runge-Kutta of fourth order with many fixed steps, bristles and springs.

It shares no formula with :mod:`dtbacklash.physics`, so that a diagnosis cannot succeed by recognising its own
equations: dry friction is LuGre's bristle (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automat. Contr. 40
(1995) 419), the teeth of the gear meet through a spring and a damper, clipping, dead zone and stop are smooth, and
delays interpolate a fine history. What has memory (bristles, yielding links) is a function of the displacement since
the step's start, exact for constant friction level, and so cannot become stiff.

All compiled functions and their constants stand in this file: numba then sees every change of them. What they work on
stands in :mod:`.other_arrays`.
"""

# mypy: disallow-untyped-defs=False
# compiled: numba infers the types, annotations would only repeat the docstrings

import math

import numba
import numpy as np

GROUND, BASE = -1, -2

# columns of `body`
B_VISCOUS, B_DIFFERENCE, B_COGGING, B_WAVE, B_PHASE, B_LOAD, N_BODY = range(7)
# columns of `link`
(L_K, L_C, L_CUBIC, L_QUADRATIC, L_FORCE, L_YIELD, L_STOP, L_CLEARANCE, L_DRIFT, N_LINK) = range(10)
# columns of `friction`
F_COULOMB, F_STRIBECK, F_SPEED, F_BRISTLE, F_DAMPING, N_FRICTION = range(6)
# entries of `drive`
(D_R, D_L, D_KT, D_KB, D_RIPPLE, D_PERIODS, D_PHASE, D_HEAT, D_TAU, D_LEAD, D_SHARE, D_BASE_MASS, D_PITCH, D_WAVE,
 D_SHIFT, D_GAP, D_GAIN, D_DEAD, D_LIMIT, D_DELAY, N_DRIVE) = range(21)  # fmt: skip
# columns of `sensor`
Y_INDEX, Y_GAIN, Y_OFFSET, Y_DELAY, Y_NOISE, Y_COUNT, N_SENSOR = range(7)
#: `sensor[:, Y_INDEX]` of a sensor on the mass that a rigid screw carries: position, velocity
BASE_POSITION, BASE_VELOCITY = -1, -2
# entries of `unknown`: physics that the catalogue does not have
U_KIND, U_PLACE, U_SIZE, U_SCALE, N_UNKNOWN = range(5)
(NO_UNKNOWN, POSITION_DAMPING, DISTURBANCE, DIRECTIONAL_TORQUE, ROOT_SPRING, SPEED_STIFFENING, ANGULAR_PLAY,
 POSITION_MASS) = range(8)  # fmt: skip
# entries of `control`
C_CLOSED, C_GAIN, C_FILTER, C_INTEGRAL, C_LIMIT, N_CONTROL = range(6)

#: a tooth's contact: relaxation rate of its spring, 1/s, and the share of the motion that its damper carries at once.
#: A screw that is pushed at a steady speed lags by (1 - share)/rate = 0.5 us.
TOOTH_RATE, TOOTH_SHARE = 2e4, 0.99
#: width of the rounding of a knee, relative to where it lies
KNEE = 2e-3
#: the rounding of |v|, relative to the speed at which friction matters: m/s or rad/s
SOFT_SPEED = 1e-6

_STAGE = np.array([0.0, 0.5, 0.5, 1.0])
_WEIGHT = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0


_fast = numba.njit(cache=True, error_model="numpy", _nrt=False)
_inlined = numba.njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)

S_HEAT, S_BASE, S_BASE_RATE, S_CONTACT, N_SCALAR = range(5)


@_inlined
def softplus(x):
    """log(1 + e^x) without overflow."""
    return x + math.log1p(math.exp(-x)) if x > 0.0 else math.log1p(math.exp(x))


@_fast
def amplify(D, u):
    """Voltage behind gain, dead zone and limiter with rounded knees. V -> V."""
    v = D[D_GAIN] * u
    if D[D_DEAD] > 0.0:
        w = KNEE * D[D_DEAD]
        v = w * (softplus((v - D[D_DEAD]) / w) - softplus((-v - D[D_DEAD]) / w))
    if D[D_LIMIT] < math.inf:
        w = KNEE * D[D_LIMIT]
        v += w * (softplus((-v - D[D_LIMIT]) / w) - softplus((v - D[D_LIMIT]) / w))
    return v


@_fast
def voltage(D, u, k, begin, end, sample_time):
    """Mean voltage from ``begin`` to ``end`` (shares of sample k): the command held over each sample, D_DELAY late."""
    late = D[D_DELAY] / sample_time
    a, b = k + begin - late, k + end - late
    first, last = math.floor(a + 1e-9), math.floor(b - 1e-9)
    v = amplify(D, u[int(last)]) if last >= 0 else 0.0
    if first < last:
        before = amplify(D, u[int(first)]) if first >= 0 else 0.0
        v = (before * (last - a) + v * (b - last)) / (b - a)
    return v


@_inlined
def bristle_after(z, shift, level, stiffness):
    """Deflection of a LuGre bristle after a relative displacement at a friction level that stays: exact."""
    most = max(level, 1e-300) / stiffness
    rest = most if shift > 0.0 else -most
    return rest + (z - rest) * math.exp(-abs(shift) / most)


@_inlined
def yielded_after(z, shift, displacement):
    """Share of the yield force in a link after a displacement: straight back to zero, then an exponential to one."""
    side = 1.0 if shift > 0.0 else -1.0
    w, way = z * side, abs(shift) / displacement
    if w < 0.0:
        if way < -w:
            return (w + way) * side
        way += w
        w = 0.0
    return (1.0 - (1.0 - w) * math.exp(-way)) * side


@_inlined
def _of(x, first, base, end):
    """Position or velocity of an end."""
    if end >= 0:
        return x[first + end]
    return base if end == BASE else 0.0


@_inlined
def _gap(M, theta_d):
    """Half-gap of the gear at the screw's angle, rad."""
    if M.unknown[U_KIND] == ANGULAR_PLAY:
        return M.drive[D_GAP] + M.unknown[U_SIZE] * (1.0 + 0.9 * math.sin(theta_d * M.unknown[U_SCALE]))
    return M.drive[D_GAP]


@_inlined
def _screw(M, S, x, dx):
    """Motion of the screw's output: the teeth push it through spring and damper, else it holds its place."""
    D, nb = M.drive, M.inertia.shape[0]
    theta, omega = x[2], x[2 + nb]
    gap = _gap(M, x[1])
    angle, rate, contact = theta, omega, 1.0
    if gap > 0.0:
        angle, rate, contact = x[1], 0.0, 0.0
        play = theta - angle
        if play > gap:
            rate = max(0.0, TOOTH_RATE * (play - gap) + TOOTH_SHARE * omega)
            contact = 1.0
        elif play < -gap:
            rate = min(0.0, TOOTH_RATE * (play + gap) + TOOTH_SHARE * omega)
            contact = 1.0
    dx[1] = rate
    S.scalar[S_BASE], S.scalar[S_BASE_RATE], S.scalar[S_CONTACT] = D[D_LEAD] * angle, D[D_LEAD] * rate, contact
    if D[D_PITCH] != 0.0:
        at = D[D_WAVE] * angle + D[D_SHIFT]
        S.scalar[S_BASE] += D[D_PITCH] * (math.sin(at) - math.sin(D[D_SHIFT]))
        S.scalar[S_BASE_RATE] += D[D_PITCH] * D[D_WAVE] * math.cos(at) * rate


@_inlined
def _pull(S, a, b, force):
    """Pull two ends together; returns the force on the rigid base, N."""
    if b >= 0:
        S.force[b] -= force
    if a >= 0:
        S.force[a] += force
    return (force if a == BASE else 0.0) - (force if b == BASE else 0.0)


@_inlined
def _links(M, S, x, t):
    """Forces of springs and dampers, with what else is in them; returns the force on the rigid base, N."""
    nb, on_base = M.inertia.shape[0], 0.0
    base, base_rate = S.scalar[S_BASE], S.scalar[S_BASE_RATE]
    for j in range(M.link.shape[0]):
        row, a, b = M.link[j], M.link_ends[j, 0], M.link_ends[j, 1]
        s = _of(x, 2, base, b) - _of(x, 2, base, a)
        rate = _of(x, 2 + nb, base_rate, b) - _of(x, 2 + nb, base_rate, a)
        force = row[L_K] * s * (1.0 + row[L_DRIFT] * t) + row[L_C] * rate
        if row[L_CUBIC] != 0.0:
            force += row[L_CUBIC] * s**3
        if row[L_QUADRATIC] != 0.0:
            force += row[L_QUADRATIC] * rate * math.sqrt(rate * rate + SOFT_SPEED**2)
        if row[L_STOP] != 0.0:
            w = KNEE * abs(row[L_CLEARANCE]) + 1e-8
            force += row[L_STOP] * w * softplus((s - row[L_CLEARANCE]) / w)
        if row[L_FORCE] != 0.0:
            z, before = S.yielding_start[2 * j], S.yielding_start[2 * j + 1]
            force += row[L_FORCE] * yielded_after(z, s - before, row[L_YIELD])
        if M.unknown[U_PLACE] == j:
            if M.unknown[U_KIND] == ROOT_SPRING:
                x0 = M.unknown[U_SCALE]
                force += M.unknown[U_SIZE] * row[L_K] * s * math.sqrt(x0) / (s * s + (0.02 * x0) ** 2) ** 0.25
            elif M.unknown[U_KIND] == SPEED_STIFFENING:
                force += M.unknown[U_SIZE] * row[L_K] * s * abs(rate) / M.unknown[U_SCALE]
        on_base += _pull(S, a, b, force)
    return on_base


@_inlined
def _frictions(M, S, x):
    """Forces of the bristles; returns the force on the rigid base, N."""
    nb, on_base = M.inertia.shape[0], 0.0
    base, base_rate = S.scalar[S_BASE], S.scalar[S_BASE_RATE]
    for c in range(M.friction.shape[0]):
        row, a, b = M.friction[c], M.friction_ends[c, 0], M.friction_ends[c, 1]
        place = _of(x, 2, base, b) - _of(x, 2, base, a)
        rate = _of(x, 2 + nb, base_rate, b) - _of(x, 2 + nb, base_rate, a)
        level = row[F_COULOMB] + row[F_STRIBECK] * math.exp(-((rate / row[F_SPEED]) ** 2))
        z = bristle_after(S.bristle_start[2 * c], place - S.bristle_start[2 * c + 1], level, row[F_BRISTLE])
        S.bristle[2 * c], S.bristle[2 * c + 1] = z, place
        stretching = rate - abs(rate) * z * row[F_BRISTLE] / max(level, 1e-300)
        force = row[F_BRISTLE] * z + row[F_DAMPING] * stretching
        on_base += _pull(S, a, b, force)
    return on_base


@_inlined
def _bodies(M, S, x, shove):
    """Efforts on single bodies."""
    nb = M.inertia.shape[0]
    for j in range(nb):
        row, q, v = M.body[j], x[2 + j], x[2 + nb + j]
        effort = row[B_LOAD] - row[B_VISCOUS] * v
        if row[B_DIFFERENCE] != 0.0:
            effort -= row[B_DIFFERENCE] * math.sqrt(v * v + SOFT_SPEED**2)
        if row[B_COGGING] != 0.0:
            effort += row[B_COGGING] * math.sin(row[B_WAVE] * q + row[B_PHASE])
        if M.unknown[U_PLACE] == j:
            if M.unknown[U_KIND] == POSITION_DAMPING:
                effort -= M.unknown[U_SIZE] * (q / M.unknown[U_SCALE]) ** 2 * v
            elif M.unknown[U_KIND] == DISTURBANCE:
                effort += M.unknown[U_SIZE] * shove
            elif M.unknown[U_KIND] == POSITION_MASS:
                effort -= 0.5 * M.inertia[j] * M.unknown[U_SIZE] / M.unknown[U_SCALE] * v * v
        S.force[j] += effort


@_fast
def _derivative(M, S, x, t, volt, shove, dx):
    """Time derivative of the state."""
    D, nb = M.drive, M.inertia.shape[0]
    for j in range(nb):
        S.force[j] = 0.0
    _screw(M, S, x, dx)
    on_base = _links(M, S, x, t) + _frictions(M, S, x)
    _bodies(M, S, x, shove)
    i, omega = x[0], x[2 + nb]
    dx[0] = (volt - D[D_R] * (1.0 + S.scalar[S_HEAT]) * i - D[D_KB] * omega) / D[D_L]
    torque = D[D_KT] * i * (1.0 + D[D_RIPPLE] * math.sin(D[D_PERIODS] * x[2] + D[D_PHASE]))
    if M.unknown[U_KIND] == DIRECTIONAL_TORQUE:
        torque += D[D_KT] * i * M.unknown[U_SIZE] * math.tanh(omega / M.unknown[U_SCALE])
    S.force[0] += torque
    for j in range(nb):
        inertia = M.inertia[j]
        if j == 0 and D[D_SHARE] != 0.0 and S.scalar[S_CONTACT] > 0.0:
            S.force[0] += D[D_SHARE] * D[D_LEAD] * on_base
            inertia += D[D_SHARE] * D[D_LEAD] ** 2 * D[D_BASE_MASS]
        if M.unknown[U_KIND] == POSITION_MASS and M.unknown[U_PLACE] == j:
            inertia *= max(0.1, 1.0 + M.unknown[U_SIZE] * x[2 + j] / M.unknown[U_SCALE])
        dx[2 + j] = x[2 + nb + j]
        dx[2 + nb + j] = S.force[j] / inertia


@_fast
def _advance(M, S, t, h, volt, shove0, shove1):
    """One step: four stages, then the memory of bristles, yielding links and the warm winding."""
    n = S.x.shape[0]
    D = M.drive
    for i in range(n):
        S.start[i] = S.x[i]
        S.trial[i] = S.x[i]
        S.total[i] = S.x[i]
    for stage in range(4):
        c = _STAGE[stage]
        _derivative(M, S, S.trial, t + c * h, volt, shove0 + c * (shove1 - shove0), S.rates)
        c = _STAGE[stage + 1] * h if stage < 3 else 0.0
        for i in range(n):
            S.total[i] += h * _WEIGHT[stage] * S.rates[i]
            S.trial[i] = S.start[i] + c * S.rates[i]
    for i in range(n):
        S.x[i] = S.total[i]
    if D[D_HEAT] > 0.0:
        target = D[D_HEAT] * D[D_R] * 0.5 * (S.start[0] ** 2 + S.x[0] ** 2)
        S.scalar[S_HEAT] = target + (S.scalar[S_HEAT] - target) * math.exp(-h / D[D_TAU])
    if _gap(M, S.x[1]) == 0.0:
        S.x[1] = S.x[2]
    _keep(M, S)


@_fast
def _keep(M, S):
    """Move the memory of bristles and yielding links to the end of the step."""
    _screw(M, S, S.x, S.rates)
    _frictions(M, S, S.x)
    for c in range(S.bristle.shape[0]):
        S.bristle_start[c] = S.bristle[c]
    for j in range(M.link.shape[0]):
        if M.link[j, L_FORCE] != 0.0:
            s = _of(S.x, 2, S.scalar[S_BASE], M.link_ends[j, 1]) - _of(S.x, 2, S.scalar[S_BASE], M.link_ends[j, 0])
            shift = s - S.yielding_start[2 * j + 1]
            S.yielding_start[2 * j] = yielded_after(S.yielding_start[2 * j], shift, M.link[j, L_YIELD])
            S.yielding_start[2 * j + 1] = s


@_inlined
def _look(M, S, s):
    """What sensor ``s`` measures at this moment, before its errors, SI."""
    index = int(M.sensor[s, Y_INDEX])
    if index >= 0:
        return S.x[index]
    return S.scalar[S_BASE] if index == BASE_POSITION else S.scalar[S_BASE_RATE]


@_fast
def _show(M, history, newest, s):
    """What sensor ``s`` shows: its value Y_DELAY ago, between two entries of the ring, scaled and shifted."""
    row, length = M.sensor[s], history.shape[0]
    back = row[Y_DELAY] / (M.sample_time / M.substeps)
    whole = int(back)
    part = back - whole
    value = history[(newest - whole) % length, s]
    if part > 0.0:
        value += part * (history[(newest - whole - 1) % length, s] - value)
    return row[Y_GAIN] * value + row[Y_OFFSET]


@_inlined
def _command(M, S, C, signals, seen, k):
    """The command of sample k, V: a P controller of the motor's angle behind a prefilter, and a slow integral."""
    r, F = signals.reference[k], S.control
    if C[C_CLOSED] == 0.0:
        return r + signals.dither[k]
    F[0] += C[C_FILTER] * (r - F[0])
    F[1] += C[C_FILTER] * (F[0] - F[1])
    lead = M.drive[D_LEAD]
    F[2] += C[C_INTEGRAL] * (F[1] - seen[signals.roles[1]]) / lead
    u = C[C_GAIN] * (F[1] / lead + F[2] - seen[signals.roles[0]]) + signals.dither[k]
    return min(max(u, -C[C_LIMIT]), C[C_LIMIT])


@_fast
def run_machine(M, S, C, signals, history, u, truth, seen, states):
    """Run all samples; returns the number of samples that stayed finite.

    Parameters
    ----------
    history : (m, ns) ring for the delays. u : (N+1,) V, truth, seen : (N+1, ns) SI without and with noise and counts,
        states : (N+1, n), all written.
    """
    h, newest, sensors = M.sample_time / M.substeps, 0, M.sensor.shape[0]
    for k in range(u.shape[0]):
        for s in range(sensors):
            row = M.sensor[s]
            truth[k, s] = _show(M, history, newest, s)
            seen[k, s] = truth[k, s] + row[Y_NOISE] * signals.noise[k, s]
            if row[Y_COUNT] > 0.0:
                seen[k, s] = row[Y_COUNT] * math.floor(seen[k, s] / row[Y_COUNT] + 0.5)
        for i in range(S.x.shape[0]):
            states[k, i] = S.x[i]
        u[k] = _command(M, S, C, signals, seen[k], k)
        if not math.isfinite(u[k]) or not abs(S.x[2]) < 1e6:
            return k
        if k + 1 == u.shape[0]:
            break
        before, after = signals.disturbance[k], signals.disturbance[k + 1]
        for j in range(M.substeps):
            begin, end = j / M.substeps, (j + 1) / M.substeps
            volt = voltage(M.drive, u, k, begin, end, M.sample_time)
            shove0, shove1 = before + begin * (after - before), before + end * (after - before)
            _advance(M, S, (k + begin) * M.sample_time, h, volt, shove0, shove1)
            newest = (newest + 1) % history.shape[0]
            for s in range(sensors):
                history[newest, s] = _look(M, S, s)
    return u.shape[0]
