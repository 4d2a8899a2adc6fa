"""One sample of the plant: the amplifier, steps with located events, and what the sensors see at its end."""

import math

from dtbacklash.physics.effects.spring import play
from dtbacklash.physics.kernel import plant as pl
from oracle.kernel import laws
from oracle.kernel.events import (
    NO_EVENT,
    find_event,
    located,
    settle_gear,
    switch_friction,
    switch_gear,
    torn_loose,
    turn_contacts,
)
from oracle.kernel.forces import (
    add_forces,
    base_motion,
    body_acceleration,
    link_force,
    push,
)
from oracle.kernel.step import MOST_EVENTS, drive_channels, drive_rate, screw_angle, try_step


def amplify(P, u):
    """The voltage (or command of the actuator) that leaves the amplifier for the command ``u``."""
    place = P.slot[pl.COMMAND]
    for e in range(P.first[place], P.first[place + 1]):
        u = laws.amplified(P.law[e, 0], u, P.law_p, e)
    return u


def _imposed_angle(P, theta, k, share):
    """What is imposed at ``share`` of the way from sample k to the next.

    Straight where a step is as long as a sample, so that its ramp is exact; else through its neighbours with a
    continuous rate (Catmull & Rom, 1974): friction against what moves in jerks would let go at each of them.
    """
    here, there = theta[k], theta[k + 1]
    rise = there - here
    if P.substeps == 1:
        return here + share * rise
    first = 0.5 * (there - theta[k - 1]) if k > 0 else rise
    last = 0.5 * (theta[k + 2] - here) if k + 2 < theta.shape[0] else rise
    bend = (first - rise) * (1.0 - share) - (last - rise) * share
    return here + share * (rise + (1.0 - share) * bend)


def advance(P, S, t, u, gap0, gap1, theta, k):
    """Advance the plant by one sample.

    Parameters
    ----------
    t : time at the sample's start, s. u : command held over the sample, V.
    gap0, gap1 : half-gap at its start and end, rad; linear between.
    theta, k : the motor's angle at all samples where it is imposed (else ignored), rad; this sample begins at k.
    """
    for d in range(S.commands.shape[0] - 1, 0, -1):
        S.commands[d] = S.commands[d - 1]
    S.commands[0] = u
    gap_rate = (gap1 - gap0) / P.sample_time
    if P.has_base and not P.imposed:
        settle_gear(P, S, gap0, gap1, gap_rate)
    _steps(P, S, t, gap0, gap_rate, theta, k)
    S.now[0] = t + P.sample_time


def _next_stop(P, tick, whole):
    """The next tick at which a step has to end: a late command arrives, a late sensor looks, or the sample is over."""
    stop = _stop_of(P.delay_ticks, P.delay_part, tick, whole)
    for s in range(P.sensor_tick.shape[0]):
        if P.sensor_tick[s] > 0:
            stop = min(stop, _stop_of(P.sensor_tick[s], P.sensor_part[s], tick, whole))
    return stop


def _stop_of(at, part, tick, whole):
    """The next tick at which something begins, or ends, that lies within a tick: ``part`` of it after ``at``."""
    if at > tick:
        return at
    return at + 1 if part > 0.0 and at == tick else whole


def _voltage(P, tick, before, after):
    """The voltage from a stop on; in the tick in which the command arrives its mean, which moves the rig as far."""
    if tick == P.delay_ticks:
        return after + P.delay_part * (before - after)
    return before if tick < P.delay_ticks else after


def _level(last, least, left):
    """The level, ``least`` or finer, of the longest step that ends within the ``left`` ticks."""
    level = least
    while (1 << (last - level)) > left:
        level += 1
    return level


def _steps(P, S, t, gap0, gap_rate, theta, k):
    """The steps of one sample, each as long as the events and the delays let it be."""
    last = P.levels - 1
    whole = P.substeps << last
    tick, end = 0, _next_stop(P, 0, whole)
    late = P.delay_ticks > 0 or P.delay_part > 0.0
    before = amplify(P, S.commands[P.delay_whole + (1 if late else 0)])
    after = amplify(P, S.commands[P.delay_whole]) if late else before
    voltage = S.now[1] = _voltage(P, 0, before, after)
    tick_s = P.sample_time / whole
    least, events = 0, 0
    while tick < whole:
        if tick == end:
            voltage = S.now[1] = _voltage(P, tick, before, after)
            S.now[0] = t + tick * tick_s
            for s in range(P.sensor_tick.shape[0]):
                _catch(P, S, s, tick, gap0 + gap_rate * tick * tick_s, gap_rate)
            end = _next_stop(P, tick, whole)
        level = _level(last, least, end - tick)
        ticks = 1 << (last - level)
        h = ticks * tick_s
        start = tick * tick_s
        gap = gap0 + gap_rate * start
        given = S.gear[0]
        if P.imposed:
            angle = _imposed_angle(P, theta, k, (tick + ticks) / whole)
            S.gear[1] = (play(given, angle, gap + gap_rate * h) - given) / h
            turn_contacts(P, S, h, given, gap_rate)
        try_step(P, S, level, h, t + start, voltage, gap, gap_rate, given)
        if P.imposed and torn_loose(P, S):
            continue
        event = find_event(P, S, gap + gap_rate * h, gap_rate)
        chased = event != NO_EVENT and level < last and events < MOST_EVENTS
        if chased and not located(P, S, event, gap + gap_rate * h, gap_rate, h):
            least = level + 1
            continue
        S.x[:] = S.xn
        tick += ticks
        if P.imposed:
            S.gear[0] = given + S.gear[1] * h
        if event != NO_EVENT:
            gap += gap_rate * h
            switch_gear(P, S, gap, gap_rate)
            switch_friction(P, S, t + start + h, gap, gap_rate, voltage)
            events += 1
            least = 0
        elif least == last:  # what a longer step had seen is not there: go on with long steps
            least = 0
            events += 1
        elif least > 0:
            least += 1


def _acceleration(P, S, body, gap, gap_rate):
    """Present acceleration of a body, m/s^2 or rad/s^2; 0 where it sticks to the ground."""
    contact, theta_d = (0 if S.mode[0] == pl.FREE else 1), 0.0
    S.w0[:] = 0.0
    S.w0[pl.CH_V] = S.now[1]
    if P.has_base:
        drive_channels(P, S, 0.0, gap, gap_rate, S.gear[0])
        theta_d = S.gear[0] if P.imposed else screw_angle(P, S, gap)
    add_forces(P, S, S.x, S.w0, contact, S.now[0], theta_d, drive_rate(P, S, S.x, gap_rate))
    for c in range(P.friction_ends.shape[0]):
        if S.mode[1 + c] == 0:
            if P.friction_ends[c, 0] == pl.GROUND and P.friction_ends[c, 1] == body:
                return 0.0
            push(P, S.w0, contact, P.friction_ends[c, 1], S.reaction[c])
            push(P, S.w0, contact, P.friction_ends[c, 0], -S.reaction[c])
    return body_acceleration(P, S.x, S.w0, contact, body)


def read_sensor(P, S, s, gap, gap_rate):
    """Present value of what sensor ``s`` measures, SI, before its errors."""
    index = P.sensor[s, pl.Y_INDEX]
    if math.isnan(index):
        return 0.0
    if index >= 0:
        return S.x[int(index)]
    base, base_rate = 0.0, 0.0
    if P.has_base:
        base, base_rate = base_motion(P, S.x, 0, screw_angle(P, S, gap), drive_rate(P, S, S.x, gap_rate))
    if index == pl.LINK_FORCE:
        j = int(P.sensor[s, pl.Y_PLACE])
        return link_force(P, S.x, j, base, base_rate, S.now[0])
    if index == pl.ACCELERATION:
        return _acceleration(P, S, int(P.sensor[s, pl.Y_PLACE]), gap, gap_rate)
    return base if index == pl.BASE_POSITION else base_rate


def _catch(P, S, s, tick, gap, gap_rate):
    """What a sensor that looks late sees at this tick; between two ticks it sees what lies between."""
    at, part = P.sensor_tick[s], P.sensor_part[s]
    if 0 < at == tick:
        S.caught[s] = (1.0 - part) * read_sensor(P, S, s, gap, gap_rate)
    elif at > 0 and part > 0.0 and at + 1 == tick:
        S.caught[s] += part * read_sensor(P, S, s, gap, gap_rate)


def sense(P, S, gap, gap_rate, y):
    """Write what every sensor shows at this sample into ``y`` (sensors,): delayed, scaled and offset, no noise."""
    for s in range(P.sensor.shape[0]):
        for d in range(S.seen.shape[0] - 1, 0, -1):
            S.seen[d, s] = S.seen[d - 1, s]
        at, part = P.sensor_tick[s], P.sensor_part[s]
        S.seen[0, s] = S.caught[s] if at > 0 else read_sensor(P, S, s, gap, gap_rate)
        if part > 0.0 and at + 1 == P.substeps << (P.levels - 1):
            S.seen[0, s] += part * read_sensor(P, S, s, gap, gap_rate)
        value = S.seen[P.sensor_whole[s], s]
        if P.sensor_play[s] > 0.0:
            value = S.played[s] = play(S.played[s], value, P.sensor_play[s])
        place = P.slot[pl.READING] + s
        for e in range(P.first[place], P.first[place + 1]):
            value = laws.shown(P.law[e, 0], value, P.law_p, e)
        y[s] = value
