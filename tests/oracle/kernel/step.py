"""One step of the plant, and one sample: exact linear propagation, forces by a predictor and a corrector, events.

Second order in the step for forces beside the linear plant; exact for the linear plant, whether the gear is in
contact or not. A step in which the gear closes or opens, or a friction contact comes to rest or breaks loose, is
halved until the event is located to a tick (``sample_time/substeps/2**(levels-1)``).
"""

from dtbacklash.compiled import compiled, inlined
from dtbacklash.physics.kernel import plant as pl
from oracle.kernel.forces import add_forces, base_motion, end_velocity, gained, respond
from oracle.kernel.memory import remember, settle_memories

#: a sample with more events than this (chatter) is finished without locating further ones: a contact at the edge of
#: slipping switches as often as it is looked at, which costs and changes nothing
MOST_EVENTS = 12


@inlined
def screw_angle(P, S, gap):
    """theta_d, rad, at the present state with half-gap ``gap``."""
    mode = S.mode[0]
    if mode == pl.FREE:
        return S.gear[0]
    theta_m = S.x[P.position + P.rotor]
    return theta_m if mode == pl.RIGID else theta_m - mode * gap


@inlined
def rate_of_screw(P, x, mode, gap_rate):
    """Rate of theta_d, rad/s."""
    if mode == pl.FREE or P.rotor < 0:
        return 0.0
    omega = x[P.position + P.n_bodies + P.rotor]
    return omega if mode == pl.RIGID else omega - mode * gap_rate


@inlined
def drive_rate(P, S, x, gap_rate):
    """Rate of theta_d, rad/s, at state ``x``, whether it is imposed or simulated."""
    return S.gear[1] if P.imposed else rate_of_screw(P, x, S.mode[0], gap_rate)


@compiled
def _held(E, P1, x, w0, channels, xn, xp):
    """xn = xp = E x + P1 w0 over the first ``channels``: the inputs of the step's start, held.

    Four states at a time: their sums stay in registers, instead of being stored and read again for each term.
    """
    n = x.shape[0]
    whole = n - n % 4
    for i in range(0, whole, 4):
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for j in range(n):
            a += E[j, i] * x[j]
            b += E[j, i + 1] * x[j]
            c += E[j, i + 2] * x[j]
            d += E[j, i + 3] * x[j]
        for j in range(channels):
            a += P1[j, i] * w0[j]
            b += P1[j, i + 1] * w0[j]
            c += P1[j, i + 2] * w0[j]
            d += P1[j, i + 3] * w0[j]
        xn[i], xn[i + 1], xn[i + 2], xn[i + 3] = a, b, c, d
        xp[i], xp[i + 1], xp[i + 2], xp[i + 3] = a, b, c, d
    for i in range(whole, n):
        a = 0.0
        for j in range(n):
            a += E[j, i] * x[j]
        for j in range(channels):
            a += P1[j, i] * w0[j]
        xn[i] = a
        xp[i] = a


@compiled
def _risen(P2, w0, w1, channels, xp, xn):
    """xn = xp + P2 (w1 - w0): the inputs rise linearly to those of the step's end."""
    n = xn.shape[0]
    whole = n - n % 4
    for i in range(0, whole, 4):
        a, b, c, d = xp[i], xp[i + 1], xp[i + 2], xp[i + 3]
        for j in range(channels):
            rise = w1[j] - w0[j]
            a += P2[j, i] * rise
            b += P2[j, i + 1] * rise
            c += P2[j, i + 2] * rise
            d += P2[j, i + 3] * rise
        xn[i], xn[i + 1], xn[i + 2], xn[i + 3] = a, b, c, d
    for i in range(whole, n):
        a = xp[i]
        for j in range(channels):
            a += P2[j, i] * (w1[j] - w0[j])
        xn[i] = a


@inlined
def _propagate(P, S, level, contact, channels):
    """The step's end under the inputs of its start."""
    _held(P.E[contact, level], P.P1[contact, level], S.x, S.w0, channels, S.xn, S.xp)


@inlined
def _ramp(P, S, level, contact, channels):
    """The step's end under inputs that rise to those of its end."""
    _risen(P.P2[contact, level], S.w0, S.w1, channels, S.xp, S.xn)


@inlined
def _hold(P, S, level, contact, theta_d, gap_rate):
    """Find the forces that bring every sticking contact to rest at the end of the step (Gauss-Seidel)."""
    frictions = P.friction_ends.shape[0]
    sticking = 0
    for c in range(frictions):
        S.reaction[c] = 0.0
        sticking += S.mode[1 + c] == 0
    if sticking == 0:
        return
    R = P.P1[contact, level]
    for _ in range(1 if sticking == 1 else 60):
        worst = 0.0
        for c in range(frictions):
            if S.mode[1 + c] == 0:
                a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
                rate = slip_rate(P, S, S.xn, c, theta_d, gap_rate)
                change = -rate / gained(R, P.position + P.n_bodies, a, b, 1.0)
                S.reaction[c] += change
                respond(P, S, R, contact, a, b, 1.0, change)
                worst = max(worst, abs(change) - 1e-12 * abs(S.reaction[c]))
        if worst <= 0.0:
            break
    _pin(P, S)


@inlined
def _pin(P, S):
    """A body that sticks to the ground stays to the last bit, so that it cannot creep into or out of a contact."""
    for c in range(P.friction_ends.shape[0]):
        a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
        if S.mode[1 + c] == 0 and a == pl.GROUND and b >= 0:
            S.xn[P.position + b] = S.x[P.position + b]
            S.xn[P.position + P.n_bodies + b] = 0.0


@inlined
def slip_rate(P, S, x, c, theta_d, gap_rate):
    """Velocity at which friction contact ``c`` slips, m/s or rad/s."""
    a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
    base_rate = 0.0
    if P.has_base and min(a, b) == pl.BASE:
        base_rate = base_motion(P, x, 0, theta_d, drive_rate(P, S, x, gap_rate))[1]
    return end_velocity(P, x, b, base_rate) - end_velocity(P, x, a, base_rate)


@inlined
def drive_channels(P, S, h, gap, gap_rate, held):
    """What the base feels of the screw beyond the motor's angle, at a step's start and end; ``held`` : a free screw."""
    mode, lead = S.mode[0], P.screw[pl.S_LEAD]
    w0, w1 = S.w0, S.w1
    if mode == pl.FREE:
        w0[pl.CH_D] = lead * held
        w1[pl.CH_D] = w0[pl.CH_D] + lead * S.gear[1] * h
        w0[pl.CH_DD] = lead * S.gear[1]
    elif mode == pl.RIGID:
        w0[pl.CH_D] = 0.0
        w1[pl.CH_D] = 0.0
        w0[pl.CH_DD] = 0.0
    else:
        w0[pl.CH_D] = -lead * mode * gap
        w1[pl.CH_D] = -lead * mode * (gap + gap_rate * h)
        w0[pl.CH_DD] = -lead * mode * gap_rate
    w1[pl.CH_DD] = w0[pl.CH_DD]


@inlined
def linear_step(P, S, level, contact):
    """A step under voltage and screw alone."""
    channels = pl.CH_F if P.has_base else pl.CH_D
    _propagate(P, S, level, contact, channels)
    _ramp(P, S, level, contact, channels)


@inlined
def try_step(P, S, level, h, t, voltage, gap, gap_rate, given):
    """Advance ``S.x`` into ``S.xn`` by a step of ``h`` seconds with the contacts as they are.

    ``given`` is theta_d at the start where the motor's angle is imposed; its rate stands in ``S.gear[1]``.
    """
    mode = S.mode[0]
    contact = 0 if mode == pl.FREE else 1
    w0, w1 = S.w0, S.w1
    if P.forced:
        # both in one loop, lest it becomes a call of memset, from whose wide stores no single word can be read at once
        for c in range(w0.shape[0]):
            w0[c] = 0.0
            w1[c] = 0.0
    w0[pl.CH_V] = voltage
    w1[pl.CH_V] = voltage
    if P.has_base:
        drive_channels(P, S, h, gap, gap_rate, given if P.imposed else S.gear[0])
    if P.forced:
        _forced_step(P, S, level, h, t, contact, gap, gap_rate, given)
    else:
        linear_step(P, S, level, contact)
    if S.lean[0] != 0:
        _rest(P, S, level, h, gap_rate)


@inlined
def _rest(P, S, level, h, gap_rate):
    """Keep the motor on the tooth on which it leans, which stands still or moves away as the gap grows."""
    R = P.P1[0, level]
    channel, speed = pl.CH_F + P.rotor, P.position + P.n_bodies + P.rotor
    tooth_rate = S.lean[0] * gap_rate
    force = (tooth_rate - S.xn[speed]) / R[channel, speed]
    for i in range(S.x.shape[0]):
        S.xn[i] += R[channel, i] * force
    S.xn[P.position + P.rotor] = S.x[P.position + P.rotor] + tooth_rate * h
    S.xn[speed] = tooth_rate


@inlined
def _forced_step(P, S, level, h, t, contact, gap, gap_rate, given):
    """Predictor with the forces of the start, corrector with their mean slope, friction at rest solved in both.

    What springs remember follows from the stretch of each; their force at the end is solved for in the corrector.
    """
    mode = S.mode[0]
    channels = S.w0.shape[0]
    angle = given if P.imposed else screw_angle(P, S, gap)
    rate = drive_rate(P, S, S.x, gap_rate)
    add_forces(P, S, S.x, S.w0, contact, t, angle, rate)
    _propagate(P, S, level, contact, channels)
    start = angle
    if P.imposed:
        angle = given + S.gear[1] * h
    _hold(P, S, level, contact, angle, gap_rate)
    if not P.imposed and mode != pl.FREE:
        angle = S.xn[P.position + P.rotor] - (0 if mode == pl.RIGID else mode * (gap + gap_rate * h))
        rate = rate_of_screw(P, S.xn, mode, gap_rate)
    remember(P, S, start, angle, t, h)
    add_forces(P, S, S.xn, S.w1, contact, t + h, angle, rate)
    _ramp(P, S, level, contact, channels)
    settle_memories(P, S, level, contact, start, angle)
    _hold(P, S, level, contact, angle, gap_rate)
    remember(P, S, start, angle, t, h)
