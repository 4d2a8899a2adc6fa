"""Which effects a planned experiment would show, from which size on, and which of them it would confuse.

Every effect is a column, as in a diagnosis (:mod:`~dtbacklash.diagnosis.engine.candidates`): what it does to the
whitened innovations of the nominal rig on the planned motion. What the rig's parameters can do within their tolerances
is projected out. What is left of a column says from which size on the effect shows, and the angle between two columns
how far they can be told apart: beside another effect, one has to be larger by 1/sine.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities
from dtbacklash.diagnosis.engine.hypotheses import TABLE_SPAN, Hypothesis
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.parameters import Key, unit_at
from dtbacklash.diagnosis.engine.selection import LEAST
from dtbacklash.diagnosis.experiments.planned import planned
from dtbacklash.diagnosis.labels import named_in_words, place_in_words
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.effects.declare import Role, name_in_words
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.model import Recording

#: an effect shows from so many standard errors of its size on
SHOWS = 5.0
#: two effects are confused where one has to be five times as large to be told from the other (sine)
ALIKE = 0.2

#: a column is the slope at a size that changes the motion somewhat: so many times it, nobody knows what it would do
FAR = 100.0


@dataclass(frozen=True)
class Effect:
    """One effect that a planned motion shows, or not.

    parameter, unit : its size, SI. shows_from : from which size on it is five standard errors; None: no size does.
    named_from : from which on a diagnosis would take it up. at : its other parameters. rises : whether more of the
    effect is a larger size; of a saturation's limit it is a smaller one, and then the sizes are the largest that do.
    """

    location: str
    effect: str
    parameter: str
    unit: str
    shows_from: float | None
    named_from: float | None
    at: dict[str, float]
    rises: bool = True

    @property
    def key(self) -> Key:
        """(place, effect)."""
        return self.location, self.effect


@dataclass(frozen=True)
class Pair:
    """Two effects with the sine between them, and what would tell them apart, in words (empty: nothing is known)."""

    first: Key
    second: Key
    sine: float
    advice: str = ""

    @property
    def sentence(self) -> str:
        """What a person would say."""
        (p, a), (q, b) = self.first, self.second
        both = f"{_capital(name_in_words(a))} at {place_in_words(p)} and at {place_in_words(q)}" if a == b else (
            f"{_capital(named_in_words(a, p))} and {named_in_words(b, q)}")  # fmt: skip
        return f"{both} cannot be told apart ({self.sine:.2g}){': ' + self.advice if self.advice else ''}."


@dataclass(frozen=True)
class Isolability:
    """What a planned experiment would show.

    effects : those that show, in the order of the rig's places. sines : (n, n) between them. pairs : those that would
    be confused, the worst first, and before them those that something is known to tell apart. hidden : effects that the
    rig may have and this motion shows at no size. one_way : bodies that never reverse. every : samples that a reading
    stands for. readings : their number.
    """

    effects: tuple[Effect, ...]
    sines: Floats
    pairs: tuple[Pair, ...]
    hidden: tuple[Key, ...]
    one_way: tuple[str, ...]
    every: int
    readings: int

    def sine(self, a: Key, b: Key) -> float:
        """Between two effects that show; KeyError where one does not."""
        at = {e.key: k for k, e in enumerate(self.effects)}
        return float(self.sines[at[a], at[b]])


#: a recording of the same experiment with all sensors of the rig, or with the command once more turned around
Another = Callable[[], Recording]


def isolability(
    rig: Rig, recording: Recording, unknown: float | None = None, turned: Another | None = None,
    complete: Another | None = None,
) -> Isolability:  # fmt: skip
    """What a planned experiment would show of a rig.

    Parameters
    ----------
    recording : the rig, simulated on the plan, as its sensors show it. unknown : unknown force at each body, a share of
        the force that moves it; None: ``unexplained_attention`` of the settings of the diagnosis.
    turned : the same with the command once more the other way round, where that can be done. complete : the same with
        all sensors of the rig, where some are left out.

    Raises
    ------
    UserError : nothing moves; nothing recorded shows some part that integrates.
    """
    share = SETTINGS.unexplained_attention if unknown is None else unknown
    found, motion = _columns(rig, recording, share)
    one_way = tuple(b for b, v in motion.speed.items() if _one_sign(v))
    others: list[tuple[str, Isolability]] = []
    confused = _pairs(found)
    if confused and one_way and turned is not None:
        said = "with the same command once more, turned around, so that the motion reverses,"
        others.append((said, _columns(rig, turned(), share)[0]))
    if confused and complete is not None:
        more = [s for s in rig.sensors if s not in recording.channels]
        others.append((f"with {' and '.join(more)} recorded as well", _columns(rig, complete(), share)[0]))
    pairs = tuple(sorted((_advised(p, others) for p in confused), key=lambda p: not p.advice))
    return replace(found, pairs=pairs, one_way=one_way)


def _advised(pair: Pair, others: list[tuple[str, Isolability]]) -> Pair:
    for said, other in others:
        try:
            sine = other.sine(pair.first, pair.second)
        except KeyError:
            continue
        if sine >= ALIKE:
            return Pair(pair.first, pair.second, pair.sine, f"{said} {sine:.2g}")
    return pair


def _one_sign(speed: Floats) -> bool:
    low, high = np.quantile(speed, TABLE_SPAN)
    return bool(low >= 0.0 or high <= 0.0)


def _columns(rig: Rig, recording: Recording, unknown: float) -> tuple[Isolability, Motion]:
    """Effects and sines of one experiment, without what would help."""
    if not any(np.nanstd(v) > 0.0 for c, v in recording.channels.items() if c in rig.sensors):
        raise UserError("command", recording.name, "moves nothing; no sensor of the rig would show a change")
    plan = planned(rig, recording, unknown)
    columns = CandidateSensitivities(plan.segments, plan.model, plan.noise_levels, every=True)
    hypotheses, errors, sines = columns.angles()
    keys = list(dict.fromkeys(h.key for h in hypotheses))
    named = math.sqrt(max(SETTINGS.min_gain_if_clearing * plan.segments.count, LEAST))
    effects, groups = [], []
    for key in keys:
        js = [j for j, h in enumerate(hypotheses) if h.key == key]
        one = _effect(rig, [(hypotheses[j], float(errors[j])) for j in js], named)
        if one is not None:
            effects.append(one)
            groups.append(js)
    between = np.array([[float(sines[np.ix_(a, b)].min()) if a is not b else 0.0 for b in groups] for a in groups])
    seen = {e.key for e in effects}
    taken = [(place, e.name) for place in rig.places for e in rig.takes(place).values()
             if not e.is_table and rig.effect(place, e.name) is None]  # fmt: skip
    recorded = plan.segments.sensors
    hidden = [k for k in taken if k not in seen and (k[0] in rig.elements or k[0] in recorded)]
    found = Isolability(tuple(effects), between.reshape(len(groups), len(groups)), (), tuple(hidden), (), plan.every,
                        plan.segments.count)  # fmt: skip
    return found, columns.motion


def _effect(rig: Rig, shapes: list[tuple[Hypothesis, float]], named: float) -> Effect | None:
    """An effect at the shape that shows best; None where no size that it may have shows."""
    size = shapes[0][0].effect.size
    rises = size.neutral is None or math.isfinite(size.neutral)
    best: Effect | None = None
    for h, errors in shapes:
        value = h.values[size.name]
        angle = h.effect.of_role(Role.ANGLE)
        at = {n: v for n, v in h.values.items() if n != size.name and not (angle and n == angle.name)}
        start = abs(value - (size.neutral or 0.0)) if rises else abs(value)
        if not errors > 0.0:
            continue
        if h.as_it_is:  # what it does does not grow as its size does: as it begins, or not
            shows, name = (start if errors >= wanted else None for wanted in (SHOWS, named))
        else:
            shows, name = (_possible(start, wanted / errors, size.high) for wanted in (SHOWS, named))
        if shows is None:
            continue
        one = Effect(*h.key, size.name, unit_at(rig, h.place, size.unit), shows, name, at, rises)
        if best is None or (best.shows_from is not None and (shows < best.shows_from) == rises):
            best = one
    return best


def _possible(start: float, times: float, high: float) -> float | None:
    """A size that is so many times the one where it begins; None where it cannot be, or its column says nothing."""
    return start * times if start * times <= high and times <= FAR else None


def _pairs(found: Isolability) -> list[Pair]:
    """The effects that would be confused, the worst first."""
    n = len(found.effects)
    pairs = [
        Pair(found.effects[i].key, found.effects[j].key, float(found.sines[i, j]))
        for i in range(n) for j in range(i + 1, n) if found.sines[i, j] < ALIKE
    ]  # fmt: skip
    return sorted(pairs, key=lambda p: p.sine)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
