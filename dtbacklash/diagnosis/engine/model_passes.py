"""Compiled loops over a simulator's model: its own step, called at its address, with laws and corrections between."""

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from dtbacklash.arrays import Floats
from dtbacklash.compiled import kept
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.effects.slots import ROW_PARAMETERS
from dtbacklash.physics.kernel import dispatch, numba_laws

#: a state that large is lost
LOST = 1e8
#: a joint may turn within a step in which its speed could change by a part of it (ratio)
TURNS = 2.0
#: columns of what a sensor shows: its quantity, its joint or output, and how late it is, s
POSITION, VELOCITY, ACCELERATION, EFFORT, OUTPUT = range(5)
QUANTITIES = {
    "position": POSITION,
    "velocity": VELOCITY,
    "acceleration": ACCELERATION,
    "torque": EFFORT,
    "force": EFFORT,
    "value": OUTPUT,
}


@intrinsic
def _call(typingctx, function, model, data):
    """Call a simulator's function at an address with the addresses of a model and its data."""

    def generate(context, builder, signature, values):
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(64)] * 2)
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


class Laws(NamedTuple):
    """Laws as the compiled loops take them: at (L,) of which joint or channel, codes (L,), numbers (L, parameters)."""

    at: np.ndarray
    codes: np.ndarray
    numbers: Floats


class Compiled(NamedTuple):
    """A model with the parameters of a rig, what acts at each step, and what its sensors show.

    step, forward, back : addresses of the simulator's functions: a step, what follows from a state (0 where nothing
    shown needs it), and to its first state and time. m, d : of model and data. far : of the model whose step is
    ``ratio`` of those of m, and whose friction is without that of laws.
    q, v, acceleration, push, load, friction : (degrees of freedom,) views of them, and more : of other states, ctrl :
    of commands, shown : of outputs, clock : (1,) of its time, s. still : the model's friction. at, behind : (joints,)
    which degree of freedom each is, and which is the gap behind it, or -1. A state is positions and speeds of joints,
    other states, positions and speeds in gaps.
    U : (fine steps, commands) from the first reading on, which is at ``begin``, s. whole : fine steps of a reading.
    h : fine step, s. efforts, levels, reads : laws of position, speed and time; of slip speed, direction and load; of
    readings. sensors (m, 3).
    """

    step: int
    forward: int
    back: int
    m: int
    far: int
    d: int
    q: Floats
    v: Floats
    more: Floats
    acceleration: Floats
    push: Floats
    load: Floats
    ctrl: Floats
    friction: Floats
    shown: Floats
    clock: Floats
    at: np.ndarray
    behind: np.ndarray
    still: Floats
    U: Floats
    begin: float
    whole: int
    ratio: int
    h: float
    efforts: Laws
    levels: Laws
    reads: Laws
    sensors: Floats


@kept(nogil=True, forceinline=True)
def advance(c, k):
    """From a reading of this number to the next one: in far steps, and in small ones where a dry friction may turn."""
    for s in range(k * c.whole, (k + 1) * c.whole, c.ratio):
        if c.ratio > 1 and slides(c):
            stride(c, s, c.ratio)
        else:
            for i in range(s, s + c.ratio):
                stride(c, i, 1)


@kept(nogil=True)
def slides(c):
    """Whether no joint with a friction of a law comes near to rest within a far step."""
    for joint in c.levels.at:
        j = c.at[joint]
        if not abs(c.v[j]) > TURNS * abs(c.acceleration[j]) * c.ratio * c.h:
            return False
    return True


@kept(nogil=True)
def stride(c, s, many):
    """One step of the simulator over so many small ones; a friction that slides in a far one is a force."""
    h = many * c.h
    for a in range(len(c.ctrl)):
        told = 0.0
        for i in range(s, s + many):
            told += c.U[min(i, len(c.U) - 1), a]
        c.ctrl[a] = told / many
    if len(c.efforts.at) or len(c.levels.at):
        c.push[:] = 0.0
    for e in range(len(c.efforts.at)):
        j, time = c.at[c.efforts.at[e]], c.begin + (s + 0.5 * many) * c.h
        at = c.q[j] + 0.5 * h * c.v[j]
        c.push[j] += numba_laws.body_effort(c.efforts.codes[e], at, c.v[j], time, c.efforts.numbers, e)
    c.friction[:] = c.still
    for e in range(len(c.levels.at)):
        j = c.at[c.levels.at[e]]
        side = 1.0 if c.v[j] >= 0.0 else -1.0
        level = numba_laws.friction_level(c.levels.codes[e], abs(c.v[j]), side, c.load[j], c.levels.numbers, e)
        if many > 1:
            c.push[j] -= side * max(level, 0.0)
        else:
            c.friction[j] += max(level, 0.0)
    _call(c.step, c.far if many > 1 else c.m, c.d)


@kept(nogil=True, forceinline=True)
def whole(c, joint, moves):
    """Of a joint, with what the gap behind it adds: its position, speed or acceleration."""
    k = c.behind[joint]
    return moves[c.at[joint]] + (moves[k] if k >= 0 else 0.0)


@kept(nogil=True, forceinline=True)
def show(c, y):
    """What the sensors show of the state."""
    if c.forward:
        _call(c.forward, c.m, c.d)
    for i in range(len(y)):
        what, joint, late = c.sensors[i, 0], int(c.sensors[i, 1]), c.sensors[i, 2]
        if what == POSITION:
            y[i] = whole(c, joint, c.q) - late * whole(c, joint, c.v)
        elif what == VELOCITY:
            y[i] = whole(c, joint, c.v) - late * whole(c, joint, c.acceleration)
        elif what == ACCELERATION:
            y[i] = whole(c, joint, c.acceleration)
        elif what == OUTPUT:
            y[i] = c.shown[joint]
        else:
            y[i] = c.load[c.at[joint]]
    for e in range(len(c.reads.at)):
        i = c.reads.at[e]
        y[i] = numba_laws.shown(c.reads.codes[e], y[i], c.reads.numbers, e)


@kept(nogil=True, forceinline=True)
def put(c, z):
    """Set the state."""
    n, first = len(c.at), 2 * len(c.at) + len(c.more)
    c.more[:] = z[2 * n : first]
    for j in range(n):
        c.q[c.at[j]], c.v[c.at[j]] = z[j], z[n + j]
        if c.behind[j] >= 0:
            c.q[c.behind[j]], c.v[c.behind[j]] = z[first], z[first + 1]
            first += 2


@kept(nogil=True, forceinline=True)
def take(c, z):
    """What the state is."""
    n, first = len(c.at), 2 * len(c.at) + len(c.more)
    z[2 * n : first] = c.more
    for j in range(n):
        z[j], z[n + j] = c.q[c.at[j]], c.v[c.at[j]]
        if c.behind[j] >= 0:
            z[first], z[first + 1] = c.q[c.behind[j]], c.v[c.behind[j]]
            first += 2


@kept(nogil=True)
def led(c, z, force, u, far, out):
    """Where a sample leads from a state under forces and commands that stay, or what the sensors show of it at once."""
    _call(c.back, c.m, c.d)
    put(c, z)
    c.push[:] = force
    c.ctrl[:] = u
    if far:
        for _ in range(c.whole):
            _call(c.step, c.m, c.d)
        take(c, out)
    else:
        show(c, out)


@kept(nogil=True)
def observe(c, Y, K, which, D, X):
    """Predict and correct, sample by sample; NaN from where it is lost."""
    n, y = len(c.at), np.zeros(Y.shape[1])
    for k in range(len(Y)):
        show(c, y)
        take(c, X[k])
        for i in range(len(y)):
            D[k, i] = Y[k, i] - y[i] if np.isfinite(Y[k, i]) else 0.0
        g = K[which[k]]
        size = 0.0
        for joint in range(n):
            j = c.at[joint]
            for i in range(len(y)):
                c.q[j] += g[joint, i] * D[k, i]
                c.v[j] += g[n + joint, i] * D[k, i]
            size += c.v[j] ** 2
        for j in range(len(c.more)):
            for i in range(len(y)):
                c.more[j] += g[2 * n + j, i] * D[k, i]
        if not size < LOST:
            D[k:] = np.nan
            return
        if k + 1 < len(Y):
            advance(c, k)


@kept(nogil=True)
def onwards(c, Z, X):
    for k in range(len(Z) - 1):
        put(c, Z[k])
        advance(c, k)
        take(c, X[k])


@kept(nogil=True)
def shown(c, Z, Y):
    for k in range(len(Z)):
        put(c, Z[k])
        c.clock[0] = k * c.whole * c.h
        if k:
            c.ctrl[:] = c.U[min(k * c.whole, len(c.U)) - 1]
        show(c, Y[k])


def laws(found: list[tuple[int, Effect, Values]]) -> Laws:
    """Effects with what each is of."""
    numbers = np.zeros((len(found), ROW_PARAMETERS))
    for row, (_, _, values) in zip(numbers, found, strict=True):
        row[: len(values)] = list(values.values())
    at, codes = ([one[0] for one in found], [dispatch.code_of(one[1]) for one in found])
    return Laws(np.array(at, dtype=np.int64), numba_laws.addressed(codes), numbers)


@kept(nogil=True)
def told_by(law, u, out):
    for k in range(len(u)):
        out[k] = numba_laws.amplified(law.codes[0], u[k], law.numbers, 0)
