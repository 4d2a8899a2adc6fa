"""The forces that act beside the linear plant: every law of the rig's effects, summed into channels."""

from dtbacklash.compiled import inlined
from dtbacklash.physics.kernel import dispatch
from dtbacklash.physics.kernel import plant as pl


@inlined
def base_motion(P, x, contact, theta_d, theta_d_rate):
    """Position and velocity of the screw's base, m and m/s, with the error of its lead."""
    lead = P.screw[pl.S_LEAD]
    d, rate = lead * theta_d, lead * theta_d_rate
    place = P.slot[pl.LEAD]
    for e in range(P.first[place], P.first[place + 1]):
        d += dispatch.lead_error(P.law[e, 0], theta_d, P.law_p, e)
        rate += dispatch.lead_slope(P.law[e, 0], theta_d, P.law_p, e) * theta_d_rate
    return d, rate


@inlined
def end_velocity(P, x, end, base_rate):
    """Velocity of an end of a link or friction contact, m/s or rad/s."""
    if end >= 0:
        return x[P.position + P.n_bodies + end]
    return base_rate if end == pl.BASE else 0.0


@inlined
def end_position(P, x, end, base):
    """Position of an end of a link, m or rad."""
    if end >= 0:
        return x[P.position + end]
    return base if end == pl.BASE else 0.0


@inlined
def push(P, w, contact, end, effort):
    """Add an effort to a body; on the base it reaches the rotor by the screw's reaction."""
    if end >= 0:
        w[pl.CH_F + end] += effort
    elif end == pl.BASE and contact == 1 and P.rotor >= 0:
        w[pl.CH_F + P.rotor] += effort * P.screw[pl.S_SHARE] * P.screw[pl.S_LEAD]


@inlined
def respond(P, S, R, contact, a, b, lever, effort):
    """S.xn += the response ``R`` to an effort that pushes end b and, by its lever, pushes end a back."""
    n = S.x.shape[0]
    for end, sign in ((b, 1.0), (a, -lever)):
        channel, factor = end, sign
        if end == pl.BASE and contact == 1 and P.rotor >= 0:
            channel, factor = P.rotor, sign * P.screw[pl.S_SHARE] * P.screw[pl.S_LEAD]
        if channel >= 0 and factor != 0.0:
            for i in range(n):
                S.xn[i] += R[pl.CH_F + channel, i] * factor * effort


@inlined
def _gained_by(R, first, end):
    return R[pl.CH_F + end, first + end] if end >= 0 else 0.0


@inlined
def gained(R, first, a, b, lever):
    """What end b gains on end a under a unit effort that pushes them apart, by the response ``R``.

    first : where in the state the bodies' positions (or velocities) begin. lever : of end a.
    """
    total = lever * lever * _gained_by(R, first, a) + _gained_by(R, first, b)
    if a >= 0 and b >= 0:
        total -= 2.0 * lever * R[pl.CH_F + a, first + b]
    return total


@inlined
def stretch_of(P, x, j, base, base_rate):
    """Stretch of link ``j`` and its rate, m and m/s (or rad and rad/s)."""
    a, b, lever = P.link_ends[j, 0], P.link_ends[j, 1], P.link[j, pl.L_LEVER]
    s = end_position(P, x, b, base) - lever * end_position(P, x, a, base)
    return s, end_velocity(P, x, b, base_rate) - lever * end_velocity(P, x, a, base_rate)


@inlined
def force_beside(P, x, j, s, rate, t):
    """Force of link ``j`` beyond its spring and damper, N or N m."""
    k, c = P.link[j, pl.L_K], P.link[j, pl.L_C]
    force = 0.0
    place = P.slot[pl.LINK] + pl.PER_LINK * j
    for e in range(P.first[place + pl.PLAYS], P.first[place + pl.PLAYS + 1]):
        held = dispatch.spring_stretch(P.law[e, 0], s, P.law_p, e)
        force += k * (held - s)
        s = held
    for e in range(P.first[place + pl.FORCES], P.first[place + pl.FORCES + 1]):
        force += dispatch.spring_force(P.law[e, 0], s, rate, t, k, c, P.law_p, e)
    for e in range(P.first[place + pl.MEMORIES], P.first[place + pl.MEMORIES + 1]):
        force += dispatch.memory_force(P.law[e, 0], x[P.law[e, 1]], 0.0, P.law_p, e)
    return force


@inlined
def memory_channel(P, e):
    """The channel that is the rate of an entry's memory."""
    return pl.CH_F + P.n_bodies + P.law[e, 1] - (P.position + 2 * P.n_bodies)


@inlined
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


@inlined
def body_forces(P, x, w, t):
    """Efforts on single bodies."""
    place = P.slot[pl.BODY_EFFORT]
    for e in range(P.first[place], P.first[place + P.n_bodies]):
        i = P.law[e, 1]
        q, v = x[P.position + i], x[P.position + P.n_bodies + i]
        w[pl.CH_F + i] += dispatch.body_effort(P.law[e, 0], q, v, t, P.law_p, e)
    place = P.slot[pl.BODY_MEMORY]
    for i in range(P.n_bodies):
        q, v = x[P.position + i], x[P.position + P.n_bodies + i]
        for e in range(P.first[place + i], P.first[place + i + 1]):
            w[pl.CH_F + i] += dispatch.remembered_effort(P.law[e, 0], x[P.law[e, 1]], q, v, t, P.law_p, e)


@inlined
def circuit_forces(P, x, w):
    """What the motor makes beyond its constant, and the voltage that the state of its winding eats."""
    i = x[P.current]
    place = P.slot[pl.MOTOR_TORQUE]
    for e in range(P.first[place], P.first[place + 1]):
        at = x[P.position + P.driven]
        w[pl.CH_F + P.driven] += dispatch.motor_torque(P.law[e, 0], i, at, P.circuit[pl.C_KT], P.law_p, e)
    place = P.slot[pl.WINDING]
    for e in range(P.first[place], P.first[place + 1]):
        R, memory = P.circuit[pl.C_R], x[P.law[e, 1]]
        w[pl.CH_V] -= dispatch.winding_voltage(P.law[e, 0], memory, i, R, P.law_p, e)
        # the decay is linear and stands in A
        w[memory_channel(P, e)] += dispatch.winding_rate(P.law[e, 0], 0.0, i, R, P.law_p, e)


@inlined
def servo_limits(P, x, w):
    """What the limits of a servo take off the effort of its loop, which is linear and stands in A and G.

    The position loop asks for a speed, the loop below it for an effort: position_gain (u - q) - speed_gain q'.
    """
    q, v = x[P.position + P.limited], x[P.position + P.n_bodies + P.limited]
    effort = linear = P.circuit[pl.C_POSITION] * (w[pl.CH_V] - q)
    asked = P.circuit[pl.C_ASKED]
    effort = min(max(effort, -asked), asked) - P.circuit[pl.C_SPEED] * v
    largest = P.circuit[pl.C_LARGEST]
    w[pl.CH_F + P.limited] += min(max(effort, -largest), largest) - (linear - P.circuit[pl.C_SPEED] * v)


@inlined
def friction_level(P, c, slip_speed, direction):
    """Magnitude of dry friction at contact ``c`` at a slip speed >= 0 in a direction, N or N m."""
    place = P.slot[pl.FRICTION] + c
    level = 0.0
    for e in range(P.first[place], P.first[place + 1]):
        level += dispatch.friction_level(P.law[e, 0], slip_speed, direction, P.law_p, e)
    return level


@inlined
def held_level(P, c, reaction):
    """What contact ``c`` can hold against at rest: it would give way against the reaction that holds it."""
    return friction_level(P, c, 0.0, -1.0 if reaction > 0.0 else 1.0)


@inlined
def slip_forces(P, x, mode, w, contact, base_rate):
    """Forces of the friction contacts that slip; those that stick are solved for in the step."""
    for c in range(P.friction_ends.shape[0]):
        direction = mode[1 + c]
        if direction != 0:
            a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
            rate = end_velocity(P, x, b, base_rate) - end_velocity(P, x, a, base_rate)
            level = friction_level(P, c, abs(rate), direction)
            push(P, w, contact, b, -direction * level)
            push(P, w, contact, a, direction * level)


@inlined
def add_forces(P, x, mode, w, contact, t, theta_d, theta_d_rate):
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
    if P.limited >= 0:
        servo_limits(P, x, w)
    slip_forces(P, x, mode, w, contact, base_rate)
