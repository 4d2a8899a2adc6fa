"""The forces that act beside the linear plant: every law of the rig's effects, summed into channels."""

from dtbacklash.physics.kernel import plant as pl
from oracle.kernel import laws

#: a screw whose friction grows faster than what drives it would jam: what it gives way is not less than this share
LEAST_YIELD = 0.05


def base_motion(P, x, contact, theta_d, theta_d_rate):
    """Position and velocity of the screw's base, m and m/s, with the error of its lead."""
    lead = P.screw[pl.S_LEAD]
    d, rate = lead * theta_d, lead * theta_d_rate
    place = P.slot[pl.LEAD]
    for e in range(P.first[place], P.first[place + 1]):
        d += laws.lead_error(P.law[e, 0], theta_d, P.law_p, e)
        rate += laws.lead_slope(P.law[e, 0], theta_d, P.law_p, e) * theta_d_rate
    return d, rate


def end_velocity(P, x, end, base_rate):
    """Velocity of an end of a link or friction contact, m/s or rad/s."""
    if end >= 0:
        return x[P.position + P.n_bodies + end]
    return base_rate if end == pl.BASE else 0.0


def end_position(P, x, end, base):
    """Position of an end of a link, m or rad."""
    if end >= 0:
        return x[P.position + end]
    return base if end == pl.BASE else 0.0


def push(P, w, contact, end, effort):
    """Add an effort to a body; on the base it reaches the rotor by the screw's reaction."""
    if end >= 0:
        w[pl.CH_F + end] += effort
    elif end == pl.BASE and contact == 1 and P.rotor >= 0:
        w[pl.CH_F + P.rotor] += effort * P.screw[pl.S_SHARE] * P.screw[pl.S_LEAD]


def respond(P, S, R, contact, a, b, lever, effort):
    """S.xn += the response ``R`` to an effort that pushes end b and, by its lever, pushes end a back."""
    for end, sign in ((b, 1.0), (a, -lever)):
        channel, factor = end, sign
        if end == pl.BASE and contact == 1 and P.rotor >= 0:
            channel, factor = P.rotor, sign * P.screw[pl.S_SHARE] * P.screw[pl.S_LEAD]
        if channel >= 0 and factor != 0.0:
            S.xn[:] += R[pl.CH_F + channel] * factor * effort


def _gained_by(R, first, end):
    return R[pl.CH_F + end, first + end] if end >= 0 else 0.0


def gained(R, first, a, b, lever):
    """What end b gains on end a under a unit effort that pushes them apart, by the response ``R``.

    first : where in the state the bodies' positions (or velocities) begin. lever : of end a.
    """
    total = lever * lever * _gained_by(R, first, a) + _gained_by(R, first, b)
    if a >= 0 and b >= 0:
        total -= 2.0 * lever * R[pl.CH_F + a, first + b]
    return total


def stretch_of(P, x, j, base, base_rate):
    """Stretch of link ``j`` and its rate, m and m/s (or rad and rad/s)."""
    a, b, lever = P.link_ends[j, 0], P.link_ends[j, 1], P.link[j, pl.L_LEVER]
    s = end_position(P, x, b, base) - lever * end_position(P, x, a, base)
    return s, end_velocity(P, x, b, base_rate) - lever * end_velocity(P, x, a, base_rate)


def force_beside(P, x, j, s, rate, t):
    """Force of link ``j`` beyond its spring and damper, N or N m."""
    k, c = P.link[j, pl.L_K], P.link[j, pl.L_C]
    force = 0.0
    place = P.slot[pl.LINK] + pl.PER_LINK * j
    for e in range(P.first[place + pl.PLAYS], P.first[place + pl.PLAYS + 1]):
        held = laws.spring_stretch(P.law[e, 0], s, P.law_p, e)
        force += k * (held - s)
        s = held
    for e in range(P.first[place + pl.FORCES], P.first[place + pl.FORCES + 1]):
        force += laws.spring_force(P.law[e, 0], s, rate, t, k, c, P.law_p, e)
    for e in range(P.first[place + pl.MEMORIES], P.first[place + pl.MEMORIES + 1]):
        force += laws.memory_force(P.law[e, 0], x[P.law[e, 1]], 0.0, P.law_p, e)
    return force


def link_force(P, x, j, base, base_rate, t):
    """What link ``j`` pulls its ends together with, N or N m."""
    s, rate = stretch_of(P, x, j, base, base_rate)
    return P.link[j, pl.L_K] * s + P.link[j, pl.L_C] * rate + force_beside(P, x, j, s, rate, t)


def memory_channel(P, e):
    """The channel that is the rate of an entry's memory."""
    return pl.CH_F + P.n_bodies + P.law[e, 1] - (P.position + 2 * P.n_bodies)


def link_forces(P, x, w, contact, t, base, base_rate):
    """Forces of the links beyond spring and damper."""
    for j in range(P.link.shape[0]):
        place = P.slot[pl.LINK] + pl.PER_LINK * j
        if P.first[place] == P.first[place + pl.PER_LINK]:
            continue
        s, rate = stretch_of(P, x, j, base, base_rate)
        force = force_beside(P, x, j, s, rate, t)
        push(P, w, contact, P.link_ends[j, 1], -force)
        push(P, w, contact, P.link_ends[j, 0], P.link[j, pl.L_LEVER] * force)


def body_forces(P, x, w, t):
    """Efforts on single bodies."""
    place = P.slot[pl.BODY_EFFORT]
    for e in range(P.first[place], P.first[place + P.n_bodies]):
        i = P.law[e, 1]
        q, v = x[P.position + i], x[P.position + P.n_bodies + i]
        w[pl.CH_F + i] += laws.body_effort(P.law[e, 0], q, v, t, w[pl.CH_V], P.law_p, e)
    place = P.slot[pl.BODY_MEMORY]
    for i in range(P.n_bodies):
        q, v = x[P.position + i], x[P.position + P.n_bodies + i]
        for e in range(P.first[place + i], P.first[place + i + 1]):
            w[pl.CH_F + i] += laws.remembered_effort(P.law[e, 0], x[P.law[e, 1]], q, v, t, P.law_p, e)


def torque_beside(P, x):
    """What the motor makes beyond its constant times the current, N m or N."""
    place, total = P.slot[pl.MOTOR_TORQUE], 0.0
    for e in range(P.first[place], P.first[place + 1]):
        at = x[P.position + P.driven]
        total += laws.motor_torque(P.law[e, 0], x[P.current], at, P.circuit[pl.C_KT], P.law_p, e)
    return total


def circuit_forces(P, x, w):
    """What the motor makes beyond its constant, and the voltage that the state of its winding eats."""
    w[pl.CH_F + P.driven] += torque_beside(P, x)
    i = x[P.current]
    place = P.slot[pl.WINDING]
    for e in range(P.first[place], P.first[place + 1]):
        R, memory = P.circuit[pl.C_R], x[P.law[e, 1]]
        w[pl.CH_V] -= laws.winding_voltage(P.law[e, 0], memory, i, R, P.law_p, e)
        # the decay is linear and stands in A
        w[memory_channel(P, e)] += laws.winding_rate(P.law[e, 0], 0.0, i, R, P.law_p, e)


def servo_effort(P, x, w):
    """Effort of a servo, and what it would be without limits.

    The position loop asks for a speed, the loop below it for an effort: position_gain (u - q) - speed_gain q'.
    """
    q, v = x[P.position + P.driven], x[P.position + P.n_bodies + P.driven]
    linear = P.circuit[pl.C_POSITION] * (w[pl.CH_V] - q)
    damped = P.circuit[pl.C_SPEED] * v
    asked, largest = P.circuit[pl.C_ASKED], P.circuit[pl.C_LARGEST]
    effort = min(max(linear, -asked), asked) - damped
    return min(max(effort, -largest), largest), linear - damped


def servo_limits(P, x, w):
    """What the limits of a servo take off the effort of its loop, which is linear and stands in A and G."""
    effort, linear = servo_effort(P, x, w)
    w[pl.CH_F + P.driven] += effort - linear


def drive_effort(P, x, w):
    """What the drive does to the body that it drives, N m or N."""
    if P.current >= 0:
        return P.circuit[pl.C_KT] * x[P.current] + torque_beside(P, x)
    if P.circuit[pl.C_POSITION] != 0.0:
        return servo_effort(P, x, w)[0]
    return P.circuit[pl.C_GAIN] * (x[P.lag] if P.lag >= 0 else w[pl.CH_V])


def find_loads(P, S, x, w, t, base, base_rate):
    """What each dry friction carries but for that of the screw, N or N m, into ``S.load``."""
    place = P.slot[pl.FRICTION]
    for e in range(P.first[place], P.first[place + P.friction_ends.shape[0]]):
        carried = P.law[e, 1]
        if carried == pl.DRIVE:
            S.load[e] = drive_effort(P, x, w)
        elif carried >= 0:
            S.load[e] = P.link[carried, pl.L_LEVER] * link_force(P, x, carried, base, base_rate, t)


def force_on_base(P, S, x, t, base, base_rate):
    """Force of the structure on the screw's base, N."""
    total, v = -P.screw[pl.S_BASE_K] * base - P.screw[pl.S_BASE_C] * base_rate, P.position + P.n_bodies
    for i in range(P.n_bodies):
        inverse = P.G[0, pl.CH_F + i, v + i]
        total += (P.G[0, pl.CH_D, v + i] * x[P.position + i] + P.G[0, pl.CH_DD, v + i] * x[v + i]) / inverse
    for j in range(P.link.shape[0]):
        sign = int(P.link_ends[j, 0] == pl.BASE) - int(P.link_ends[j, 1] == pl.BASE)
        if sign != 0:
            s, rate = stretch_of(P, x, j, base, base_rate)
            total += sign * force_beside(P, x, j, s, rate, t)
    for c in range(P.friction_ends.shape[0]):
        a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
        sign = int(a == pl.BASE) - int(b == pl.BASE)
        if sign != 0:
            direction = S.mode[1 + c]
            rate = end_velocity(P, x, b, base_rate) - end_velocity(P, x, a, base_rate)
            sliding = direction * friction_level(P, S, c, abs(rate), direction)
            total += sign * (sliding if direction != 0 else -S.reaction[c])
    return total


def screw_load(P, S, x, w, contact, c, e, slip_speed, t, base, base_rate):
    """Torque by which the screw pushes the base, before its friction, N m; entry ``e`` of contact ``c`` depends on it.

    The base's acceleration depends on this friction, ``size |load|``, itself: with a mobility of the rotor ``g``,
    ``F = F0 - direction size lead^2 mass g |F|``, where ``F0`` is the force without it.
    """
    if contact == 0:
        return 0.0
    lead, direction = P.screw[pl.S_LEAD], S.mode[1 + c]
    force = -force_on_base(P, S, x, t, base, base_rate)
    if direction != 0:
        mobility = P.G[contact, pl.CH_F + P.rotor, P.position + P.n_bodies + P.rotor]
        S.load[e] = 0.0
        others = friction_level(P, S, c, slip_speed, direction)
        moved = P.screw[pl.S_BASE_MASS] * lead
        force += moved * (body_acceleration(P, x, w, contact, P.rotor) - direction * others * mobility)
        by_itself = P.law_p[e, 0] * lead * moved * mobility
        force /= max(1.0 + direction * (by_itself if force > 0.0 else -by_itself), LEAST_YIELD)
    return lead * force


def body_acceleration(P, x, w, contact, body):
    """Acceleration of a body under the channels ``w``, m/s^2 or rad/s^2."""
    i = P.position + P.n_bodies + body
    total = 0.0
    for product in (*(P.A[contact, i] * x).tolist(), *(P.G[contact, :, i] * w).tolist()):
        total += product
    return total


def friction_level(P, S, c, slip_speed, direction):
    """Magnitude of dry friction at contact ``c`` at a slip speed >= 0 in a direction, N or N m."""
    place = P.slot[pl.FRICTION] + c
    level = 0.0
    for e in range(P.first[place], P.first[place + 1]):
        level += laws.friction_level(P.law[e, 0], slip_speed, direction, S.load[e], P.law_p, e)
    return level


def held_level(P, S, c, reaction):
    """What contact ``c`` can hold against at rest: it would give way against the reaction that holds it."""
    return friction_level(P, S, c, 0.0, -1.0 if reaction > 0.0 else 1.0)


def slip_forces(P, S, x, w, contact, t, base, base_rate):
    """Forces of the friction contacts that slip; those that stick are solved for in the step."""
    place = P.slot[pl.FRICTION]
    for c in range(P.friction_ends.shape[0]):
        direction = S.mode[1 + c]
        if direction == 0 and not P.loaded:
            continue
        a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
        rate = end_velocity(P, x, b, base_rate) - end_velocity(P, x, a, base_rate)
        if P.loaded:
            for e in range(P.first[place + c], P.first[place + c + 1]):
                if P.law[e, 1] == pl.SCREW:
                    S.load[e] = screw_load(P, S, x, w, contact, c, e, abs(rate), t, base, base_rate)
        if direction != 0:
            level = friction_level(P, S, c, abs(rate), direction)
            push(P, w, contact, b, -direction * level)
            push(P, w, contact, a, direction * level)


def add_forces(P, S, x, w, contact, t, theta_d, theta_d_rate):
    """Add to the channels ``w`` everything that acts beside the linear plant at state ``x`` and time ``t``."""
    base, base_rate = 0.0, 0.0
    if P.has_base:
        base, base_rate = base_motion(P, x, contact, theta_d, theta_d_rate)
        lead = P.slot[pl.LEAD]
        if P.first[lead + 1] > P.first[lead]:
            w[pl.CH_D] += base - P.screw[pl.S_LEAD] * theta_d
            w[pl.CH_DD] += base_rate - P.screw[pl.S_LEAD] * theta_d_rate
    link_forces(P, x, w, contact, t, base, base_rate)
    body_forces(P, x, w, t)
    if P.current >= 0:
        circuit_forces(P, x, w)
    if P.limited:
        servo_limits(P, x, w)
    if P.loaded:
        find_loads(P, S, x, w, t, base, base_rate)
    slip_forces(P, S, x, w, contact, t, base, base_rate)
