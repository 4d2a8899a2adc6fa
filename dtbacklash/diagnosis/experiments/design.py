"""The command that tells rivals apart best, within limits: sums of sines, sets of moves, or files of the user's own.

Commands are drawn, each as large as the limits allow, and the best are changed a little at a time (an evolution
strategy with one parent: Rechenberg 1973). What is largest is the sum of log(1 + expected fall of -2 log likelihood)
over the rivals, so that one that no command tells apart does not hide the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.campaign.progress import SO_FAR
from dtbacklash.diagnosis.experiments.rivalry import Answer, Rivalry
from dtbacklash.errors import UserError

#: sines of a sum, levels of a set of moves
SINES, LEVELS = 8, 8
#: share of the tries in which anything is drawn, before the best is changed; by how much (standard deviation)
DRAWN, CHANGE = 0.5, 0.25
#: what moves from one level to the next is a ramp that takes between these shares of a level's time
RAMPS = 0.02, 0.9
#: a sum of sines has from so many periods in the experiment up to so many samples a period
PERIODS, SAMPLES_A_PERIOD = 2.0, 40.0
#: a command is made so large that its motion comes as near to the limits (share), in so many simulations at most
NEAR, SIMULATIONS = 0.97, 8
#: a drift without a command takes at most this share of a limit; else the experiment is so many times as long, again
DRIFTS, SHORTER = 0.5, 0.8
#: fewer samples than this are no experiment
FEWEST = 20
#: what is known so far is told anew where it is so many times as far apart; an exact comparison takes so many tries
NEWS, EXACT = 1.5, 2
#: where so many of each kind do not move, none does
GIVEN_UP = 4
#: no command moves less than this share of what a limit allows
STILL = 1e-6

Tell = Callable[[float, str], None]


@dataclass(frozen=True)
class Limits:
    """Largest absolute command, in the rig's unit; body -> largest travel from where it begins, and speed, SI."""

    command: float
    travel: Mapping[str, float]
    speed: Mapping[str, float]


@dataclass(frozen=True)
class Tried:
    """A command, and by how much it is expected to tell each rival apart (-2 log likelihood).

    kind : ``multisine``, ``moves`` or the name of a file. u : (N,). travel, speed : body -> largest, SI.
    """

    kind: str
    u: Floats = field(repr=False)
    apart: tuple[float, ...]
    travel: dict[str, float]
    speed: dict[str, float]

    @property
    def score(self) -> float:
        """What is made as large as possible."""
        return float(np.sum(np.log1p(self.apart)))


@dataclass(frozen=True)
class Design:
    """The best command, exactly compared; a multisine as it was drawn, within the same limits; how many were tried.

    commands : of files, all of them, the best first. drifts : the model that moves so far without a command that the
    experiment has been shortened; empty: none.
    """

    best: Tried
    beside: Tried | None
    tries: int
    commands: tuple[Tried, ...] = ()
    drifts: str = ""


def designed(
    rivalry: Rivalry, limits: Limits, duration_s: float, tries: int, seed: int = 0, tell: Tell | None = None
) -> Design:
    """The best of many commands of a length; after Ctrl-C of those that were tried until then.

    Where a model drifts to its limits without a command, the experiment is so much shorter.

    Raises
    ------
    UserError : the limits allow no motion, or the time is too short.
    """
    rng, step = np.random.default_rng(seed), rivalry.seen.sample_time_s
    _long_enough("duration_s", f"{duration_s:g}", round(duration_s / step), step)
    n, drifts = _while_within(rivalry, limits, round(duration_s / step))
    best: tuple[_Shape, Tried] | None = None
    beside: Tried | None = None
    said, told, k = "", 0.0, 0
    try:
        for k in range(tries):
            if tell:
                tell(k / (tries + 2 * EXACT), f"trying commands{said}{'; Ctrl-C keeps the best' if said else ''}")
            if best is None and k >= GIVEN_UP * len(_SHAPES):
                break
            drawn = best is None or k < DRAWN * tries
            shape = _SHAPES[k % len(_SHAPES)].drawn(rng) if drawn or best is None else best[0].changed(rng)
            found = _largest(rivalry, limits, shape.command(n, step, limits.command), shape.kind)
            if found is None:
                continue
            beside = found if beside is None and shape.kind == "multisine" else beside
            if best is None or found.score > best[1].score:
                best = shape, found
                if not said or min(found.apart) > NEWS**2 * told:
                    told, said = min(found.apart), f"{SO_FAR}{_told(found)}"
    except KeyboardInterrupt:
        if best is None:
            raise
        tries = k
    if best is None:
        largest = rivalry.answer(rivalry.found, np.full(n, limits.command))
        raise UserError(*_limit(limits, _beyond(limits, largest)[1]), "allows no motion; give a larger one")
    if tell:
        tell(tries / (tries + 2 * EXACT), f"fitting the models to what the best would show{said}")
    return Design(
        _exactly(rivalry, best[1]), None if beside is None else _exactly(rivalry, beside), tries, drifts=drifts
    )


def _while_within(rivalry: Rivalry, limits: Limits, n: int) -> tuple[int, str]:
    """For how many of n samples every model stays clear of the limits without a command; the one that does not."""
    drifts = ""
    for name, rig in (("what was found", rivalry.found), *((r.name, r.rig) for r in rivalry.rivals)):
        while (near := _beyond(limits, rivalry.answer(rig, np.zeros(n))))[0] > DRIFTS:
            n, drifts = int(SHORTER * n), name
            if n < FEWEST:
                allowed = f"{name} moves so far without a command in {FEWEST} samples; give a larger one"
                raise UserError(*_limit(limits, near[1]), allowed)
    return n, drifts


def _limit(limits: Limits, which: str) -> tuple[str, str]:
    """Key and value of a limit that :func:`_beyond` names."""
    key, _, body = which.partition(" of ")
    if not body:
        return "command_max", f"{limits.command:g}"
    return f"{key}.{body}", f"{getattr(limits, key)[body]:g}"


def _long_enough(key: str, value: str, samples: int, step_s: float) -> None:
    if samples < FEWEST:
        raise UserError(key, value, f"at least {FEWEST} samples, {FEWEST * step_s:g} s")


def chosen(rivalry: Rivalry, limits: Limits, commands: Mapping[str, Floats], tell: Tell | None = None) -> Design:
    """The best of commands that are given, as they are.

    Raises
    ------
    UserError : each goes beyond a limit, or does not stay finite; one is too short.
    """
    found, beyond = [], []
    for name, u in commands.items():
        _long_enough("commands", name, len(u), rivalry.seen.sample_time_s)
    for k, (name, u) in enumerate(commands.items()):
        if tell:
            tell(k / len(commands), name)
        answer = rivalry.answer(rivalry.found, u)
        ratio, which = _beyond(limits, answer)
        if answer is None or ratio > 1.0:
            beyond.append(f"{name} goes beyond {which}")
        else:
            found.append(_tried(rivalry, answer, name, exactly=True))
    if not found:
        raise UserError("commands", ", ".join(commands), "; ".join(beyond))
    ranked = tuple(sorted(found, key=lambda t: -t.score))
    return Design(ranked[0], None, len(commands), ranked)


def _told(tried: Tried) -> str:
    return f"{tried.kind} tell the models apart by {math.sqrt(min(tried.apart)):.3g} standard errors at least"


def _tried(rivalry: Rivalry, answer: Answer, kind: str, exactly: bool = False) -> Tried:
    """What a command tells, by the found rig's answer to it."""
    apart = tuple(rivalry.apart(answer.record, exactly))
    return Tried(kind, answer.record.u, apart, answer.travel, answer.speed)


def _exactly(rivalry: Rivalry, tried: Tried) -> Tried:
    answer = rivalry.answer(rivalry.found, tried.u)
    assert answer is not None
    return _tried(rivalry, answer, tried.kind, exactly=True)


def _largest(rivalry: Rivalry, limits: Limits, u: Floats, kind: str) -> Tried | None:
    """A shape as large as the limits allow, for the found rig and every rival; None where nothing moves."""
    most = float(np.abs(u).max())
    if not most > 0.0:
        return None
    scale = min(1.0, limits.command / most)
    for _ in range(SIMULATIONS):
        answers = [rivalry.answer(rig, scale * u) for rig in (rivalry.found, *(r.rig for r in rivalry.rivals))]
        worst = max(_beyond(limits, answer)[0] for answer in answers)
        if worst <= 1.0:
            break
        # dry friction and drift: the motion is not in proportion
        scale *= NEAR / worst if math.isfinite(worst) else 0.1
    else:
        return None
    found = answers[0]
    assert found is not None
    moves = any(v > STILL * limits.speed.get(b, math.inf) for b, v in found.speed.items())
    return _tried(rivalry, found, kind) if moves else None


def _beyond(limits: Limits, answer: Answer | None) -> tuple[float, str]:
    """How near a motion comes to the limits, 1 at the nearest, and which that is."""
    if answer is None:
        return math.inf, "what stays finite"
    ratios = {"command_max": float(np.abs(answer.record.u).max()) / limits.command}
    ratios |= {f"travel of {b}": v / limits.travel[b] for b, v in answer.travel.items() if b in limits.travel}
    ratios |= {f"speed of {b}": v / limits.speed[b] for b, v in answer.speed.items() if b in limits.speed}
    which = max(ratios, key=lambda name: ratios[name])
    return ratios[which] / (1.0 + 1e-9), which


@dataclass(frozen=True)
class _Shape:
    """A form of command: numbers between -1 and 1."""

    numbers: Floats

    kind = ""
    count = 0

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> _Shape:
        return cls(rng.uniform(-1.0, 1.0, cls.count))

    def changed(self, rng: np.random.Generator) -> _Shape:
        return type(self)(np.clip(self.numbers + CHANGE * rng.standard_normal(self.count), -1.0, 1.0))

    def command(self, n: int, step_s: float, most: float) -> Floats:
        raise NotImplementedError


class _Multisine(_Shape):
    """Sines from slow to fast with amplitudes over four decades and phases; an offset; how large it all is."""

    kind = "multisine"
    count = 2 * SINES + 2

    def command(self, n: int, step_s: float, most: float) -> Floats:
        t, whole = step_s * np.arange(n), n * step_s
        lines = np.unique(np.round(np.geomspace(PERIODS, max(n / SAMPLES_A_PERIOD, PERIODS), SINES)))
        amplitudes, phases = 10.0 ** (2.0 * self.numbers[:SINES]), np.pi * self.numbers[SINES:-2]
        waves = zip(lines, amplitudes, phases, strict=False)
        u = np.sum([a * np.sin(2.0 * np.pi * line / whole * t + p) for line, a, p in waves], axis=0)
        u = u / max(np.abs(u).max(), 1e-300) + (self.numbers[-2] ** 3)
        return _sized(u, self.numbers[-1], most)


class _Moves(_Shape):
    """Levels, each held for a while, with ramps between them."""

    kind = "moves"
    count = LEVELS + 2

    def command(self, n: int, step_s: float, most: float) -> Floats:
        low, high = RAMPS
        ramp = low * (high / low) ** (0.5 + 0.5 * self.numbers[-2])
        levels = np.concatenate([[0.0], self.numbers[:LEVELS], [0.0]])
        at = np.arange(n) / n * (LEVELS + 1)
        k = np.minimum(at.astype(int), LEVELS)
        share = np.clip((at - k) / ramp, 0.0, 1.0)
        return _sized(levels[k] + (levels[k + 1] - levels[k]) * share, self.numbers[-1], most)


def _sized(u: Floats, size: float, most: float) -> Floats:
    """A form as a command: a tenth of what is allowed, or more."""
    found: Floats = most * 10.0 ** (0.5 * (size - 1.0)) * u / max(float(np.abs(u).max()), 1e-300)
    return found


_SHAPES: tuple[type[_Shape], ...] = (_Multisine, _Moves)
