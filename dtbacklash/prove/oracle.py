"""The oracle: a fit that knows the true structure, by the diagnosis' own predictor, on the same samples.

It tells how small the held-out error can be, and which hidden effects the recording shows clearly. The true structure
is fitted from the true values to all but the last part; then, for each effect, the structure without it, all else
fitted anew from the true values. The effect is clear if three things hold:

- the score, -2 log likelihood and log N for each parameter of a law, rises by ``WORTH`` without the effect;
- at the noise levels that the true structure needs, in one channel or in all together, the excess
  of the mean square of the whitened innovations over 1, which they have where nothing is missing, or over what the true
  structure leaves if that is less, falls by at least half with the effect (``EXCESS_LEFT``);
- and its logarithm falls by at least ``T_CLEAR`` standard errors in the paired test over ``STRETCHES`` stretches (what
  lacks something errs in bursts, of which the largest would decide alone).

A wrong parameter is clear by the same rule, with the parameter held at its nominal value instead of an effect left out.

The diagnosis cannot simulate physics that the catalogue lacks. There the true law leaves the noise that the sensors
had, and is compared with the best law of the catalogue: of the recalibrated rig, of the ``LAWS_TRIED`` that promise
most, and of the diagnosed rig. A predictor that may assume large unknown forces forgives a wrong law, so all are fitted
and compared where it may assume next to none (``STRICT``). The case is clear if the best law leaves more than
``UNLISTED_LEFT`` times the mean square that the noise leaves in the same predictor, by ``T_CLEAR`` standard errors.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.motion import motion_of
from dtbacklash.diagnosis.engine.parameters import Key, effects_of_rig, is_known, taken_out
from dtbacklash.diagnosis.engine.predictor import ASTRAY
from dtbacklash.diagnosis.engine.resampling import rate_of
from dtbacklash.diagnosis.engine.rig_simulator import Simulated
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.predictions import predictor_of
from dtbacklash.errors import Failure, UserError
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.prove.secret import with_effects

if TYPE_CHECKING:
    from dtbacklash.diagnosis.records import Record

#: the last share of a recording is held out
HELD_OUT = 0.15
#: steps of a fit at given noise levels
STEPS = 5
#: stretches of a recording that are compared
STRETCHES = 12
#: by which the score has to rise without an effect: at least, and for each reading
WORTH = 60.0, 0.002
#: largest share of the excess of the mean square over 1 that may be left with the hidden effect in the model
EXCESS_LEFT = 0.5
#: standard errors, over stretches, by which the mean square has to fall
T_CLEAR = 3.0
#: laws of the catalogue that are fitted to unknown physics, the unknown force that they may assume (share of the
#: motion's), and the mean square, relative to the noise's, that the best of them has to leave
LAWS_TRIED, STRICT, UNLISTED_LEFT = 5, 1e-3, 1.1


@dataclass(frozen=True)
class Sight:
    """Mean squares of the clearest channel without and with an effect, t of their fall, and the score it has to spare.

    to_spare : what the score rises by without the effect, less what it has to.
    """

    without: float
    with_it: float
    t: float
    to_spare: float = 0.0

    @property
    def clear(self) -> bool:
        """The rule."""
        left, excess = max(self.with_it - 1.0, 0.0), self.without - 1.0
        return bool(excess > 0.0 and left <= EXCESS_LEFT * excess and self.t >= T_CLEAR and self.to_spare >= 0.0)


class Oracle:
    """One recording of a nominal rig. predictor : of all of it. segments : of all but the held-out part."""

    def __init__(self, nominal: Rig, record: Record) -> None:
        self.nominal, self.record = nominal, record
        self.channels = tuple(c for c in nominal.sensors if c in record.y)
        fitted = round((1.0 - HELD_OUT) * record.samples)
        self.every = rate_of(nominal, {c: record.y[c][:fitted] for c in self.channels}, record.sample_time_s)
        self.predictor = predictor_of(nominal, record, self.every)
        self.segments = Segments(nominal, (self.predictor.first(1.0 - HELD_OUT),))
        for predictor in (self.predictor, *self.segments.predictors):
            # in few steps, at the rate of the motion, a true friction may seem false
            predictor.simulated = Simulated(predictor.readings, finely=True)

    def fit(self, rig: Rig, keys: Iterable[Key], pinned: str = "") -> FittedModel | None:
        """These effects and the nominal parameters, from their values in a rig; None if it does not stay finite.

        pinned : a parameter that stays as it is in the rig.
        """
        segments = self._segments(pinned)
        noise_levels, _ = segments.tuned(rig)
        return self._problem(segments, rig, keys, noise_levels).homotopy_fit(noise_levels)

    def at(self, noise_levels: NoiseLevels, rig: Rig, keys: Iterable[Key], pinned: str = "") -> Rig:
        """The rig with the values that fit best at given noise levels."""
        problem = self._problem(self._segments(pinned), rig, keys, noise_levels)
        x, squares = problem.gauss_newton(noise_levels, problem.start(), STEPS)
        return problem.rig(x) if math.isfinite(squares) else rig

    def _segments(self, pinned: str) -> Segments:
        if not pinned:
            return self.segments
        known = self.nominal.config.parameters
        exact = {**known, pinned: replace(known[pinned], tolerance=0.0)}
        return replace(self.segments, nominal=build_rig(replace(self.nominal.config, parameters=exact)))

    @staticmethod
    def _problem(segments: Segments, rig: Rig, keys: Iterable[Key], noise_levels: NoiseLevels) -> FitProblem:
        there = [key for key in keys if rig.effect(*key) is not None]
        return FitProblem(segments, rig, there, motion_of(segments, rig, segments.gains(rig, noise_levels)), stiff=1.0)

    def rows(self, rig: Rig, noise_levels: NoiseLevels) -> Floats:
        """(N, channels) whitened innovations of the whole recording."""
        E = self.predictor.run(rig, self.predictor.gains(rig, noise_levels[0])).E
        return E if np.isfinite(E).all() else np.full_like(E, ASTRAY)

    def seen(self, best: FittedModel, without: FittedModel | None, pinned: str = "") -> Sight:
        """The true structure beside one that lacks something (None: it does not follow the recording at all)."""
        if without is None:
            return Sight(math.inf, 1.0, math.inf, math.inf)
        # at the noise levels of the true structure, other values may follow the recording better
        there = self.at(best.noise_levels, without.rig, without.keys, pinned)
        lacks = [self.rows(rig, best.noise_levels) for rig in (without.rig, there)]
        found = compared(min(lacks, key=_square), self.rows(best.rig, best.noise_levels))
        least = max(WORTH[0], WORTH[1] * self.segments.count)
        return replace(found, to_spare=float(without.score - best.score - least))

    def held_out(self, rig: Rig | None, noise_levels: NoiseLevels) -> float:
        """Rms of a rig's whitened innovations of the held-out part."""
        if rig is None:
            return math.nan
        return math.sqrt(_square(self.rows(rig, noise_levels)[len(self.segments.predictors[0].readings.u) :]))

    def unlisted(self, recalibrated: FittedModel, extended: Rig | None, truth: dict[str, Floats]) -> dict[str, Sight]:
        """{name of the catalogue's best law: beside the noise}; truth : sensor -> (N,) its reading without errors."""
        strict = recalibrated.noise_levels[0].copy()
        strict[: len(self.predictor.bodies)] = math.log(STRICT)
        noise_levels = (strict,)
        bare = self.at(noise_levels, recalibrated.rig, ())
        tried = {"recalibrated": bare}
        if extended is not None:
            keys = [key for key in effects_of_rig(extended) if not is_known(self.nominal, key)]
            tried["diagnosed"] = self.at(noise_levels, extended, keys)
        for p in CandidateSensitivities(self.segments, replace(recalibrated, rig=bare), noise_levels).ranked[
            :LAWS_TRIED
        ]:
            with suppress(UserError):  # the rig cannot have it
                tried[".".join(*p.keys)] = self.at(noise_levels, p.put(bare), p.keys)
        left = {name: self.rows(rig, noise_levels) for name, rig in tried.items()}
        best = min(left, key=lambda name: _square(left[name]))
        noise = {c: self.record.y[c] - truth[c] for c in self.channels}
        # what noise alone makes of the same predictor at rest: it is all that the true law leaves
        still = predictor_of(self.nominal, replace(self.record, u=np.zeros_like(self.record.u), y=noise), self.every)
        alone = still.run(bare, self.predictor.gains(bare, strict)).E
        size = np.sqrt((alone**2).mean(axis=0))
        return {best: compared(left[best] / size, alone / size)}


def look(
    nominal: Rig, record: Record, secret: dict[str, Any], extended: Rig | None, truth: dict[str, Floats] | None = None
) -> dict[str, Any]:
    """The oracle's answer about one case.

    nominal, record : the nominal rig and the recording. secret : what was hidden, as a dict.
    extended : the diagnosed rig, or None where the diagnosis failed.
    truth : sensor -> (N,) its reading without noise and counts, SI; needed for unknown physics.

    Returns ``held_out`` : rms of the held-out part's whitened innovations, at the oracle's noise levels, of the
    ``nominal``, the ``recalibrated``, the ``extended`` and the ``oracle``'s rig; ``clear`` and ``clear_parameters`` :
    name -> bool; ``unlisted_clear`` : bool; ``seen`` : the figures behind them; ``wall_s``.

    Raises Failure: the true structure, or the nominal one, does not follow the recording.
    """
    begin, oracle = time.perf_counter(), Oracle(nominal, record)
    keys = [(e["location"], e["effect"]) for e in secret["effects"]]
    true = with_effects(nominal.with_parameters(secret["parameters"]), secret["effects"])
    bare = nominal.with_parameters(secret["parameters"])
    recalibrated = oracle.fit(bare, ())
    best = oracle.fit(true, keys) if keys else recalibrated
    if best is None or recalibrated is None:
        raise Failure("recording", "", "the oracle's rig does not follow it: its simulation does not stay finite")
    seen, wrong, unlisted = {}, {}, {}
    for key in keys:
        others = [k for k in keys if k != key]
        seen[".".join(key)] = oracle.seen(best, oracle.fit(taken_out(true, key), others) if others else recalibrated)
    if secret["kind"] == "parameters":
        for name in secret["parameters"]:
            pinned = bare.with_parameters({name: nominal.config.parameters[name].value})
            wrong[name] = oracle.seen(best, oracle.fit(pinned, (), name), name)
    if secret["kind"] == "unknown" and truth is not None:
        unlisted = oracle.unlisted(recalibrated, extended, truth)
    best = better(oracle, best, extended)
    again = oracle.at(best.noise_levels, recalibrated.rig, ())
    rigs = {"nominal": nominal, "recalibrated": again, "extended": extended, "oracle": best.rig}
    return {
        "held_out": {name: oracle.held_out(rig, best.noise_levels) for name, rig in rigs.items()},
        "clear": {name: s.clear for name, s in seen.items()},
        "clear_parameters": {name: s.clear for name, s in wrong.items()},
        "unlisted_clear": any(s.clear and s.without > UNLISTED_LEFT for s in unlisted.values()),
        "seen": {
            n: {"without": s.without, "with": s.with_it, "t": s.t, "to_spare": s.to_spare}
            for n, s in {**seen, **wrong, **unlisted}.items()
        },
        "wall_s": time.perf_counter() - begin,
    }


def better(oracle: Oracle, best: FittedModel, extended: Rig | None) -> FittedModel:
    """The oracle's fit, or a better one from the diagnosed values, if the diagnosed structure is the true one.

    A fit of several effects can get stuck in a local minimum, which would flatter the diagnosis.
    """
    if extended is None or not best.keys or effects_of_rig(extended).keys() != effects_of_rig(best.rig).keys():
        return best
    again = oracle.fit(extended, best.keys)
    return best if again is None or again.score >= best.score else again


def compared(without: Floats, best: Floats) -> Sight:
    """Rows (N, channels) without and with an effect: the clearest channel, or all together, else that of the largest t.

    Mean squares are divided by that of the second where it is below 1: counts leave less than white noise of their
    size does. t is that of the logarithms: what lacks something errs in bursts.
    """
    first, second = (_stretches(E) for E in (without, best))
    floor = np.minimum(second.mean(axis=0), 1.0)
    falls = np.log(first) - np.log(second)
    errors = falls.std(axis=0, ddof=1) / math.sqrt(STRETCHES) + 1e-12
    found = [
        Sight(float(a), float(b), float(t))
        for a, b, t in zip(
            (first / floor).mean(axis=0), (second / floor).mean(axis=0), falls.mean(axis=0) / errors, strict=True
        )
    ]
    return max(found, key=lambda s: (s.clear, s.t))


def _stretches(E: Floats) -> Floats:
    """(STRETCHES, channels + 1) mean squares of the stretches of rows; last those of all channels together."""
    squares = np.array([(part**2).mean(axis=0) for part in np.array_split(E, STRETCHES)])
    return np.maximum(np.column_stack([squares, squares.mean(axis=1)]), 1e-300)


def _square(E: Floats) -> float:
    """Mean square of rows."""
    return float((E**2).mean())
