"""A step of an FMU, compiled: its library's functions are called at their addresses.

The Runge-Kutta method of fourth order goes over the continuous states. Dry friction holds what it can by an impulse
after each step: one evaluation a joint says how its force changes the accelerations, and the force that stops all
joints at once is cut to the levels (projected Gauss-Seidel; Moreau's time-stepping: Acary and Brogliato, Numerical
Methods for Nonsmooth Dynamical Systems (2008), chapter 10). The force of a step goes on in the next one, so that
sliding is as accurate as the method. What switches in the FMU ends a part of the step. A step is a function of two
addresses, as MuJoCo's is: of whole numbers and of a block of floats.
"""

import functools
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, types
from numba.extending import intrinsic

from dtbacklash.arrays import Floats
from dtbacklash.compiled import kept
from dtbacklash.physics.fmu_file import DECISIONS

#: places of whole numbers: lengths of both blocks, the address of the second, and of the instance and its functions
(WHOLE, BLOCK, BASE, INSTANCE, SET_TIME, SET_STATES, GET_RATES, SET_INPUTS, GET_OUTPUTS) = range(9)
#: functions of events
(COMPLETED, GET_SIGNS, BEGIN_EVENT, DECIDE, END_EVENT, GET_STATES) = range(9, 15)
#: counts of states, joints, commands, inputs, outputs, event indicators; whether events are followed; addresses of the
#: references of inputs and outputs, and how many these are (fewer where an array has one for all of its numbers)
(STATES, JOINTS, COMMANDS, INPUTS, OUTPUTS, SIGNS, EVENTS, INPUT_NAMES, OUTPUT_NAMES, INPUTS_NAMED,
 OUTPUTS_NAMED) = range(15, 26)  # fmt: skip
#: what follows: the FMU's place of each state, the input of each command, that of each joint's force (-1: none)
TABLES = 26
#: the clock of steps is that of the FMU up to such a part of a step: it is a sum of them
ROUNDING = 1e-6
#: parts of a step that need not be halved to find when something switches
SHORTEST = 1.0 / 64.0
#: an FMI status above a warning
BAD = 1
#: turns in which the forces of several joints find each other
SWEEPS = 20
#: the first floats: time, step, when the FMU's clock strikes next, and room for what its functions say: whole numbers
#: at multiples of 4 bytes (new states needed, end, other nominals, other states, a next time), and the next time
TIME, STEP, NEXT, SAID, FIRST = 0, 1, 2, 3, 8
#: Runge-Kutta: how far into the step, and how much each slope counts
STAGES, WEIGHTS = (0.0, 0.5, 0.5, 1.0), (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


class Block(NamedTuple):
    """Views of the floats: states and derivatives in our order (positions, speeds, others), and what else there is.

    theirs, theirs_rate : (states,) in the FMU's order. begun, total, rest : (states,) of a step. inputs, still :
    (inputs,) as set, and where nothing acts. outputs. ctrl (commands,). push, friction, held, damping, load, mark :
    (joints,) forces, levels, shares of them that hold, coefficients, efforts of the commands, shares before. share :
    (joints * commands,) efforts by commands. pair : (joints * joints,) accelerations by forces. signs, before :
    (indicators,) now, and when events were last looked for.
    """

    x: Floats
    rate: Floats
    theirs: Floats
    theirs_rate: Floats
    begun: Floats
    total: Floats
    rest: Floats
    inputs: Floats
    still: Floats
    outputs: Floats
    ctrl: Floats
    push: Floats
    friction: Floats
    held: Floats
    damping: Floats
    load: Floats
    mark: Floats
    share: Floats
    pair: Floats
    signs: Floats
    before: Floats


@intrinsic
def _call(typingctx, function, a, b, c, d, e, f, g):
    """Call a function of whole numbers and addresses; its status. What it has no use for does no harm."""

    def generate(context, builder, signature, values):
        kind = ir.FunctionType(ir.IntType(32), [ir.IntType(64)] * 7)
        status = builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return builder.sext(status, ir.IntType(64))

    return types.int64(*[types.int64] * 8), generate


@intrinsic
def _call_with_time(typingctx, function, instance, time):
    """Call a function of an instance and a number; its status."""

    def generate(context, builder, signature, values):
        kind = ir.FunctionType(ir.IntType(32), [ir.IntType(64), ir.DoubleType()])
        status = builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return builder.sext(status, ir.IntType(64))

    return types.int64(types.int64, types.int64, types.float64), generate


@kept(nogil=True, forceinline=True)
def block(m, d):
    """The views of a block."""
    n, j, u, i, o, z = m[STATES], m[JOINTS], m[COMMANDS], m[INPUTS], m[OUTPUTS], m[SIGNS]
    x, a = FIRST, FIRST + 7 * n
    b = a + 2 * i + o + u
    c = b + 6 * j + j * u + j * j
    return Block(
        d[x : x + n], d[x + n : x + 2 * n], d[x + 2 * n : x + 3 * n], d[x + 3 * n : x + 4 * n],
        d[x + 4 * n : x + 5 * n], d[x + 5 * n : x + 6 * n], d[x + 6 * n : a],
        d[a : a + i], d[a + i : a + 2 * i], d[a + 2 * i : a + 2 * i + o], d[a + 2 * i + o : b],
        d[b : b + j], d[b + j : b + 2 * j], d[b + 2 * j : b + 3 * j], d[b + 3 * j : b + 4 * j],
        d[b + 4 * j : b + 5 * j], d[b + 5 * j : b + 6 * j], d[b + 6 * j : b + 6 * j + j * u],
        d[b + 6 * j + j * u : c], d[c : c + z], d[c + z : c + 2 * z],
    )  # fmt: skip


def length_of(n: int, j: int, u: int, i: int, o: int, z: int) -> int:
    """Floats of a block."""
    return FIRST + 7 * n + 2 * i + o + u + 6 * j + j * u + j * j + 2 * z


@kept(nogil=True, forceinline=True)
def _address(m, at):
    """Of a float of the block."""
    return m[BASE] + 8 * at


@kept(nogil=True, forceinline=True)
def _tell(m, b, time):
    """Give the FMU states, forces and time; its status."""
    n, j, u, i = m[STATES], m[JOINTS], m[COMMANDS], m[INPUTS]
    status = _call_with_time(m[SET_TIME], m[INSTANCE], time)
    status = max(status, _tell_states(m, b))
    for k in range(i):
        b.inputs[k] = b.still[k]
    for k in range(u):
        b.inputs[m[TABLES + n + k]] = b.ctrl[k]
    for k in range(j):
        place = m[TABLES + n + u + k]
        if place >= 0:
            b.inputs[place] += b.push[k] + b.held[k] * b.friction[k] - b.damping[k] * b.x[j + k]
    at = _address(m, FIRST + 7 * n)
    return max(status, _call(m[SET_INPUTS], m[INSTANCE], m[INPUT_NAMES], m[INPUTS_NAMED], at, i, 0, 0))


@kept(nogil=True, forceinline=True)
def _tell_states(m, b):
    n = m[STATES]
    for k in range(n):
        b.theirs[m[TABLES + k]] = b.x[k]
    return _call(m[SET_STATES], m[INSTANCE], _address(m, FIRST + 2 * n), n, 0, 0, 0, 0)


@kept(nogil=True, forceinline=True)
def _rates(m, b, time, alike=False):
    """Derivatives at the states and forces of the block; whether the FMU gives them. alike : time and inputs stay."""
    n, j = m[STATES], m[JOINTS]
    status = _tell_states(m, b) if alike else _tell(m, b, time)
    status = max(status, _call(m[GET_RATES], m[INSTANCE], _address(m, FIRST + 3 * n), n, 0, 0, 0, 0))
    for k in range(n):
        b.rate[k] = b.theirs_rate[m[TABLES + k]]
    for k in range(j):
        if m[TABLES + n + m[COMMANDS] + k] < 0:  # no force: an acceleration, of the linear part alone
            b.rate[j + k] += b.push[k]
    return status <= BAD


@kept(nogil=True)
def _switch(m, d, b):
    """At the end of a step let the FMU switch, where an indicator changed its sign, its clock struck, or it asks to."""
    n, z, instance, at = m[STATES], m[SIGNS], m[INSTANCE], _address(m, SAID)
    said = d[SAID:FIRST].view(np.int32)
    struck = d[TIME] >= d[NEXT] - ROUNDING * d[STEP]
    if struck:
        d[TIME] = max(d[TIME], d[NEXT])
    _tell(m, b, d[TIME])
    d[SAID:FIRST] = 0.0
    _call(m[COMPLETED], instance, 1, at, at + 4, 0, 0, 0)
    event = said[0] != 0 or struck
    event = _turned(m, d, b, d[TIME]) or event
    b.before[:] = b.signs
    if not event:
        return
    _call(m[BEGIN_EVENT], instance, 0, 0, 0, 0, 0, 0)
    moved = False
    for _ in range(DECISIONS):
        d[SAID:FIRST] = 0.0
        _call(m[DECIDE], instance, at, at + 4, at + 8, at + 12, at + 16, at + 24)
        moved = moved or said[3] != 0
        if said[0] == 0:
            break
    d[NEXT] = d[SAID + 3] if said[4] != 0 else np.inf
    _call(m[END_EVENT], instance, 0, 0, 0, 0, 0, 0)
    if moved:
        _call(m[GET_STATES], instance, _address(m, FIRST + 2 * n), n, 0, 0, 0, 0)
        for k in range(n):
            b.x[k] = b.theirs[m[TABLES + k]]
    _call(m[GET_SIGNS], instance, _address(m, len(d) - 2 * z), z, 0, 0, 0, 0)
    b.before[:] = b.signs


@kept(nogil=True, forceinline=True)
def _more(b, k, j):
    """What the shares that hold have added to a joint's speed since they were marked."""
    more = 0.0
    for i in range(j):
        more += b.pair[k * j + i] * (b.held[i] - b.mark[i])
    return more


@kept(nogil=True, forceinline=True)
def _hold(m, b, time, h):
    """Let dry friction stop, after a step, what it can; a joint without any has no column in ``pair``."""
    j = m[JOINTS]
    slides = True  # all on, as they did
    for k in range(j):
        slides = slides and (b.friction[k] == 0.0 or (abs(b.held[k]) == 1.0 and b.held[k] * b.x[j + k] < 0.0))
    if slides or not _rates(m, b, time):
        return
    b.rest[:] = b.rate
    b.mark[:] = b.held
    b.pair[:] = 0.0
    for k in range(j):
        if b.friction[k] > 0.0:
            b.held[k] += 1.0
            _rates(m, b, time)
            b.held[k] = b.mark[k]
            for i in range(j):
                b.pair[i * j + k] = (b.rate[j + i] - b.rest[j + i]) * h
    for _ in range(SWEEPS):
        for k in range(j):
            if b.pair[k * j + k] > 0.0:
                left = b.x[j + k] + _more(b, k, j)
                b.held[k] = min(max(b.held[k] - left / b.pair[k * j + k], -1.0), 1.0)
    for k in range(j):
        more = _more(b, k, j)
        b.x[j + k] += more
        b.x[k] += 0.5 * h * more


@kept(nogil=True, forceinline=True)
def _loads(m, b):
    j, u = m[JOINTS], m[COMMANDS]
    for k in range(j):
        b.load[k] = 0.0
        for i in range(u):
            b.load[k] += b.share[k * u + i] * b.ctrl[i]


@kept(nogil=True)
def _turned(m, d, b, time):
    """Whether an indicator has changed its sign, at a time."""
    z = m[SIGNS]
    _tell(m, b, time)
    _call(m[GET_SIGNS], m[INSTANCE], _address(m, len(d) - 2 * z), z, 0, 0, 0, 0)
    turned = False
    for k in range(z):
        turned = turned or (b.signs[k] > 0.0) != (b.before[k] > 0.0)
    return turned


@kept(nogil=True, forceinline=True)
def _runge(m, b, time, h):
    """Over a time, without what holds or switches; whether the FMU gave its derivatives."""
    n, good, damped = m[STATES], True, False
    for k in range(m[JOINTS]):
        damped = damped or b.damping[k] != 0.0
    for k in range(n):
        b.begun[k], b.total[k] = b.x[k], 0.0
    for s in range(4):
        for k in range(n if s else 0):
            b.x[k] = b.begun[k] + STAGES[s] * h * b.rate[k]
        good = _rates(m, b, time + STAGES[s] * h, s == 2 and not damped) and good
        for k in range(n):
            b.total[k] += WEIGHTS[s] * b.rate[k]
    for k in range(n):
        b.x[k] = b.begun[k] + h * b.total[k]
    return good


@kept(nogil=True)
def advance(m, d):
    """One step, in parts where something switches in it, of which halves are taken; NaN where the FMU refuses."""
    b = block(m, d)
    begun, h, good, rubbed = d[TIME], d[STEP], True, False
    _loads(m, b)
    for k in range(m[JOINTS]):
        rubbed = rubbed or b.friction[k] != 0.0
    part = h
    while part > ROUNDING * h:
        time = d[TIME]
        if m[EVENTS] and d[NEXT] > time + ROUNDING * h:
            part = min(part, d[NEXT] - time)
        good = _runge(m, b, time, part) and good
        if m[EVENTS] and part > SHORTEST * h and _turned(m, d, b, time + part):
            for k in range(m[STATES]):
                b.x[k] = b.begun[k]
            part *= 0.5
            continue
        if rubbed:
            _hold(m, b, time + part, part)
        d[TIME] = time + part
        if m[EVENTS]:
            _switch(m, d, b)
        part = begun + h - d[TIME]
    if not good:
        b.x[:] = np.nan


@kept(nogil=True)
def follow(m, d):
    """Accelerations and outputs of the state."""
    b = block(m, d)
    _loads(m, b)
    _rates(m, b, d[TIME])
    n, i, o = m[STATES], m[INPUTS], m[OUTPUTS]
    if o:
        at = _address(m, FIRST + 7 * n + 2 * i)
        _call(m[GET_OUTPUTS], m[INSTANCE], m[OUTPUT_NAMES], m[OUTPUTS_NAMED], at, o, 0, 0)


@functools.cache
def functions() -> tuple[Any, Any, Any]:
    """A step, what follows from a state, and back to the first time, as functions with addresses."""
    kind = types.void(types.CPointer(types.int64), types.CPointer(types.float64))

    @cfunc(kind)
    def step(m, d):
        advance(carray(m, carray(m, 1)[WHOLE]), carray(d, carray(m, 2)[BLOCK]))

    @cfunc(kind)
    def forward(m, d):
        follow(carray(m, carray(m, 1)[WHOLE]), carray(d, carray(m, 2)[BLOCK]))

    @cfunc(kind)
    def back(m, d):
        """Its states are put after that; its clock strikes nowhere in the linear part, which follows no events."""
        carray(d, carray(m, 2)[BLOCK])[TIME] = 0.0

    return step, forward, back
