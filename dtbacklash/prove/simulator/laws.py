"""The concealing simulator's laws with corners or memory, formulated otherwise than in :mod:`dtbacklash.physics`."""

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
