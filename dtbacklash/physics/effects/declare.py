"""What an effect declares: its parameters and their roles, its slot, where a search starts, how it is concealed.

Everything else in the package (simulation, bank, refit, concealed draws, docs, drawings, reports) reads these
declarations and knows no effect by its name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.config.rig import value_of
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.physics.effects.slots import Slot

INF = float("inf")
#: stands for the name of an effect's size in starts and in the arguments of a law
SIZE = "size"
#: unit of a parameter that is in the unit of the sensor where it acts
SENSOR_UNIT = "sensor's unit"
Values = dict[str, float]

#: relative standard deviation of an effect's parameters between two formulations of its law that engineers would call
#: the same (a bristle for ideal friction, a stiff spring for a stop), and of two integrators
FORMULATION_ERROR = 5e-4
#: the same of a law with a rest (how a body is held there) or a stop (how steep it is)
REST_ERROR = 5e-3
#: the same of a law with a corner (how sharp it is)
CORNER_ERROR = 2e-3


#: what is periodic is seen where a period has as many samples, and as many periods are recorded
SAMPLES_A_PERIOD, PERIODS = 4.0, 2.0
#: of what waves over a position, as much of a wave has to lie within the way
WAVES = 0.5
#: an end that is reached more often shows its corner
TOUCHES = 2
#: over less of a turn what goes with its sine is no more than a straight line (share)
STRAIGHT = 0.1


class Role(StrEnum):
    """What a parameter is to its law; a search treats it accordingly, whatever its name.

    SIZE : switches the effect off at its neutral value. WAVE : counts waves over a position, so that the fit has a
    valley for each; it is scanned. ANGLE : a phase, periodic in 2 pi. TIME : a pure delay. FREQUENCY : at which
    something swings, Hz. KNOT : a value of a table. GIVEN : it says where the others hold, and is never fitted. SHAPE :
    any other; what can only be positive is fitted in logarithms.
    """

    SIZE = "size"
    WAVE = "wave"
    ANGLE = "angle"
    TIME = "time"
    FREQUENCY = "frequency"
    KNOT = "knot"
    GIVEN = "given"
    SHAPE = "shape"


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit : as in configs, JSON and reports; SI.
    low, high : physical bounds, inclusive.
    typical : a size that can be seen on a rig of the paper's scale; the default where ``neutral`` is None.
    neutral : the value at which it does nothing. The effect's size has one, and what adds to the law as the size does;
    the effect does nothing where all of these stand there.
    role : see :class:`Role`.
    counted : whether it is read off a counted position at reversals, so that it errs by a part of a count.
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    neutral: float | None = None
    role: Role = Role.SHAPE
    counted: bool = False


@dataclass(frozen=True)
class Place:
    """How the place of an effect moves in a recording or a simulation: what starts and concealed sizes are made from.

    values : the element's nominal parameters, SI. duration_s, sample_time_s : of the recording. command : (N,) V.
    modes : lowest and highest frequency at which the rig's structure swings, or between which it can be seen, Hz.
    speed : the body's, as fast as it usually is, and speed_slow : what that is below for a quarter of the time in
    motion, rad/s or m/s. stretch : (N,) of the spring, m or rad, or None; span and reach : its usual size and its
    largest. stretch_rate : its usual rate. force : what usually drives the place, N or N m; 0 where that is not known,
    and ``force_most`` : what a friction or a load there may take at most. current : of the motor, A.
    travel : position that one turn of the motor makes, m (0: there is no screw). way : range of the body's position, or
    of the motor's angle at a gear or screw, m or rad (0: not known).
    """

    values: Values = field(default_factory=dict)
    duration_s: float = 0.0
    sample_time_s: float = 1e-3
    modes: tuple[float, float] = (0.0, 0.0)
    command: Floats = field(default_factory=lambda: np.zeros(0))
    speed: float = 0.0
    speed_slow: float = 0.0
    stretch: Floats | None = None
    span: float = 0.0
    reach: float = 0.0
    stretch_rate: float = 0.0
    force: float = 0.0
    force_most: float = 0.0
    current: float = 0.0
    travel: float = 0.0
    way: float = 0.0


@dataclass(frozen=True)
class Shape:
    """A concealed effect but for its size: where strengths may lie, and the values that a strength gives.

    most : largest strength. guess : where to begin. values : strength -> parameters of the effect.
    """

    most: float
    guess: float
    values: Callable[[float], Values]


#: Where a search starts: sets of values of those parameters that the recording says something about; the others stand
#: at their typical value. ``size`` stands for the size, whatever its name; it is scaled to the residual later.
Starts = Callable[[Place], list[Values]]
#: (place, sign of the size) -> (largest strength, first guess) of a concealed effect that leaves a rig that still works
Range = Callable[[Place, float], tuple[float, float]]
#: the parameters beside the size of a concealed effect, drawn
Draws = Callable[[Generator, Place], Values]
#: parameter -> (low, high): beyond them the recording cannot show it, as the motion or the command does not go there
Bounds = dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Alias:
    """Another law that an effort is as well, beside dry friction of a level that is larger.

    friction : the effect that has the level. effect, parameter : of the other law; the parameter is minus the effort.
    reason : why no recording tells the two, in words.
    """

    friction: str
    effect: str
    parameter: str
    reason: str


def hardly_reached(beyond: np.ndarray) -> bool:
    """Whether a motion goes beyond an end twice at most: that shows no corner. beyond : (N,) whether it is there."""
    return int(np.count_nonzero(np.diff(beyond.astype(int), prepend=0) > 0)) <= TOUCHES


def within_a_line(simpler: str) -> Callable[[Values, Place], str]:
    """The simpler law where a place moves over so little of a turn that a sine is no more than a straight line."""
    return lambda values, place: simpler if 0.0 < place.way < 2.0 * np.pi * STRAIGHT else ""


@dataclass(frozen=True)
class Effect:
    """One effect at one kind of element.

    Attributes
    ----------
    name : its name in the vocabulary, e.g. ``coulomb_friction``.
    kind : the kind of element where it acts, see :mod:`dtbacklash.physics.element_kinds`.
    parameters : the first is its size and has a neutral value.
    law : the formula as text.
    slot : where it acts, with its laws.
    source : of the formula.
    sentence : what a report says; ``{location}`` and the parameters' names are filled in.
    conceal : how large it may be where it is concealed. draws : the other parameters of a concealed one.
    starts : where a search starts.
    strength : (place, strength) -> size, for laws in which less is more; ``None`` where the size is the strength.
    formulation_error : see :data:`FORMULATION_ERROR`; intervals count it.
    becomes : (parameter, effect): where the parameter is small, or beyond what is recorded, the law is the other one,
        at kinds of elements that take it (:func:`dtbacklash.physics.catalogue.simpler`).
    alias : what the law is called beside dry friction that is larger.
    sentence_without : (parameter, sentence): what a report says instead where this parameter does nothing.
    remark : values -> a sentence more, or nothing.
    excludes : effects that are not concealed together with it.
    visible : what a recording can show of its parameters, see :meth:`bounds_at`.
    simpler_at : (values, place) -> the law that does the same there, as the motion does not reach the end of this one's
        shape; empty where it does.
    of_both_signs : the state that has to take both signs, or the law is another one.
    of_units : the SI units of the sensors that take it; empty: all.
    declared : of a law that a user wrote, its declaration, see :mod:`dtbacklash.physics.user_laws`.
    refuse : values -> (parameter, what is allowed), of values that do not go together, or None.
    covered : values -> state -> (lowest, highest) that it was made from, where that is known.
    turned : of a law with a phase, what it is half a turn further, where its size would be negative.
    """

    name: str
    kind: str
    parameters: tuple[Parameter, ...]
    law: str
    slot: Slot
    source: str
    sentence: str
    conceal: Range
    draws: Draws = lambda rng, place: {}
    starts: Starts = lambda place: [{}]
    strength: Callable[[Place, float], float] | None = None
    formulation_error: float = FORMULATION_ERROR
    becomes: tuple[str, str] | None = None
    alias: Alias | None = None
    sentence_without: tuple[tuple[str, str], ...] = ()
    remark: Callable[[Values], str] = lambda values: ""
    excludes: tuple[str, ...] = ()
    visible: Callable[[Place], Bounds] = lambda place: {}
    simpler_at: Callable[[Values, Place], str] = lambda values, place: ""
    of_both_signs: str = ""
    of_units: tuple[str, ...] = ()
    declared: Mapping[str, Any] | None = None
    refuse: Callable[[Values], tuple[str, str] | None] = lambda values: None
    covered: Callable[[Values], Mapping[str, tuple[float, float]]] = lambda values: {}
    turned: str = "the same with the other sign has"

    def __post_init__(self) -> None:
        """Read laws that are no functions of Python."""
        read = self.slot.read([p.name for p in self.parameters], f"effect {self.name}")
        object.__setattr__(self, "slot", read)

    @property
    def size(self) -> Parameter:
        """The parameter that a search scales first; its neutral value switches off what it stands for."""
        return self.parameters[0]

    @property
    def is_delay(self) -> bool:
        """Whether it makes a signal late, and does nothing else to it."""
        return self.slot.delays

    @property
    def is_table(self) -> bool:
        """Whether it is no law but a table of values: nothing that a search or a concealed draw proposes."""
        return self.size.role is Role.KNOT

    @property
    def listed(self) -> tuple[Parameter, ...]:
        """The parameters, of a table's values and knots the first alone: they are alike."""
        return tuple(p for p in self.parameters if p.name[1:] == "1" or not p.name[1:].isdigit() or not self.is_table)

    @property
    def counts(self) -> int:
        """How many of its parameters a fit may move."""
        return sum(p.role is not Role.GIVEN for p in self.parameters)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        """The parameters that have a neutral value: the size, and what adds to the law as the size does."""
        return tuple(p for p in self.parameters if p.neutral is not None)

    def of_role(self, role: Role) -> Parameter | None:
        """The parameter that has a role, or None."""
        return next((p for p in self.parameters if p.role is role), None)

    def is_neutral(self, values: Values) -> bool:
        """Whether these values make the effect do nothing."""
        return all(values.get(p.name, p.neutral) == p.neutral for p in self.amplitudes)

    def idle(self, values: Values) -> set[str]:
        """The amplitudes that stand at their neutral value beside another one; where all of them do, beside the size.

        A search leaves them there: what is not asked for costs no parameter. Of a table, what is given.
        """
        if self.is_table:
            return {p.name for p in self.parameters if p.role is Role.GIVEN}
        still = {p.name for p in self.amplitudes if values.get(p.name, p.neutral) == p.neutral}
        return still - {self.size.name} if self.is_neutral(values) else still

    def said(self, idle: Collection[str] = ()) -> str:
        """What a report says, where these parameters do nothing; names in braces are to be filled in."""
        return next((text for name, text in self.sentence_without if name in idle), self.sentence)

    def complete(self, leaves: Mapping[str, Any], key: str) -> Values:
        """Fill in defaults and check names and bounds; ``key`` is the dotted name for the error.

        leaves : parameter -> number, or a mapping with its ``value`` and ``tolerance``.
        """
        known = {p.name: p for p in self.parameters}
        values = {name: value_of(leaf) for name, leaf in leaves.items()}
        for name, value in values.items():
            if name not in known:
                raise UserError(f"{key}.{name}", value, f"unknown parameter; known: {', '.join(known)}")
        if not any(p.name in values for p in self.amplitudes):
            needed = " or ".join(f"`{p.name}` [{p.unit}]" for p in self.amplitudes)
            raise UserError(key, dict(values), f"{needed} must be given")
        missing = (
            [p.name for p in self.parameters if p.name not in values and p.name != "bend"] if self.is_table else []
        )
        if missing:
            raise UserError(f"{key}.{missing[0]}", "(missing)", "a table has f1 to f16, its values, at x1 to x16")
        usual = {p.name: p.typical if p.neutral is None else p.neutral for p in self.parameters}
        filled = {name: float(values.get(name, value)) for name, value in usual.items()}
        for p in self.parameters:
            if p.role is Role.ANGLE and not p.low <= filled[p.name] <= p.high:
                filled[p.name] = math.remainder(filled[p.name], 2.0 * math.pi)
            if not p.low <= (value := filled[p.name]) <= p.high:
                allowed = f"from {p.low:g} to {p.high:g} {p.unit}".removesuffix(" 1")
                angle = self.of_role(Role.ANGLE) if p is self.size and value < 0.0 else None
                turned = f"; {self.turned} {angle.name}: 180 deg" if angle else ""
                raise UserError(f"{key}.{p.name}", value, allowed + turned)
        if refused := self.refuse(filled):
            raise UserError(f"{key}.{refused[0]}", filled[refused[0]], refused[1])
        return filled

    def start_values(self, place: Place) -> list[Values]:
        """Complete sets of values from which a search starts, within the bounds."""
        bounds = {p.name: (p.low, p.high) for p in self.parameters}
        typical = {p.name: p.typical for p in self.parameters}
        found = []
        for values in self.starts(place):
            named = {self.size.name if name == SIZE else name: value for name, value in values.items()}
            found.append({**typical, **{n: float(np.clip(v, *bounds[n])) for n, v in named.items()}})
        return found

    def bounds_at(self, place: Place) -> Bounds:
        """Within which bounds a recording can show its parameters: an effect at one of them is not seen.

        Beside what the effect says itself: half a wave at least over the way, what swings or waves is sampled
        ``SAMPLES_A_PERIOD`` times a period (waves for a quarter of the time in motion: where it passes them faster
        they move it little), and at least ``PERIODS`` of it fit into the recording.
        """
        found = dict(self.visible(place))
        fastest = 1.0 / (SAMPLES_A_PERIOD * place.sample_time_s)
        for p in self.parameters:
            if p.role is Role.FREQUENCY and place.duration_s > 0.0:
                found[p.name] = PERIODS / place.duration_s, fastest
        found |= self._waves_at(place)
        return {name: (low, high) for name, (low, high) in found.items() if high > low}

    def is_shown(self, place: Place) -> bool:
        """Whether a recording can show the effect at all: a law that waves, some wave number of it."""
        return all(high > low for low, high in self._waves_at(place).values())

    def _waves_at(self, place: Place) -> Bounds:
        """The wave numbers that a recording can show."""
        found = {}
        for p in self.parameters:
            if p.role is Role.WAVE and place.way > 0.0:
                sampled = 2.0 * np.pi / (SAMPLES_A_PERIOD * place.sample_time_s)
                most = sampled / place.speed_slow if place.speed_slow > 0.0 else p.high
                found[p.name] = max(p.low, 2.0 * np.pi * WAVES / place.way), min(p.high, most)
        return found

    def draw_shape(self, rng: Generator, place: Place) -> Shape:
        """Draw everything of a concealed effect but its size: its sign and its other parameters."""
        size, strength = self.size, self.strength
        sign = float(rng.choice([-1.0, 1.0])) if size.low < 0.0 and strength is None else 1.0
        most, guess = self.conceal(place, sign)
        others = {p.name: p.typical for p in self.parameters[1:]} | self.draws(rng, place)
        ends = {
            p.name: (p.low, p.high) for p in self.parameters
        }  # of a body that hardly moves, a speed may be too small
        others = {name: min(max(value, ends[name][0]), ends[name][1]) for name, value in others.items()}
        if strength is not None:
            of_size = strength
            return Shape(most, guess, lambda s: {size.name: of_size(place, s), **others})
        most = min(most, size.high, -size.low if sign < 0.0 else INF)
        return Shape(most, min(guess, 0.5 * most), lambda s: {size.name: sign * s, **others})


def name_in_words(name: str) -> str:
    """A name of the vocabulary as words: ``coulomb_friction`` is ``Coulomb friction``."""
    proper = {"coulomb": "Coulomb", "dahl": "Dahl", "stribeck": "Stribeck"}
    return " ".join(proper.get(word, word) for word in name.split("_"))
