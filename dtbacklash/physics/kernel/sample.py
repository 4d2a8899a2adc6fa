"""One sample of the plant: the amplifier, steps with located events, and what the sensors see at its end."""

import math

from dtbacklash.compiled import clear, compiled, copy, inlined
from dtbacklash.physics.effects.play import play
from dtbacklash.physics.kernel import dispatch
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.forces import (
    add_forces,
    base_motion,
    body_acceleration,
    gained,
    held_level,
    link_force,
    push,
)
from dtbacklash.physics.kernel.step import MOST_EVENTS, drive_channels, drive_rate, screw_angle, slip_rate, try_step

#: a contact is located well enough when the gear would move no farther than this by what is left, rad (relative to an
#: angle above 1 rad). A motor that creeps to rest on a flank would otherwise be chased through steps in which its
#: angle does not change by rounding any more.
NEAR_RAD = 1e-12

NO_EVENT, GEAR_CLOSES, GEAR_OPENS, FRICTION, LEANING_ENDS = 0, 1, 2, 3, 4


@inlined
def amplify(P, u):
    """The voltage (or command of the actuator) that leaves the amplifier for the command ``u``."""
    place = P.slot[pl.COMMAND]
    for e in range(P.first[place], P.first[place + 1]):
        u = dispatch.amplified(P.law[e, 0], u, P.law_p, e)
    return u


@inlined
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


@compiled
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


@inlined
def _located(P, S, event, gap, gap_rate, h):
    """Whether the event of the gear lies so near to the end of the step of ``h`` seconds that nothing is lost."""
    if event in (FRICTION, LEANING_ENDS):
        return False
    theta_m = S.xn[P.position + P.rotor]
    if event == GEAR_CLOSES:
        beyond = abs(theta_m - S.gear[0]) - gap
    else:
        beyond = (gap_rate - S.mode[0] * S.xn[P.position + P.n_bodies + P.rotor]) * h
    return beyond <= NEAR_RAD * max(1.0, abs(theta_m))


@compiled
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


@compiled
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


@compiled
def _jerk_base_contacts(P, S, gap_rate):
    """The base has jumped to the motor's speed: friction contacts with an end on it slip from now on."""
    for c in range(P.friction_ends.shape[0]):
        if _on_base(P, c):
            rate = slip_rate(P, S, S.x, c, S.gear[0], gap_rate)
            S.mode[1 + c] = 1 if rate > 0.0 else (-1 if rate < 0.0 else 0)


@compiled
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
        clear(w)
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


@inlined
def _on_base(P, c):
    """Whether friction contact ``c`` has an end on the base."""
    return min(P.friction_ends[c, 0], P.friction_ends[c, 1]) == pl.BASE


@compiled
def _turn_contacts(P, S, h, theta_d, gap_rate):
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


@compiled
def _torn_loose(P, S):
    """Whether the imposed base has torn contacts loose in the step just tried; they slip from its start then."""
    torn = False
    for c in range(P.friction_ends.shape[0]):
        if S.mode[1 + c] == 0 and _on_base(P, c) and abs(S.reaction[c]) > held_level(P, S, c, S.reaction[c]):
            S.mode[1 + c] = -1 if S.reaction[c] > 0.0 else 1
            torn = True
    return torn


@compiled
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


@compiled
def _stop(P, S, c, contact, impulse):
    """Take out the rest of a contact's slip by an impulse (N s) between its ends."""
    first = P.position + P.n_bodies
    a, b = P.friction_ends[c, 0], P.friction_ends[c, 1]
    if b >= 0:
        S.x[first + b] -= impulse * P.G[contact, pl.CH_F + b, first + b]
    if a >= 0:
        S.x[first + a] += impulse * P.G[contact, pl.CH_F + a, first + a]


@inlined
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


@inlined
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


@inlined
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


@inlined
def _next_stop(P, tick, whole):
    """The next tick at which a step has to end: a late command arrives, a late sensor looks, or the sample is over."""
    stop = _stop_of(P.delay_ticks, P.delay_part, tick, whole)
    for s in range(P.sensor_tick.shape[0]):
        if P.sensor_tick[s] > 0:
            stop = min(stop, _stop_of(P.sensor_tick[s], P.sensor_part[s], tick, whole))
    return stop


@inlined
def _stop_of(at, part, tick, whole):
    """The next tick at which something begins, or ends, that lies within a tick: ``part`` of it after ``at``."""
    if at > tick:
        return at
    return at + 1 if part > 0.0 and at == tick else whole


@inlined
def _voltage(P, tick, before, after):
    """The voltage from a stop on; in the tick in which the command arrives its mean, which moves the rig as far."""
    if tick == P.delay_ticks:
        return after + P.delay_part * (before - after)
    return before if tick < P.delay_ticks else after


@inlined
def _level(last, least, left):
    """The level, ``least`` or finer, of the longest step that ends within the ``left`` ticks."""
    level = least
    while (1 << (last - level)) > left:
        level += 1
    return level


@inlined
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
            _turn_contacts(P, S, h, given, gap_rate)
        try_step(P, S, level, h, t + start, voltage, gap, gap_rate, given)
        if P.imposed and _torn_loose(P, S):
            continue
        event = find_event(P, S, gap + gap_rate * h, gap_rate)
        chased = event != NO_EVENT and level < last and events < MOST_EVENTS
        if chased and not _located(P, S, event, gap + gap_rate * h, gap_rate, h):
            least = level + 1
            continue
        copy(S.xn, S.x)
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


@compiled
def _acceleration(P, S, body, gap, gap_rate):
    """Present acceleration of a body, m/s^2 or rad/s^2; 0 where it sticks to the ground."""
    contact, theta_d = (0 if S.mode[0] == pl.FREE else 1), 0.0
    clear(S.w0)
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


@inlined
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


@inlined
def _catch(P, S, s, tick, gap, gap_rate):
    """What a sensor that looks late sees at this tick; between two ticks it sees what lies between."""
    at, part = P.sensor_tick[s], P.sensor_part[s]
    if 0 < at == tick:
        S.caught[s] = (1.0 - part) * read_sensor(P, S, s, gap, gap_rate)
    elif at > 0 and part > 0.0 and at + 1 == tick:
        S.caught[s] += part * read_sensor(P, S, s, gap, gap_rate)


@inlined
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
        place = P.slot[pl.READING] + s
        for e in range(P.first[place], P.first[place + 1]):
            value = dispatch.shown(P.law[e, 0], value, P.law_p, e)
        y[s] = value
