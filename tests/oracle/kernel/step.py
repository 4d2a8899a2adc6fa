"""One step of the plant, and one sample: exact linear propagation, forces by a predictor and a corrector, events.

Second order in the step for forces beside the linear plant; exact for the linear plant, whether the gear is in
contact or not. A step in which the gear closes or opens, or a friction contact comes to rest or breaks loose, is
halved until the event is located to a tick (``sample_time/substeps/2**(levels-1)``).
"""

import numpy as np

from dtbacklash.physics.kernel import plant as pl
from oracle.kernel.forces import add_forces, base_motion, end_velocity, gained, respond
from oracle.kernel.memory import remember, settle_memories

#: a sample with more events than this (chatter) is finished without locating further ones: a contact at the edge of
#: slipping switches as often as it is looked at, which costs and changes nothing
MOST_EVENTS = 12


def screw_angle(P, S, gap):
    """theta_d, rad, at the present state with half-gap ``gap``."""
    mode = S.mode[0]
    if mode == pl.FREE:
        return S.gear[0]
    theta_m = S.x[P.position + P.rotor]
    return theta_m if mode == pl.RIGID else theta_m - mode * gap


def rate_of_screw(P, x, mode, gap_rate):
    """Rate of theta_d, rad/s."""
    if mode == pl.FREE or P.rotor < 0:
        return 0.0
    omega = x[P.position + P.n_bodies + P.rotor]
    return omega if mode == pl.RIGID else omega - mode * gap_rate


def drive_rate(P, S, x, gap_rate):
    """Rate of theta_d, rad/s, at state ``x``, whether it is imposed or simulated."""
    return S.gear[1] if P.imposed else rate_of_screw(P, x, S.mode[0], gap_rate)


def _held(E, P1, x, w0):
    """E x + P1 w0: the inputs of the step's start, held; terms are added in their order."""
    total = np.zeros(len(x))
    for row, factor in (*zip(E, x, strict=True), *zip(P1, w0, strict=False)):
        total += row * factor
    return total


def _propagate(P, S, level, contact, channels):
    """The step's end under the inputs of its start, ``channels`` of them."""
    S.xp[:] = _held(P.E[contact, level], P.P1[contact, level], S.x, S.w0[:channels])
    S.xn[:] = S.xp


def _ramp(P, S, level, contact, channels):
    """The step's end under inputs that rise linearly to those of its end."""
    S.xn[:] = S.xp
    for row, rise in zip(P.P2[contact, level], (S.w1 - S.w0)[:channels], strict=False):
        S.xn[:] += row * rise


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


def _pin(P, S):
    """A body that sticks to the ground stays to the last bit, so that it cannot creep into or out of a contact."""
    for c in range(P.friction_ends.shape[0]):
        a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
        if S.mode[1 + c] == 0 and a == pl.GROUND and b >= 0:
            S.xn[P.position + b] = S.x[P.position + b]
            S.xn[P.position + P.n_bodies + b] = 0.0


def slip_rate(P, S, x, c, theta_d, gap_rate):
    """Velocity at which friction contact ``c`` slips, m/s or rad/s."""
    a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
    base_rate = 0.0
    if P.has_base and min(a, b) == pl.BASE:
        base_rate = base_motion(P, x, 0, theta_d, drive_rate(P, S, x, gap_rate))[1]
    return end_velocity(P, x, b, base_rate) - end_velocity(P, x, a, base_rate)


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


def linear_step(P, S, level, contact):
    """A step under voltage and screw alone."""
    channels = pl.CH_F if P.has_base else pl.CH_D
    _propagate(P, S, level, contact, channels)
    _ramp(P, S, level, contact, channels)


def try_step(P, S, level, h, t, voltage, gap, gap_rate, given):
    """Advance ``S.x`` into ``S.xn`` by a step of ``h`` seconds with the contacts as they are.

    ``given`` is theta_d at the start where the motor's angle is imposed; its rate stands in ``S.gear[1]``.
    """
    mode = S.mode[0]
    contact = 0 if mode == pl.FREE else 1
    w0, w1 = S.w0, S.w1
    if P.forced:
        w0[:] = w1[:] = 0.0
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


def _rest(P, S, level, h, gap_rate):
    """Keep the motor on the tooth on which it leans, which stands still or moves away as the gap grows."""
    R = P.P1[0, level]
    channel, speed = pl.CH_F + P.rotor, P.position + P.n_bodies + P.rotor
    tooth_rate = S.lean[0] * gap_rate
    force = (tooth_rate - S.xn[speed]) / R[channel, speed]
    S.xn[:] += R[channel] * force
    S.xn[P.position + P.rotor] = S.x[P.position + P.rotor] + tooth_rate * h
    S.xn[speed] = tooth_rate


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
