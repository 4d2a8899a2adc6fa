"""Events within a sample: the gear closes or opens, friction contacts come to rest, turn round or break loose."""

from dtbacklash.physics.kernel import plant as pl
from oracle.kernel.forces import add_forces, body_acceleration, gained, held_level, push
from oracle.kernel.step import screw_angle, slip_rate

#: a contact is located well enough when the gear would move no farther than this by what is left, rad (relative to an
#: angle above 1 rad). A motor that creeps to rest on a flank would otherwise be chased through steps in which its
#: angle does not change by rounding any more.
NEAR_RAD = 1e-12

NO_EVENT, GEAR_CLOSES, GEAR_OPENS, FRICTION, LEANING_ENDS = 0, 1, 2, 3, 4


def find_event(P, S, gap, gap_rate):
    """The first kind of event that the step to ``S.xn`` has passed; ``gap`` is the half-gap at its end."""
    mode = S.mode[0]
    theta_d = S.gear[0]
    if P.rotor >= 0 and mode != pl.RIGID:
        if mode == pl.FREE and S.lean[0] != 0:
            if _leaning_ends(P, S, S.xn) != 0:
                return LEANING_ENDS
        elif mode == pl.FREE:
            if abs(S.xn[P.position + P.rotor] - theta_d) > gap:
                return GEAR_CLOSES
        elif mode * S.xn[P.position + P.n_bodies + P.rotor] < gap_rate:
            return GEAR_OPENS
    if P.friction_ends.shape[0] > 0:
        return _friction_event(P, S, mode, theta_d, gap_rate)
    return NO_EVENT


def _friction_event(P, S, mode, theta_d, gap_rate):
    """Whether a contact that slips has turned round, or one that sticks cannot be held any longer."""
    contact = 0 if mode == pl.FREE else 1
    found = NO_EVENT
    for c in range(P.friction_ends.shape[0]):
        if S.mode[1 + c] == 0:
            push(P, S.w1, contact, P.friction_ends[c, 1], S.reaction[c])
            push(P, S.w1, contact, P.friction_ends[c, 0], -S.reaction[c])
    for c in range(P.friction_ends.shape[0]):
        direction = S.mode[1 + c]
        if direction == 0:
            if abs(S.reaction[c]) <= held_level(P, S, c, S.reaction[c]):
                # the step's mean is not what is needed at its end: correct it by the acceleration that it leaves
                acceleration, mobility = _slip_acceleration(P, S.xn, S.w1, c, contact)
                S.reaction[c] -= acceleration / mobility
            if abs(S.reaction[c]) > held_level(P, S, c, S.reaction[c]):
                found = FRICTION
        elif direction * slip_rate(P, S, S.xn, c, theta_d, gap_rate) < 0.0:
            found = FRICTION
    return found


def located(P, S, event, gap, gap_rate, h):
    """Whether the event of the gear lies so near to the end of the step of ``h`` seconds that nothing is lost."""
    if event in (FRICTION, LEANING_ENDS):
        return False
    theta_m = S.xn[P.position + P.rotor]
    if event == GEAR_CLOSES:
        beyond = abs(theta_m - S.gear[0]) - gap
    else:
        beyond = (gap_rate - S.mode[0] * S.xn[P.position + P.n_bodies + P.rotor]) * h
    return beyond <= NEAR_RAD * max(1.0, abs(theta_m))


def switch_gear(P, S, gap, gap_rate):
    """Let the gear close or open at the present state."""
    mode = S.mode[0]
    if P.rotor < 0 or mode == pl.RIGID:
        return
    theta_m = S.x[P.position + P.rotor]
    speed = P.position + P.n_bodies + P.rotor
    if S.lean[0] != 0:
        ends = _leaning_ends(P, S, S.x)
        if ends != 0:
            S.mode[0] = S.lean[0] if ends > 0 else pl.FREE
            S.lean[0] = 0
    elif mode == pl.FREE:
        z = theta_m - S.gear[0]
        if abs(z) > gap:
            S.mode[0] = pl.PLUS if z > 0.0 else pl.MINUS
            carried = P.screw[pl.S_SHARE] * P.screw[pl.S_LEAD] ** 2 * P.screw[pl.S_BASE_MASS]
            if carried != 0.0:  # the teeth meet without rebound: momentum is shared with what the screw carries
                inertia = P.screw[pl.S_INERTIA]
                S.x[speed] = (inertia * S.x[speed] + carried * S.mode[0] * gap_rate) / (inertia + carried)
            _jerk_base_contacts(P, S, gap_rate)
    elif mode * S.x[speed] < gap_rate:
        S.gear[0] = theta_m - mode * gap
        S.mode[0] = pl.FREE
        if P.screw[pl.S_SHARE] != 0.0:
            S.w1[pl.CH_D] += P.screw[pl.S_LEAD] * theta_m  # the base's place for the free gear's matrices
            if mode * body_acceleration(P, S.x, S.w1, 0, P.rotor) > 0.0:
                S.lean[0] = mode
                S.x[speed] = mode * gap_rate


def _leaning_ends(P, S, x):
    """Whether the motor that leans on its load lets go (-1) or overcomes it (+1) at state ``x``; 0: neither."""
    free = body_acceleration(P, x, S.w1, 0, P.rotor)
    if S.lean[0] * free < 0.0:
        return -1
    base = P.screw[pl.S_LEAD] * x[P.position + P.rotor]
    S.w1[pl.CH_D] -= base
    loaded = body_acceleration(P, x, S.w1, 1, P.rotor)
    S.w1[pl.CH_D] += base
    return 1 if S.lean[0] * loaded > 0.0 else 0


def _jerk_base_contacts(P, S, gap_rate):
    """The base has jumped to the motor's speed: friction contacts with an end on it slip from now on."""
    for c in range(P.friction_ends.shape[0]):
        if _on_base(P, c):
            rate = slip_rate(P, S, S.x, c, S.gear[0], gap_rate)
            S.mode[1 + c] = 1 if rate > 0.0 else (-1 if rate < 0.0 else 0)


def switch_friction(P, S, t, gap, gap_rate, voltage):
    """Let friction contacts come to rest, turn round or break loose at the present state."""
    contact = 0 if S.mode[0] == pl.FREE else 1
    theta_d = screw_angle(P, S, gap) if not P.imposed else S.gear[0]
    for c in range(P.friction_ends.shape[0]):
        if S.mode[1 + c] == 0:
            if abs(S.reaction[c]) > held_level(P, S, c, S.reaction[c]):
                S.mode[1 + c] = -1 if S.reaction[c] > 0.0 else 1
            continue
        rate = slip_rate(P, S, S.x, c, theta_d, gap_rate)
        if S.mode[1 + c] * rate >= 0.0:
            continue
        S.mode[1 + c] = 0
        w = S.w0
        w[:] = 0.0
        w[pl.CH_V] = voltage
        w[pl.CH_D] = P.screw[pl.S_LEAD] * (theta_d - (S.x[P.position + P.rotor] if contact == 1 else 0.0))
        add_forces(P, S, S.x, w, contact, t, theta_d, 0.0)
        acceleration, mobility = _slip_acceleration(P, S.x, w, c, contact)
        turns = abs(acceleration) > mobility * held_level(P, S, c, -acceleration)
        if turns and P.imposed and _on_base(P, c):
            S.mode[1 + c] = 1 if rate > 0.0 else -1  # it passes through rest: what it has left of speed is its own
            continue
        _stop(P, S, c, contact, rate / mobility)
        if turns:
            S.mode[1 + c] = 1 if acceleration > 0.0 else -1


def _on_base(P, c):
    """Whether friction contact ``c`` has an end on the base."""
    return min(P.friction_ends[c, 0], P.friction_ends[c, 1]) == pl.BASE


def turn_contacts(P, S, h, theta_d, gap_rate):
    """Contacts with the imposed base whose slip has turned round by a jump of the base's speed slip the other way.

    A measured angle moves in jerks, of its noise at least. Friction cannot follow one that it could not stop within the
    step of ``h`` seconds: the impulse that would is no force of its.
    """
    contact = 0 if S.mode[0] == pl.FREE else 1
    for c in range(P.friction_ends.shape[0]):
        if S.mode[1 + c] == 0 or not _on_base(P, c):
            continue
        rate = slip_rate(P, S, S.x, c, theta_d, gap_rate)
        mobility = gained(P.G[contact], P.position + P.n_bodies, P.friction_ends[c, 0], P.friction_ends[c, 1], 1.0)
        if S.mode[1 + c] * rate < 0.0 and abs(rate) > mobility * h * held_level(P, S, c, -rate):
            S.mode[1 + c] = 1 if rate > 0.0 else -1


def torn_loose(P, S):
    """Whether the imposed base has torn contacts loose in the step just tried; they slip from its start then."""
    torn = False
    for c in range(P.friction_ends.shape[0]):
        if S.mode[1 + c] == 0 and _on_base(P, c) and abs(S.reaction[c]) > held_level(P, S, c, S.reaction[c]):
            S.mode[1 + c] = -1 if S.reaction[c] > 0.0 else 1
            torn = True
    return torn


def _slip_acceleration(P, x, w, c, contact):
    """Acceleration of a contact's slip under the channels ``w``, and what one newton on it adds."""
    acceleration, mobility = 0.0, 0.0
    for end, sign in ((P.friction_ends[c, 1], 1.0), (P.friction_ends[c, 0], -1.0)):
        if end >= 0:
            acceleration += sign * body_acceleration(P, x, w, contact, end)
            mobility += P.G[contact, pl.CH_F + end, P.position + P.n_bodies + end]
        elif end == pl.BASE and contact == 1 and P.rotor >= 0:
            acceleration += sign * P.screw[pl.S_LEAD] * body_acceleration(P, x, w, contact, P.rotor)
    return acceleration, mobility


def _stop(P, S, c, contact, impulse):
    """Take out the rest of a contact's slip by an impulse (N s) between its ends."""
    first = P.position + P.n_bodies
    a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
    if b >= 0:
        S.x[first + b] -= impulse * P.G[contact, pl.CH_F + b, first + b]
    if a >= 0:
        S.x[first + a] += impulse * P.G[contact, pl.CH_F + a, first + a]


def settle_gear(P, S, gap0, gap1, gap_rate):
    """At a sample's start: no gap means rigid, and a gap that opens faster than the motor follows frees the gear."""
    mode = S.mode[0]
    if gap0 == 0.0 and gap1 == 0.0:
        S.mode[0] = pl.RIGID
        return
    if mode == pl.RIGID:
        S.gear[0] = S.x[P.position + P.rotor]
        S.mode[0] = pl.FREE
    elif mode != pl.FREE and mode * S.x[P.position + P.n_bodies + P.rotor] < gap_rate:
        S.gear[0] = S.x[P.position + P.rotor] - mode * gap0
        S.mode[0] = pl.FREE
