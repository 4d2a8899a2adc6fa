"""The closed loop between two events, written out: every size is known when it is compiled, every number a scalar.

The general loop (:mod:`.loop`) serves every rig, with loops over arrays whose sizes it learns when it runs. A sample of
a linear rig without delays is a product of a matrix and a vector. Here such products are written out for the sizes at
hand, term by term in the order of the general loop, so that the results are the same to the last bit. A sample in which
the gear closes or opens leaves the written code.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.extending import NativeValue, models, overload, register_model, unbox

from dtbacklash.arrays import Floats
from dtbacklash.compiled import compiled, copy
from dtbacklash.control.laws import BARE, IMC, NIMC, Controller
from dtbacklash.experiment.loop import DIVERGED, NOVELTY, RAN
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant
from dtbacklash.physics.kernel.sample import NEAR_RAD, settle_gear
from dtbacklash.physics.kernel.step import MOST_EVENTS, drive_channels, linear_step

#: longer products are left to the general loop: what is written out takes the longer to compile
MOST_STATES = 16


@dataclass(frozen=True)
class Form:
    """For what the loop is written out; numba takes it for a type, so that it compiles anew for each form.

    n, w, s : states of the plant, of the prefilter and of the structure's model. sections : of the lock-in filter.
    nonlinear : NIMC, not IMC. angle, speed : the motor's, among the states. shows : the state that each sensor shows.
    theta_m, q3 : their sensors. zeros, ones : names of elements of matrices that are, by which none is multiplied.
    """

    n: int
    w: int
    s: int
    sections: int
    nonlinear: bool
    angle: int
    speed: int
    shows: tuple[int, ...]
    theta_m: int
    q3: int
    zeros: frozenset[str]
    ones: frozenset[str]

    @property
    def _numba_type_(self) -> FormType:
        return _type_of(self)

    def term(self, factor: str, x: str) -> str:
        """``factor * x``, as short as it can be; empty for nothing."""
        return "" if factor in self.zeros else (x if factor in self.ones else f"{factor} * {x}")

    def dot(self, factors: list[str], x: list[str]) -> str:
        """A sum of products, in this order."""
        terms = [self.term(factor, value) for factor, value in zip(factors, x, strict=True)]
        return " + ".join(term for term in terms if term) or "0.0"


class FormType(types.Type):
    """A form as numba's type; at run time it is nothing."""

    def __init__(self, form: Form) -> None:
        self.form = form
        words = [*astuple(form)[:-2], sorted(form.zeros), sorted(form.ones)]
        super().__init__(name=f"Form_{hashlib.sha256(repr(words).encode()).hexdigest()[:16]}")


@cache
def _type_of(form: Form) -> FormType:
    return FormType(form)


register_model(FormType)(models.OpaqueModel)


@unbox(FormType)
def _unbox_form(kind: FormType, value: Any, context: Any) -> NativeValue:
    return NativeValue(context.context.get_dummy_value())


def form_of(plant: Plant, controller: Controller, sos: Floats, roles: tuple[int, int]) -> Form | None:
    """The form of a loop, or None where only the general loop will do.

    What is written out: a linear rig with a motor, a screw and sensors of bodies, no delays, the gear the only thing
    that switches, and the paper's internal model. sos : (sections, 6) of the lock-in filter. roles : as of
    :func:`.loop.run_segment`.
    """
    linear = (
        plant.law.shape[0] == 0 and plant.friction_ends.shape[0] == 0 and not plant.forced and not plant.imposed
        and plant.has_base and plant.rotor >= 0 and plant.screw[pl.S_SHARE] == 0.0 and plant.substeps == 1
    )  # fmt: skip
    prompt = (
        plant.delay_whole == plant.delay_ticks == 0 and min(roles) >= 0
        and not plant.sensor_whole.any() and not plant.sensor_tick.any()
        and bool(np.all(plant.sensor[:, pl.Y_INDEX] >= 0))
    )  # fmt: skip
    known = controller.structure in (IMC, NIMC) and controller.model == BARE and not controller.forwards
    sizes = plant.A.shape[1], len(controller.wb), len(controller.sb), len(sos)
    if not (linear and prompt and known and min(sizes) > 0 and max(sizes) <= MOST_STATES):
        return None
    zeros, ones = _plain_elements(plant, controller, sos)
    angle = plant.position + plant.rotor
    shows = tuple(int(state) for state in plant.sensor[:, pl.Y_INDEX])
    nonlinear = controller.structure == NIMC
    return Form(*sizes, nonlinear, angle, angle + plant.n_bodies, shows, *roles, zeros, ones)


def _plain_elements(plant: Plant, controller: Controller, sos: Floats) -> tuple[frozenset[str], frozenset[str]]:
    """Names of the elements that are zero, and that are one; of the plant, in both states of the gear."""
    C = controller
    both = [(plant.E[:, 0], "e"), (plant.P1[:, 0, : pl.CH_F], "p"), (plant.P2[:, 0, pl.CH_D], "ramp")]
    single = [(C.wa, "wa"), (C.wb, "wb"), (C.wc, "wc"), (np.array([C.wd]), "wd"), (C.ma, "ma"), (C.mb, "mb"),
              (C.sa, "sa"), (C.sb, "sb"), (C.sc, "sc"), (sos, "f")]  # fmt: skip
    found: tuple[set[str], set[str]] = (set(), set())
    for array, letter in [*both, *((array[None], letter) for array, letter in single)]:
        for value, names in enumerate(found):
            places = np.argwhere(np.all(array == value, axis=0))
            names.update(letter + "_".join(map(str, place)) for place in places.tolist())
    return frozenset(found[0]), frozenset(found[1])


@compiled
def eventful(P, S, gap0, gap1, u):
    """One sample of a linear rig whose gear closes or opens in it: :func:`.sample.advance` for these rigs alone."""
    gap_rate = (gap1 - gap0) / P.sample_time
    settle_gear(P, S, gap0, gap1, gap_rate)
    last = P.levels - 1
    whole = 1 << last
    tick_s = P.sample_time / whole
    at, speed = P.position + P.rotor, P.position + P.n_bodies + P.rotor
    tick, least, events = 0, 0, 0
    while tick < whole:
        level = least
        while (1 << (last - level)) > whole - tick:
            level += 1
        ticks = 1 << (last - level)
        h = ticks * tick_s
        gap = gap0 + gap_rate * (tick * tick_s)
        mode = S.mode[0]
        S.w0[pl.CH_V] = u
        S.w1[pl.CH_V] = u
        drive_channels(P, S, h, gap, gap_rate, S.gear[0])
        linear_step(P, S, level, 0 if mode == pl.FREE else 1)
        gap += gap_rate * h
        theta_m, beyond = S.xn[at], 0.0
        if mode == pl.FREE:
            passed = abs(theta_m - S.gear[0]) > gap
            beyond = abs(theta_m - S.gear[0]) - gap
        else:
            passed = mode != pl.RIGID and mode * S.xn[speed] < gap_rate
            beyond = (gap_rate - mode * S.xn[speed]) * h
        near = beyond <= NEAR_RAD * max(1.0, abs(theta_m))
        if passed and level < last and events < MOST_EVENTS and not near:
            least = level + 1
            continue
        copy(S.xn, S.x)
        tick += ticks
        if passed:
            if mode == pl.FREE:
                S.mode[0] = pl.PLUS if theta_m - S.gear[0] > 0.0 else pl.MINUS
            else:
                S.gear[0] = theta_m - mode * gap
                S.mode[0] = pl.FREE
            events += 1
            least = 0
        elif least == last:
            least = 0
            events += 1
        elif least > 0:
            least += 1


def _names(letter: str, *sizes: int) -> list[str]:
    """a0, a1 ... or, of a matrix, a0_0, a0_1 ..."""
    if len(sizes) == 1:
        return [f"{letter}{i}" for i in range(sizes[0])]
    return [f"{letter}{i}_{j}" for i in range(sizes[0]) for j in range(sizes[1])]


def _loads(form: Form, letter: str, array: str, *sizes: int) -> Iterator[str]:
    """Every element of an array into a scalar of its own."""
    for name in _names(letter, *sizes):
        if name not in form.zeros | form.ones:
            yield f"{name} = {array}[{name[len(letter) :].replace('_', ', ')}]"


def _stores(letter: str, array: str, n: int) -> Iterator[str]:
    return (f"{array}[{i}] = {letter}{i}" for i in range(n))


def _advance(form: Form, A: str, B: str, x: str, u: str, n: int) -> Iterator[str]:
    """x = A x + B u, in the order of the general loop: the input first."""
    for i in range(n):
        yield f"new_{x}{i} = {form.dot([f'{B}{i}', *(f'{A}{i}_{j}' for j in range(n))], [u, *_names(x, n)])}"
    yield f"{', '.join(_names(x, n))}, = {', '.join(_names(f'new_{x}', n))},"


def _plant(form: Form) -> Iterator[str]:
    """The end of the step, row by row: states, voltage, screw, its speed, its ramp."""
    for i in range(form.n):
        row = [*(f"e{j}_{i}" for j in range(form.n)), *(f"p{c}_{i}" for c in range(pl.CH_F)), f"ramp{i}"]
        yield f"y{i} = {form.dot(row, [*_names('x', form.n), 'u', 'd0', 'dd', 'rise'])}"


def _novelty(form: Form) -> Iterator[str]:
    """:func:`.novelty.novelty_step`, written out."""
    shown = [f"z{2 + 4 * form.sections + channel}" for channel in range(2)]
    for channel in range(2):
        yield f"value = 2.0 * eps * z{channel}"
        for section in range(form.sections):
            a, b = (f"z{2 + 4 * section + 2 * channel + i}" for i in range(2))
            f = [form.term(f"f{section}_{i}", "out" if i > 3 else "value") or "0.0" for i in range(6)]
            yield f"out = {f[0]} + {a}"
            yield f"{a} = {f[1]} - {f[4]} + {b}"
            yield f"{b} = {f[2]} - {f[5]}"
            yield "value = out"
        yield f"{shown[channel]} = value"
    yield "real = z0 * cos_step - z1 * sin_step"
    yield "imag = z0 * sin_step + z1 * cos_step"
    yield "pull = 1.5 - 0.5 * (real * real + imag * imag)"
    yield "z0, z1 = real * pull, imag * pull"
    yield f"level = np.sqrt({shown[0]} * {shown[0]} + {shown[1]} * {shown[1]})"


def _measure(form: Form) -> Iterator[str]:
    """:func:`.loop._measure`, written out."""
    sensors = range(len(form.shows))
    for s in sensors:
        yield f"reading{s} = x{form.shows[s]}"
        yield f"traces.truth[i, {s}] = reading{s}"
    yield "if not clean:"
    for s in sensors:
        yield "    if noisy:"
        yield f"        reading{s} += signals.noise[i, {s}]"
        yield f"    count = signals.resolution[{s}]"
        yield "    if count > 0.0:"
        yield f"        reading{s} = count * math.floor(reading{s} / count + 0.5)"
    for s in sensors:
        yield f"traces.seen[i, {s}] = reading{s}"
    yield f"theta, theta_m, q3 = x{form.angle}, reading{form.theta_m}, reading{form.q3}"


def _control(form: Form) -> Iterator[str]:
    """:func:`.laws.control_step` for the internal model `bare`, written out."""
    yield f"eps = q3 - ({form.dot(_names('sc', form.s), _names('s', form.s))})"
    yield "error = signals.reference[i] - eps"
    through = form.term("wd0", "error")
    yield f"theta_ref = {form.dot(_names('wc', form.w), _names('w', form.w))}{' + ' if through else ''}{through}"
    yield from _advance(form, "wa", "wb", "w", "error", form.w)
    if form.nonlinear:
        yield "u = C.gain * (theta_ref - screw)"
        yield from _advance(form, "sa", "sb", "s", "screw", form.s)
        yield "apart = theta_m - screw"
        yield "if (m1 > 0.0 and apart >= gap_hat) or (m1 < 0.0 and apart <= -gap_hat):"
        yield "    screw += m1 * C.sample_time"
    else:
        yield "u = C.gain * (theta_ref - theta_m)"
        yield from _advance(form, "sa", "sb", "s", "m2", form.s)
    yield from _advance(form, "ma", "mb", "m", "u", 3)


def _written(form: Form) -> str:
    """The source of the loop for a form."""
    n, w, s = form.n, form.w, form.s
    memory = 4 + 4 * form.sections
    parts: dict[str, list[str]] = {
        "HEAD": [
            *_loads(form, "wa", "C.wa", w, w), *_loads(form, "wb", "C.wb", w), *_loads(form, "wc", "C.wc", w),
            *_loads(form, "ma", "C.ma", 3, 3), *_loads(form, "mb", "C.mb", 3), *_loads(form, "sa", "C.sa", s, s),
            *_loads(form, "sb", "C.sb", s), *_loads(form, "sc", "C.sc", s),
            *_loads(form, "f", "oscillator[0]", form.sections, 6), *_loads(form, "w", "X.w", w),
            *_loads(form, "m", "X.m", 3), *_loads(form, "s", "X.s", s), *_loads(form, "z", "detector", memory),
        ],
        "MATRICES": [
            *_loads(form, "e", "E", n, n), *_loads(form, "p", "P1", pl.CH_F, n), *_loads(form, "ramp", "P2", n),
            *_loads(form, "x", "S.x", n),
        ],
        "MEASURE": [*_measure(form)], "CONTROL": [*_control(form)], "NOVELTY": [*_novelty(form)],
        "STEP": [*_plant(form), f"omega, theta, next_omega = x{form.speed}, y{form.angle}, y{form.speed}"],
        "MOVE": [f"x{i} = y{i}" for i in range(n)], "STORE": [*_stores("x", "S.x", n)],
        "TAIL": [*_stores("w", "X.w", w), *_stores("m", "X.m", 3), *_stores("s", "X.s", s),
                 *_stores("z", "detector", memory)],
    }  # fmt: skip
    lines: list[str] = []
    for line in LOOP.splitlines():
        indent = line[: len(line) - len(line.lstrip())]
        lines += [indent + text for text in parts.get(line.strip(), [line.strip()])]
    return "\n".join(lines)


#: one pass of the outer loop for each state of the gear; what stands in capitals is written for the form
LOOP = f"""
def loop(form, P, S, C, X, detector, oscillator, signals, traces, roles, first, stop, gap_hat, limits, before):
    HEAD
    cos_step, sin_step = oscillator[1], oscillator[2]
    screw, wd0 = X.theta_d[0], C.wd
    noisy = signals.noise.shape[0] > 0
    clean = not noisy
    for sensor in range(signals.resolution.shape[0]):
        clean = clean and not signals.resolution[sensor] > 0.0
    lead, step_s = P.screw[{pl.S_LEAD}], P.sample_time
    last = signals.gap.shape[0] - 1
    one = np.uint64(1)
    k, why, u, level = first, {RAN}, S.commands[0], 0.0
    while k < stop and why == {RAN}:
        mode, held, switches = S.mode[0], S.gear[0], False
        free, rigid = mode == {pl.FREE}, mode == {pl.RIGID}
        side = 0 if free or rigid else mode
        contact = 0 if free else 1
        E, P1, P2 = P.E[contact, 0], P.P1[contact, 0], P.P2[contact, 0, {pl.CH_D}]
        MATRICES
        while k < stop:
            i = np.uint64(k)  # an index without a sign needs no look at it
            gap0 = signals.gap[i]
            MEASURE
            CONTROL
            NOVELTY
            traces.u[i], traces.eps[i], traces.gap_hat[i], traces.novelty[i] = u, eps, gap_hat, level
            traces.theta_d[i] = held if free else (theta if rigid else theta - side * gap0)
            if not abs(q3) <= limits[0] or not math.isfinite(u):
                why = {DIVERGED}
                break
            if k < last:
                gap1 = signals.gap[i + one]
                gap_rate = (gap1 - gap0) / step_s
                end = gap0 + gap_rate * step_s
                d0 = lead * held if free else -lead * side * gap0
                rise = 0.0 if free else -lead * side * end - d0
                dd = -lead * side * gap_rate
                STEP
                if free:
                    switches = abs(theta - held) > end
                elif side != 0:
                    switches = side * next_omega < gap_rate or side * omega < gap_rate
                if switches or rigid != (gap0 == 0.0 and gap1 == 0.0):
                    switches = True
                    break
                MOVE
            k += 1
            if level > limits[1] and not before > limits[1]:
                why = {NOVELTY}
                break
            before = level
        STORE
        S.commands[0] = u
        if switches:
            eventful(P, S, signals.gap[k], signals.gap[k + 1], u)
            k += 1
            if level > limits[1] and not before > limits[1]:
                why = {NOVELTY}
            before = level
    TAIL
    X.theta_d[0] = screw
    return k, why
"""


def _by_form(*arguments: Any) -> tuple[int, int]:
    """What numba replaces by the loop that is written for the form, its first argument."""
    raise NotImplementedError


@overload(_by_form, jit_options={"error_model": "numpy", "_nrt": False})
def _loop_of(form, P, S, C, X, detector, oscillator, signals, traces, roles, first, stop, gap_hat, limits, before):
    space = {"math": math, "np": np, "eventful": eventful}
    exec(compile(_written(form.form), "<loop of a form>", "exec"), space)
    return space["loop"]


@compiled
def cruise(form, P, S, C, X, detector, oscillator, signals, traces, roles, first, stop, gap_hat, limits, before):
    """:func:`.loop.run_segment` for what has a form (:func:`form_of`): the same arguments, the same bits."""
    return _by_form(
        form, P, S, C, X, detector, oscillator, signals, traces, roles, first, stop, gap_hat, limits, before
    )
