"""The concealing simulator's inner loop: Runge-Kutta of fourth order with many fixed steps, bristles and springs.

It shares no formula with :mod:`dtbacklash.physics`, so that a diagnosis cannot succeed by recognising its own
equations: dry friction is LuGre's bristle (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automat. Contr. 40
(1995) 419), the teeth of the gear meet through a spring and a damper, clipping, dead zone and stop are smooth, and
delays interpolate a fine history. Bristles and yielding links are exact functions of the displacement since the start
of the step, for a constant level of friction, and so cannot become stiff.
"""

# mypy: disallow-untyped-defs=False
# compiled: numba infers the types, annotations would only repeat the docstrings

import math

import numpy as np

from dtbacklash.compiled import compiled, inlined
from dtbacklash.prove.simulator import arrays as col
from dtbacklash.prove.simulator.laws import (
    KNEE,
    body_beyond,
    bristle_after,
    drive_beyond,
    gap_beyond,
    held_stretch,
    inertia_beyond,
    link_beyond,
    reading_beyond,
    softplus,
    voltage,
    yielded_after,
)

#: a tooth's contact: relaxation rate of its spring, 1/s, and the share of the motion that its damper carries at once.
#: A screw that is pushed at a steady speed lags by (1 - share)/rate = 0.5 us.
TOOTH_RATE, TOOTH_SHARE = 2e4, 0.99
#: the rounding of |v|, relative to the speed at which friction matters: m/s or rad/s
SOFT_SPEED = 1e-6

_STAGE = np.array([0.0, 0.5, 0.5, 1.0])
_WEIGHT = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0


@inlined
def _of(x, first, base, end):
    """Position or velocity of an end."""
    if end >= 0:
        return x[first + end]
    return base if end == col.BASE else 0.0


@inlined
def _screw(M, S, x, dx):
    """Motion of the screw's output: the teeth push it through spring and damper, else it holds its place."""
    D, nb = M.drive, M.inertia.shape[0]
    theta, omega = x[2], x[2 + nb]
    gap = gap_beyond(M.unknown, D[col.D_GAP], x[1])
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
    S.scalar[col.S_BASE], S.scalar[col.S_BASE_RATE], S.scalar[col.S_CONTACT] = (
        D[col.D_LEAD] * angle,
        D[col.D_LEAD] * rate,
        contact,
    )
    if D[col.D_PITCH] != 0.0:
        at = D[col.D_WAVE] * angle + D[col.D_SHIFT]
        S.scalar[col.S_BASE] += D[col.D_PITCH] * (math.sin(at) - math.sin(D[col.D_SHIFT]))
        S.scalar[col.S_BASE_RATE] += D[col.D_PITCH] * D[col.D_WAVE] * math.cos(at) * rate


@inlined
def _base(M, S, x, t, dx):
    """Motion of what everything else hangs on: a positioner's, straight between two samples, or the screw's output."""
    if M.drive[col.D_TRAVEL] != 0.0:
        S.scalar[col.S_BASE] = S.scalar[col.S_FROM] + S.scalar[col.S_IMPOSED_RATE] * (t - S.scalar[col.S_SINCE])
        S.scalar[col.S_BASE_RATE] = S.scalar[col.S_IMPOSED_RATE]
        dx[1] = 0.0
    else:
        _screw(M, S, x, dx)


@inlined
def _pull(S, a, b, lever, force):
    """Pull two ends together, a by its lever; returns the force on the rigid base, N."""
    if b >= 0:
        S.force[b] -= force
    if a >= 0:
        S.force[a] += lever * force
    return (force if a == col.BASE else 0.0) - (force if b == col.BASE else 0.0)


@inlined
def _stretched(M, S, x, j):
    """Stretch of link ``j`` and its rate."""
    nb, a, b = M.inertia.shape[0], M.link_ends[j, 0], M.link_ends[j, 1]
    base, base_rate = S.scalar[col.S_BASE], S.scalar[col.S_BASE_RATE]
    lever = M.link[j, col.L_LEVER]
    s = _of(x, 2, base, b) - lever * _of(x, 2, base, a)
    return s, _of(x, 2 + nb, base_rate, b) - lever * _of(x, 2 + nb, base_rate, a)


@inlined
def _link_force(M, S, j, stretch, rate, t):
    """Force of link ``j``, spring and damper and what else is in it; positive pulls its ends together."""
    row, s = M.link[j], stretch
    if row[col.L_LOST] > 0.0:
        s = held_stretch(stretch, row[col.L_LOST])
    force = row[col.L_K] * s * (1.0 + row[col.L_DRIFT] * t) + row[col.L_C] * rate
    if row[col.L_CUBIC] != 0.0:
        force += row[col.L_CUBIC] * s**3
    if row[col.L_QUADRATIC] != 0.0:
        force += row[col.L_QUADRATIC] * rate * math.sqrt(rate * rate + SOFT_SPEED**2)
    if row[col.L_STOP] != 0.0:
        w = KNEE * abs(row[col.L_CLEARANCE]) + 1e-8
        force += row[col.L_STOP] * w * softplus((s - row[col.L_CLEARANCE]) / w)
    if row[col.L_FORCE] != 0.0:
        z, before = S.yielding_start[2 * j], S.yielding_start[2 * j + 1]
        force += row[col.L_FORCE] * yielded_after(z, stretch - before, row[col.L_YIELD])
    return link_beyond(M.unknown, force, j, row[col.L_K], s, rate)


@inlined
def _links(M, S, x, t):
    """Forces of springs and dampers, with what else is in them; returns the force on the rigid base, N."""
    on_base = 0.0
    for j in range(M.link.shape[0]):
        s, rate = _stretched(M, S, x, j)
        force = _link_force(M, S, j, s, rate, t)
        if M.link[j, col.L_LOSS] != 0.0 and M.link_ends[j, 0] >= 0:
            S.lost[M.link_ends[j, 0]] += M.link[j, col.L_LOSS] * M.link[j, col.L_LEVER] * abs(force)
        on_base += _pull(S, M.link_ends[j, 0], M.link_ends[j, 1], M.link[j, col.L_LEVER], force)
    return on_base


@inlined
def _frictions(M, S, x):
    """Forces of the bristles; returns the force on the rigid base, N."""
    nb, on_base = M.inertia.shape[0], 0.0
    base, base_rate = S.scalar[col.S_BASE], S.scalar[col.S_BASE_RATE]
    for c in range(M.friction.shape[0]):
        row, a, b = M.friction[c], M.friction_ends[c, 0], M.friction_ends[c, 1]
        place = _of(x, 2, base, b) - _of(x, 2, base, a)
        rate = _of(x, 2 + nb, base_rate, b) - _of(x, 2 + nb, base_rate, a)
        level = row[col.F_COULOMB] + row[col.F_STRIBECK] * math.exp(-((rate / row[col.F_SPEED]) ** 2))
        most = 1.0
        if row[col.F_LOADED] != 0.0:  # a bristle whose level changes by itself is remembered as a share of its most
            level += S.lost[b]
            most = max(level, 1e-300) / row[col.F_BRISTLE]
        z = bristle_after(most * S.bristle_start[2 * c], place - S.bristle_start[2 * c + 1], level, row[col.F_BRISTLE])
        S.bristle[2 * c], S.bristle[2 * c + 1] = z / most, place
        stretching = rate - abs(rate) * z * row[col.F_BRISTLE] / max(level, 1e-300)
        force = row[col.F_BRISTLE] * z + row[col.F_DAMPING] * stretching
        on_base += _pull(S, a, b, 1.0, force)
    return on_base


@inlined
def _bodies(M, S, x):
    """Efforts on single bodies."""
    nb = M.inertia.shape[0]
    for j in range(nb):
        row, q, v = M.body[j], x[2 + j], x[2 + nb + j]
        effort = row[col.B_LOAD] - row[col.B_LEVELS] - row[col.B_VISCOUS] * v
        if row[col.B_DIFFERENCE] != 0.0:
            effort -= row[col.B_DIFFERENCE] * math.sqrt(v * v + SOFT_SPEED**2)
        if row[col.B_COGGING] != 0.0:
            effort += row[col.B_COGGING] * math.sin(row[col.B_WAVE] * q + row[col.B_PHASE])
        if row[col.B_WEIGHT] != 0.0:
            effort += row[col.B_WEIGHT] * (
                math.sin(q) * math.cos(row[col.B_ANGLE]) + math.cos(q) * math.sin(row[col.B_ANGLE])
            )
        S.force[j] += body_beyond(M.unknown, effort, j, M.inertia[j], q, v, S.course)


@inlined
def _effort(M, S, x, volt, angle, omega, dx):
    """What the motor, or an ideal actuator, does to the body that it drives, N m or N; and the current's rate."""
    D = M.drive
    if D[col.D_EFFORT] != 0.0 and D[col.D_LAG] > 0.0:  # the first state is what has arrived of the command
        dx[0] = (volt - x[0]) / D[col.D_LAG]
        effort = made = D[col.D_EFFORT] * x[0]
    elif D[col.D_EFFORT] != 0.0:
        dx[0] = 0.0
        effort = made = D[col.D_EFFORT] * volt
    elif D[col.D_HOLD] != 0.0:
        dx[0] = 0.0
        wanted = D[col.D_HOLD] * (volt - angle)
        if D[col.D_BRAKE] > 0.0:
            fastest = D[col.D_FAST] * D[col.D_BRAKE]
            wanted = max(-fastest, min(wanted, fastest)) - D[col.D_BRAKE] * omega
        effort = made = max(-D[col.D_STRONG], min(wanted, D[col.D_STRONG]))
    else:
        i = x[0]
        dx[0] = (volt - D[col.D_R] * (1.0 + S.scalar[col.S_HEAT]) * i - D[col.D_KB] * omega) / D[col.D_L]
        made = D[col.D_KT] * i
        effort = made * (1.0 + D[col.D_RIPPLE] * math.sin(D[col.D_PERIODS] * angle + D[col.D_PHASE]))
    return drive_beyond(M.unknown, effort, made, angle, omega, S.course)


@compiled
def _derivative(M, S, x, t, volt, dx):
    """Time derivative of the state."""
    D, nb = M.drive, M.inertia.shape[0]
    for j in range(nb):
        S.force[j] = S.lost[j] = 0.0
    _base(M, S, x, t, dx)
    driven, effort = int(D[col.D_BODY]), 0.0
    if driven >= 0:
        effort = _effort(M, S, x, volt, x[2 + driven], x[2 + nb + driven], dx)
        S.lost[driven] += D[col.D_LOSS] * abs(effort)
    if D[col.D_SCREW_LOSS] != 0.0 and S.scalar[col.S_CONTACT] > 0.0:
        # by the base's acceleration and load as they were a moment ago
        pushed = D[col.D_BASE_MASS] * D[col.D_LEAD] * dx[2 + nb] - S.scalar[col.S_ON_BASE]
        S.lost[0] += D[col.D_SCREW_LOSS] * D[col.D_LEAD] * abs(pushed)
    on_base = _links(M, S, x, t) + _frictions(M, S, x)
    S.scalar[col.S_ON_BASE] = on_base
    _bodies(M, S, x)
    if driven >= 0:
        S.force[driven] += effort
    for j in range(nb):
        inertia = M.inertia[j]
        if j == 0 and D[col.D_SHARE] != 0.0 and S.scalar[col.S_CONTACT] > 0.0:
            S.force[0] += D[col.D_SHARE] * D[col.D_LEAD] * on_base
            inertia += D[col.D_SHARE] * D[col.D_LEAD] ** 2 * D[col.D_BASE_MASS]
        inertia = inertia_beyond(M.unknown, inertia, j, x[2 + j])
        dx[2 + j] = x[2 + nb + j]
        dx[2 + nb + j] = S.force[j] / inertia


@compiled
def _advance(M, S, t, h, volt):
    """One step: four stages, then the memory of bristles, yielding links and the warm winding."""
    n = S.x.shape[0]
    D = M.drive
    for i in range(n):
        S.start[i] = S.x[i]
        S.trial[i] = S.x[i]
        S.total[i] = S.x[i]
    for stage in range(4):
        c = _STAGE[stage]
        for r in range(S.course.shape[1]):
            S.course[0, r] = S.course[1, r] + c * (S.course[2, r] - S.course[1, r])
        _derivative(M, S, S.trial, t + c * h, volt, S.rates)
        c = _STAGE[stage + 1] * h if stage < 3 else 0.0
        for i in range(n):
            S.total[i] += h * _WEIGHT[stage] * S.rates[i]
            S.trial[i] = S.start[i] + c * S.rates[i]
    for i in range(n):
        S.x[i] = S.total[i]
    if D[col.D_HEAT] > 0.0:
        target = D[col.D_HEAT] * D[col.D_R] * 0.5 * (S.start[0] ** 2 + S.x[0] ** 2)
        S.scalar[col.S_HEAT] = target + (S.scalar[col.S_HEAT] - target) * math.exp(-h / D[col.D_TAU])
    if gap_beyond(M.unknown, D[col.D_GAP], S.x[1]) == 0.0:
        S.x[1] = S.x[2]
    _keep(M, S, t + h)


@compiled
def _keep(M, S, t):
    """Move the memory of bristles and yielding links to the end of the step."""
    _base(M, S, S.x, t, S.rates)
    _frictions(M, S, S.x)
    for c in range(S.bristle.shape[0]):
        S.bristle_start[c] = S.bristle[c]
    for j in range(M.link.shape[0]):
        if M.link[j, col.L_FORCE] != 0.0:
            s, _ = _stretched(M, S, S.x, j)
            shift = s - S.yielding_start[2 * j + 1]
            S.yielding_start[2 * j] = yielded_after(S.yielding_start[2 * j], shift, M.link[j, col.L_YIELD])
            S.yielding_start[2 * j + 1] = s


@inlined
def _look(M, S, s, t):
    """What sensor ``s`` measures at this moment, before its errors, SI."""
    index = int(M.sensor[s, col.Y_INDEX])
    if index >= 0:
        return S.x[index]
    if index == col.LINK_FORCE:
        j = int(M.sensor[s, col.Y_PLACE])
        stretch, rate = _stretched(M, S, S.x, j)
        return _link_force(M, S, j, stretch, rate, t)
    if index == col.ACCELERATION:
        return S.rates[2 + M.inertia.shape[0] + int(M.sensor[s, col.Y_PLACE])]
    return S.scalar[col.S_BASE] if index == col.BASE_POSITION else S.scalar[col.S_BASE_RATE]


@compiled
def _show(M, history, newest, s):
    """What sensor ``s`` shows: its value Y_DELAY ago, between two entries of the ring, with its errors."""
    row, length = M.sensor[s], history.shape[0]
    back = row[col.Y_DELAY] / (M.sample_time / M.substeps)
    whole = int(back)
    part = back - whole
    value = history[(newest - whole) % length, s]
    if part > 0.0:
        value += part * (history[(newest - whole - 1) % length, s] - value)
    # a disk off centre by a share e of its radius shows the angle of a point on a circle about another centre
    wobble = row[col.Y_OFF_CENTRE] * (math.sin(value + row[col.Y_PHASE]) - math.sin(row[col.Y_PHASE]))
    return row[col.Y_GAIN] * (value + wobble) + row[col.Y_OFFSET]


@inlined
def _read(M, history, newest, s, courses, k):
    """What sensor ``s`` shows in sample ``k``, with what the catalogue does not have."""
    y = _show(M, history, newest, s)
    if M.unknown.shape[0] == 0:
        return y
    length, h = history.shape[0], M.sample_time / M.substeps
    last = newest - int(M.sensor[s, col.Y_DELAY] / h)
    rate = M.sensor[s, col.Y_GAIN] * (history[last % length, s] - history[(last - 1) % length, s]) / h
    return reading_beyond(M.unknown, y, rate, s, courses, k)


@inlined
def _command(M, S, C, signals, seen, k):
    """The command of sample k, V. A prefilter, then a P controller of the motor's angle with a slow integral; or a PID.

    The PID's rate is filtered; its integral rests while the command is at its limit.
    """
    r, F = signals.reference[k], S.control
    if C[col.C_MODE] == col.OPEN:
        return r + signals.dither[k]
    F[0] += C[col.C_FILTER] * (r - F[0])
    F[1] += C[col.C_FILTER] * (F[0] - F[1])
    if C[col.C_MODE] == col.PID:
        error = F[1] - seen[signals.roles[0]]
        F[3] += C[col.C_CORNER] * (error - F[3])
        v = C[col.C_GAIN] * error + F[2] + C[col.C_RATE] * (error - F[3]) + signals.dither[k]
        if abs(v) < C[col.C_LIMIT]:
            F[2] += C[col.C_INTEGRAL] * error
        return min(max(v, -C[col.C_LIMIT]), C[col.C_LIMIT])
    lead = M.drive[col.D_LEAD]
    F[2] += C[col.C_INTEGRAL] * (F[1] - seen[signals.roles[1]]) / lead
    u = C[col.C_GAIN] * (F[1] / lead + F[2] - seen[signals.roles[0]]) + signals.dither[k]
    return min(max(u, -C[col.C_LIMIT]), C[col.C_LIMIT])


@inlined
def _impose(M, S, u, signals, k):
    """Set out for the position of the next sample: a positioner knows its course, which is given."""
    D = M.drive
    following = signals.reference[k + 1] + signals.dither[k + 1]
    S.scalar[col.S_FROM], S.scalar[col.S_SINCE] = D[col.D_TRAVEL] * u[k], k * M.sample_time
    S.scalar[col.S_IMPOSED_RATE] = D[col.D_TRAVEL] * (following - u[k]) / M.sample_time


@compiled
def run_machine(M, S, C, signals, history, u, truth, seen, states):
    """Run all samples; returns the number of samples that stayed finite.

    history : (m, ns) ring for the delays. u : (N+1,) V, truth, seen : (N+1, ns) SI without and with noise and counts,
        states : (N+1, n), all written.
    """
    h, newest, sensors = M.sample_time / M.substeps, 0, M.sensor.shape[0]
    accelerates = False
    for s in range(sensors):
        accelerates |= M.sensor[s, col.Y_INDEX] == col.ACCELERATION
    for k in range(u.shape[0]):
        for s in range(sensors):
            row = M.sensor[s]
            truth[k, s] = _read(M, history, newest, s, signals.courses, k)
            seen[k, s] = truth[k, s] + row[col.Y_NOISE] * signals.noise[k, s]
            if row[col.Y_COUNT] > 0.0:
                seen[k, s] = row[col.Y_COUNT] * math.floor(seen[k, s] / row[col.Y_COUNT] + 0.5)
        for i in range(S.x.shape[0]):
            states[k, i] = S.x[i]
        u[k] = _command(M, S, C, signals, seen[k], k)
        if not math.isfinite(u[k]) or not abs(S.x[2]) < 1e6:
            return k
        if k + 1 == u.shape[0]:
            break
        if M.drive[col.D_TRAVEL] != 0.0:
            _impose(M, S, u, signals, k)
        for j in range(M.substeps):
            begin, end = j / M.substeps, (j + 1) / M.substeps
            volt = voltage(M.drive, u, k, begin, end, M.sample_time)
            for r in range(S.course.shape[1]):
                before, after = signals.courses[k, r], signals.courses[k + 1, r]
                S.course[1, r], S.course[2, r] = before + begin * (after - before), before + end * (after - before)
            _advance(M, S, (k + begin) * M.sample_time, h, volt)
            newest = (newest + 1) % history.shape[0]
            if accelerates:  # at the step's end, after what has happened in it
                _derivative(M, S, S.x, (k + end) * M.sample_time, volt, S.rates)
            for s in range(sensors):
                history[newest, s] = _look(M, S, s, (k + end) * M.sample_time)
    return u.shape[0]
