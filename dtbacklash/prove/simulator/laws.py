"""The concealing simulator's laws with corners or memory, formulated otherwise than in :mod:`dtbacklash.physics`; and
those that the catalogue does not have, a row of ``U`` each (see :mod:`.arrays`).
"""

# mypy: disallow-untyped-defs=False
# compiled: numba infers the types, annotations would only repeat the docstrings

import math

from dtbacklash.compiled import compiled, inlined
from dtbacklash.prove.simulator import arrays as col

#: width of the rounding of a knee, relative to where it lies
KNEE = 2e-3


@inlined
def softplus(x):
    """log(1 + e^x) without overflow."""
    return x + math.log1p(math.exp(-x)) if x > 0.0 else math.log1p(math.exp(x))


@compiled
def amplify(D, u):
    """Voltage behind gain, dead zone and limiter with rounded knees. V -> V."""
    v = D[col.D_GAIN] * u
    if D[col.D_DEAD] > 0.0:
        w = KNEE * D[col.D_DEAD]
        v = w * (softplus((v - D[col.D_DEAD]) / w) - softplus((-v - D[col.D_DEAD]) / w))
    if D[col.D_LIMIT] < math.inf:
        w = KNEE * D[col.D_LIMIT]
        v += w * (softplus((-v - D[col.D_LIMIT]) / w) - softplus((v - D[col.D_LIMIT]) / w))
    return v


@compiled
def voltage(D, u, k, begin, end, sample_time):
    """Mean voltage from ``begin`` to ``end`` (shares of sample k): the command held over each sample, D_DELAY late."""
    late = D[col.D_DELAY] / sample_time
    a, b = k + begin - late, k + end - late
    first, last = math.floor(a + 1e-9), math.floor(b - 1e-9)
    v = amplify(D, u[int(last)]) if last >= 0 else 0.0
    if first < last:
        before = amplify(D, u[int(first)]) if first >= 0 else 0.0
        v = (before * (last - a) + v * (b - last)) / (b - a)
    return v


@inlined
def bristle_after(z, shift, level, stiffness):
    """Deflection of a LuGre bristle after a relative displacement at a friction level that stays: exact."""
    most = max(level, 1e-300) / stiffness
    rest = most if shift > 0.0 else -most
    return rest + (z - rest) * math.exp(-abs(shift) / most)


@inlined
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


@inlined
def held_stretch(s, lost):
    """What is left of a stretch behind a lost motion, half of it to each side, with rounded corners."""
    half, w = 0.5 * lost, KNEE * lost
    return w * (softplus((s - half) / w) - softplus((-s - half) / w))


@inlined
def gap_beyond(U, gap, theta):
    """Half-gap of a gear whose play depends on the angle of the screw, rad."""
    for r in range(U.shape[0]):
        if U[r, col.U_KIND] == col.ANGULAR_PLAY:
            gap = gap + U[r, col.U_SIZE] * (1.0 + 0.9 * math.sin(theta * U[r, col.U_SCALE]))
    return gap


@inlined
def link_beyond(U, force, j, k, s, rate):
    """Force of link ``j`` of stiffness ``k``, with what the catalogue does not have."""
    for r in range(U.shape[0]):
        if U[r, col.U_PLACE] != j:
            continue
        if U[r, col.U_KIND] == col.ROOT_SPRING:
            x0 = U[r, col.U_SCALE]
            force += U[r, col.U_SIZE] * k * s * math.sqrt(x0) / (s * s + (0.02 * x0) ** 2) ** 0.25
        elif U[r, col.U_KIND] == col.SPEED_STIFFENING:
            force += U[r, col.U_SIZE] * k * s * abs(rate) / U[r, col.U_SCALE]
    return force


@inlined
def body_beyond(U, effort, j, inertia, q, v, course):
    """Effort on body ``j``, with what the catalogue does not have."""
    for r in range(U.shape[0]):
        if U[r, col.U_PLACE] != j:
            continue
        kind, size, scale = U[r, col.U_KIND], U[r, col.U_SIZE], U[r, col.U_SCALE]
        if kind == col.POSITION_DAMPING:
            effort -= size * (q / scale) ** 2 * v
        elif kind in (col.DISTURBANCE, col.COLOURED_FORCE):
            effort += size * course[0, r]
        elif kind == col.POSITION_MASS:
            effort -= 0.5 * inertia * size / scale * v * v
        elif kind == col.WANDERING_FRICTION:
            effort -= size * course[0, r] * v / math.sqrt(v * v + scale * scale)
        elif kind == col.DOUBLE_RIPPLE:
            first = math.sin(U[r, col.U_WAVE] * q + U[r, col.U_PHASE])
            effort += size * (first + scale * math.sin(U[r, col.U_SECOND] * q + U[r, col.U_SHIFT]))
    return effort


@inlined
def inertia_beyond(U, inertia, j, q):
    """Inertia of body ``j`` where it changes with the position."""
    for r in range(U.shape[0]):
        if U[r, col.U_KIND] == col.POSITION_MASS and U[r, col.U_PLACE] == j:
            inertia *= max(0.1, 1.0 + U[r, col.U_SIZE] * q / U[r, col.U_SCALE])
    return inertia


@inlined
def drive_beyond(U, effort, made, q, v, course):
    """Effort of a drive whose gain depends on direction, position or time; ``made`` : without that."""
    for r in range(U.shape[0]):
        kind, size = U[r, col.U_KIND], U[r, col.U_SIZE]
        if kind == col.DIRECTIONAL_TORQUE:
            effort += made * size * math.tanh(v / U[r, col.U_SCALE])
        elif kind == col.POSITION_GAIN:
            effort += made * size * math.tanh(q / U[r, col.U_SCALE])
        elif kind == col.GAIN_DRIFT:
            effort += made * size * course[0, r]
    return effort


@inlined
def reading_beyond(U, y, rate, s, courses, k):
    """What sensor ``s`` reads in sample ``k`` instead of ``y``, which changes at ``rate``: errors of scale and clock.

    A scale that ripples over the reading is right at zero, where it starts.
    """
    read = y
    for r in range(U.shape[0]):
        kind, size = U[r, col.U_KIND], U[r, col.U_SIZE]
        if kind == col.CLOCK_JITTER:
            read += rate * size * courses[k, r]
        elif U[r, col.U_PLACE] != s:
            continue
        elif kind == col.INTERPOLATION:
            read += size * (math.sin(U[r, col.U_WAVE] * y + U[r, col.U_PHASE]) - math.sin(U[r, col.U_PHASE]))
        elif kind == col.CURVED_SCALE:
            read += size * y * y / U[r, col.U_SCALE]
        elif kind == col.READING_DRIFT:
            read += size * courses[k, r]
    return read
