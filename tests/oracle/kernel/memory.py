"""What remembers: memories after a step, and the force of a spring that goes with its own at the step's end.

A memory follows the stretch in closed form, however small its reach is beside a step's motion. A spring that yields
within micrometres is stiff until it does: the force at the end of a step is solved for together with the stretch to
which it leads, which no step is too long for. The memory of a body's law follows its rate.
"""

from dtbacklash.physics.kernel import plant as pl
from oracle.kernel import laws
from oracle.kernel.forces import base_motion, gained, push, respond, stretch_of

#: the force is solved for to this share of its change
SOLVED, MOST_ROUNDS = 1e-8, 60


def _stretch(P, x, j, angle):
    """Stretch of link ``j`` at state ``x`` and a screw's angle, m or rad."""
    return stretch_of(P, x, j, base_motion(P, x, 0, angle, 0.0)[0] if P.has_base else 0.0, 0.0)[0]


def _advanced(code, z, q0, v0, q1, v1, t, h, p, e):
    """A body's memory after a step of ``h`` seconds from ``q0``, ``v0`` to ``q1``, ``v1``.

    Exponential time differencing with the rate's slope by the memory in the middle, and a rate that goes linearly from
    what it is at the start to what it is at the end (Cox & Matthews, J. Comput. Phys. 176 (2002) 430): exact where the
    rate is linear in the memory and in such a motion, and stable however fast the memory falls.
    """
    first = laws.memory_rate(code, z, q0, v0, t, p, e)
    last = laws.memory_rate(code, z, q1, v1, t + h, p, e)
    near = 1e-4 * (abs(z) + h * max(abs(first), abs(last)))
    if near == 0.0:
        return z
    q, v, middle = 0.5 * (q0 + q1), 0.5 * (v0 + v1), t + 0.5 * h
    above = laws.memory_rate(code, z + near, q, v, middle, p, e)
    below = laws.memory_rate(code, z - near, q, v, middle, p, e)
    a = min(0.5 * h * (above - below) / near, 30.0)
    if abs(a) < 1e-4:
        return z + h * (first * (0.5 + a / 3.0) + last * (0.5 + a / 6.0))
    held = laws.MATH.expm1(a) / a
    return z + h * (held * first + (held - 1.0) / a * (last - first))


def _bodies_remember(P, S, t, h):
    place = P.slot[pl.BODY_MEMORY]
    for i in range(P.n_bodies):
        q, v = P.position + i, P.position + P.n_bodies + i
        for e in range(P.first[place + i], P.first[place + i + 1]):
            m = P.law[e, 1]
            S.xn[m] = _advanced(P.law[e, 0], S.x[m], S.x[q], S.x[v], S.xn[q], S.xn[v], t, h, P.law_p, e)
            S.xp[m] = S.xn[m]


def remember(P, S, angle, angle_end, t, h):
    """Set the memories at the step's end, in ``S.xn`` and ``S.xp``, by the motion from ``S.x`` to ``S.xn``.

    angle, angle_end : theta_d at the step's start and end, rad. t : time at its start, s. h : its length, s.
    """
    _bodies_remember(P, S, t, h)
    for j in range(P.link.shape[0]):
        place = P.slot[pl.LINK] + pl.PER_LINK * j + pl.MEMORIES
        if P.first[place] < P.first[place + 1]:
            s = _stretch(P, S.x, j, angle)
            change = _stretch(P, S.xn, j, angle_end) - s
            for e in range(P.first[place], P.first[place + 1]):
                m = P.law[e, 1]
                S.xn[m] = laws.memory_after(P.law[e, 0], S.x[m], change, P.law_p, e)
                S.xp[m] = S.xn[m]


def settle_memories(P, S, level, contact, angle, angle_end):
    """Solve for the forces of the springs that remember at the step's end, each with the stretch that it leads to.

    ``S.xn`` holds the step's end under the forces that the predictor expected there, and the memories with them.
    """
    R = P.P2[contact, level]
    for j in range(P.link.shape[0]):
        place = P.slot[pl.LINK] + pl.PER_LINK * j + pl.MEMORIES
        if P.first[place] < P.first[place + 1]:
            a, b, lever = P.link_ends[j, 0], P.link_ends[j, 1], P.link[j, pl.L_LEVER]
            s = _stretch(P, S.x, j, angle)
            give = gained(R, P.position, a, b, lever)
            for e in range(P.first[place], P.first[place + 1]):
                m = P.law[e, 1]
                change = _stretch(P, S.xn, j, angle_end) - s
                more = _more(P.law[e, 0], P.law_p, e, S.x[m], change, give, S.xn[m])
                respond(P, S, R, contact, a, b, lever, -more)
                push(P, S.w1, contact, b, -more)
                push(P, S.w1, contact, a, lever * more)


def _more(code, p, e, z, change, give, expected):
    """By how much a memory's force exceeds what was expected, with the stretch that it leads to.

    The more it pulls the ends together the less the link is stretched, so that what is left falls with it: a root in a
    bracket, by secants, and the Illinois rule where one of its ends stays.

    give : how much less the link is stretched by a unit of it. expected : the memory that was expected.
    """
    held = laws.memory_force(code, expected, change, p, e)
    low, high = 0.0, _beyond(code, p, e, z, change, held)
    left_low, enough = high, SOLVED * abs(high)
    if high == 0.0 or give <= 0.0:
        return high
    left_high = _beyond(code, p, e, z, change - give * high, held + high)
    stayed = 0
    for _ in range(MOST_ROUNDS):
        if abs(left_high) <= enough or left_high == left_low:
            break
        at = high - left_high * (high - low) / (left_high - left_low)
        left = _beyond(code, p, e, z, change - give * at, held + at)
        if (left > 0.0) != (left_high > 0.0):
            low, left_low, stayed = high, left_high, 0
        else:
            left_low *= 0.5 if stayed else 1.0
            stayed = 1
        high, left_high = at, left
    return high


def _beyond(code, p, e, z, change, force):
    """How far a memory's force lies above ``force`` after a change of the stretch."""
    return laws.memory_force(code, laws.memory_after(code, z, change, p, e), change, p, e) - force
