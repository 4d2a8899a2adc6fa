"""Compiled loops over a MuJoCo model: its own step, called at its address, with laws and corrections between."""

import ctypes
import functools
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import cfunc, types
from numba.extending import intrinsic

from dtbacklash.arrays import Floats
from dtbacklash.compiled import kept
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.effects.slots import ROW_PARAMETERS
from dtbacklash.physics.kernel import dispatch

#: a state that large is lost
LOST = 1e8
#: columns of what a sensor shows: its quantity, its joint, and how late it is, s
POSITION, VELOCITY, ACCELERATION, EFFORT = range(4)
QUANTITIES = {
    "position": POSITION,
    "velocity": VELOCITY,
    "acceleration": ACCELERATION,
    "torque": EFFORT,
    "force": EFFORT,
}


@intrinsic
def _call(typingctx, function, model, data):
    """Call MuJoCo's function at an address with the addresses of a model and its data."""

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

    step, forward : addresses of MuJoCo's functions; 0 where nothing shown needs the second. m, d : of model and data.
    q, v, acceleration, push, load, ctrl, friction : (joints,) views of them. still : (joints,) the model's friction.
    U : (fine steps, commands). first, whole : the fine step of the first reading, and fine steps of a reading.
    h : fine step, s. efforts, levels, reads : laws of position, speed and time; of slip speed, direction and load; of
    readings. sensors (m, 3).
    """

    step: int
    forward: int
    m: int
    d: int
    q: Floats
    v: Floats
    acceleration: Floats
    push: Floats
    load: Floats
    ctrl: Floats
    friction: Floats
    still: Floats
    U: Floats
    first: int
    whole: int
    h: float
    efforts: Laws
    levels: Laws
    reads: Laws
    sensors: Floats


@kept(nogil=True)
def advance(c, k):
    """From a reading of this number to the next one."""
    begin = c.first + k * c.whole
    for s in range(begin, begin + c.whole):
        c.ctrl[:] = c.U[min(s, len(c.U) - 1)]
        if len(c.efforts.at):
            c.push[:] = 0.0
        for e in range(len(c.efforts.at)):
            j = c.efforts.at[e]
            at = c.q[j] + 0.5 * c.h * c.v[j]
            c.push[j] += dispatch.body_effort(c.efforts.codes[e], at, c.v[j], (s + 0.5) * c.h, c.efforts.numbers, e)
        if len(c.levels.at):
            c.friction[:] = c.still
        for e in range(len(c.levels.at)):
            j = c.levels.at[e]
            side = 1.0 if c.v[j] >= 0.0 else -1.0
            level = dispatch.friction_level(c.levels.codes[e], abs(c.v[j]), side, c.load[j], c.levels.numbers, e)
            c.friction[j] += max(level, 0.0)
        _call(c.step, c.m, c.d)


@kept(nogil=True)
def show(c, y):
    """What the sensors show of the state."""
    if c.forward:
        _call(c.forward, c.m, c.d)
    for i in range(len(y)):
        what, j, late = c.sensors[i, 0], int(c.sensors[i, 1]), c.sensors[i, 2]
        if what == POSITION:
            y[i] = c.q[j] - late * c.v[j]
        elif what == VELOCITY:
            y[i] = c.v[j] - late * c.acceleration[j]
        elif what == ACCELERATION:
            y[i] = c.acceleration[j]
        else:
            y[i] = c.load[j]
    for e in range(len(c.reads.at)):
        i = c.reads.at[e]
        y[i] = dispatch.shown(c.reads.codes[e], y[i], c.reads.numbers, e)


@kept(nogil=True)
def observe(c, Y, K, which, D, X):
    """Predict and correct, sample by sample; NaN from where it is lost."""
    n, y = len(c.q), np.zeros(Y.shape[1])
    for k in range(len(Y)):
        show(c, y)
        X[k, :n] = c.q
        X[k, n:] = c.v
        for i in range(len(y)):
            D[k, i] = Y[k, i] - y[i] if np.isfinite(Y[k, i]) else 0.0
        g = K[which[k]]
        size = 0.0
        for j in range(n):
            for i in range(len(y)):
                c.q[j] += g[j, i] * D[k, i]
                c.v[j] += g[n + j, i] * D[k, i]
            size += c.v[j] ** 2
        if not size < LOST:
            D[k:] = np.nan
            return
        if k + 1 < len(Y):
            advance(c, k)


@kept(nogil=True)
def onwards(c, Z, X):
    n = len(c.q)
    for k in range(len(Z) - 1):
        c.q[:] = Z[k, :n]
        c.v[:] = Z[k, n : 2 * n]
        advance(c, k)
        X[k, :n] = c.q
        X[k, n : 2 * n] = c.v


@cfunc(types.void(types.voidptr))
def _quiet(text):
    pass


@functools.cache
def functions() -> tuple[int, int]:
    """Addresses of MuJoCo's step and forward; its warnings are not printed, as what is not finite is seen here."""
    import mujoco

    folder = Path(mujoco.__file__).parent
    file = next(f for f in folder.iterdir() if re.fullmatch(r"(lib)?mujoco\.(so|dll|[\d.]*dylib).*", f.name))
    library = ctypes.CDLL(str(file))
    ctypes.c_void_p.in_dll(library, "mju_user_warning").value = _quiet.address
    step, forward = (ctypes.cast(f, ctypes.c_void_p).value for f in (library.mj_step, library.mj_forward))
    return int(step or 0), int(forward or 0)


def laws(found: list[tuple[int, Effect, Values]]) -> Laws:
    """Effects with what each is of."""
    numbers = np.zeros((len(found), ROW_PARAMETERS))
    for row, (_, _, values) in zip(numbers, found, strict=True):
        row[: len(values)] = list(values.values())
    at, codes = ([one[0] for one in found], [dispatch.code_of(one[1]) for one in found])
    return Laws(np.array(at, dtype=np.int64), np.array(codes, dtype=np.int64), numbers)


@kept(nogil=True)
def told_by(law, u, out):
    for k in range(len(u)):
        out[k] = dispatch.amplified(law.codes[0], u[k], law.numbers, 0)
