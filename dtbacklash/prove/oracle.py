"""The oracle: a fit that knows the true structure, on the same samples as the diagnosis, by the diagnosis' own fit.

It tells how small the held-out error can be, and which hidden effects the recording shows clearly. The rule for each
effect, with all others kept and everything fitted with and without it:

    clear = in one channel, the excess of the held-out mean square over the noise floor falls by at least half
            (``EXCESS_LEFT``), and by at least ``T_CLEAR`` standard errors in the paired test over stretches.

A wrong parameter is clear by the same rule, with the parameter held at its nominal value instead of an effect left out.

The diagnosis cannot simulate physics that the catalogue lacks. There the true law is the concealing simulator, whose
residuals are the noise that the sensors had. It is compared with the best law of the catalogue on the held-out part: of
the ``LAWS_TRIED`` with the highest scores, and of the diagnosed rig. The case is clear if the true law is better by the
same rule, with the standard errors of the logarithms of the mean squares (a wrong law errs in bursts), and if the best
law of the catalogue leaves more than ``UNLISTED_LEFT`` of the floor's mean square.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.rig import ParameterConfig
from dtbacklash.diagnose.data.candidates import candidates
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.free import Effects, effect_free, effects_of_rig, nominal_free
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import fit, objective
from dtbacklash.diagnose.propose.locate import bank
from dtbacklash.diagnose.search.parts import judging
from dtbacklash.physics.rig import Rig, build_rig

#: largest share of the excess over the floor that may be left with the hidden effect in the model
EXCESS_LEFT = 0.5
#: standard errors, over stretches, by which the held-out mean square has to fall
T_CLEAR = 3.0
#: laws of the catalogue that are fitted to unknown physics, and the mean square, relative to the floor's, that the best
#: of them has to leave: fits of the true structure left no more than 1.07
LAWS_TRIED, UNLISTED_LEFT = 5, 1.1


@dataclass(frozen=True)
class Seen:
    """Mean squares of the clearest channel without and with an effect, in units of the floor's, and t of their fall."""

    without: float
    with_it: float
    t: float

    @property
    def clear(self) -> bool:
        """The rule."""
        left, excess = max(self.with_it - 1.0, 0.0), self.without - 1.0
        return excess > 0.0 and left <= EXCESS_LEFT * excess and self.t >= T_CLEAR


def look(
    evidence: Evidence, secret: dict[str, Any], extended: Rig | None, truth: dict[str, Floats] | None = None
) -> dict[str, Any]:
    """The oracle's answer about one case.

    Parameters
    ----------
    evidence : of the recording on the nominal rig, with the judging part marked. secret : what was hidden, as a dict.
    extended : the diagnosed rig, or None where the diagnosis failed.
    truth : sensor -> (N,) its reading without noise and counts, SI; needed for unknown physics.

    Returns
    -------
    ``held_out`` : rms of the judging part's residuals of all channels, in units of the floor, of the ``nominal``, the
    ``recalibrated``, the ``extended`` and the ``oracle``'s rig; ``clear`` and ``clear_parameters`` : name -> bool;
    ``unlisted_clear`` : bool; ``seen`` : the figures behind them; ``wall_s``.
    """
    begin = time.perf_counter()
    rig = evidence.nominal
    effects = {(e["location"], e["effect"]): e["parameters"] for e in secret["effects"]}
    recalibrated = fit(evidence, rig, nominal_free(rig))
    best = refit_truth(evidence, effects, secret["parameters"]) if effects else recalibrated
    seen: dict[str, Seen] = {}
    for key in effects:
        others = {k: v for k, v in effects.items() if k != key}
        without = refit_truth(evidence, others, secret["parameters"]) if others else recalibrated
        seen[".".join(key)] = compare(evidence, without.residuals, best.residuals)
    wrong = _wrong_parameters(evidence, secret, best)
    unlisted = _unlisted(evidence, recalibrated, extended, truth) if secret["kind"] == "unknown" else {}
    last = _as_in_the_end(evidence)
    held = {
        "nominal": last.rms(last.residuals(rig)),
        "recalibrated": last.rms(_again(last, {}, recalibrated.rig).residuals),
        "extended": last.rms(last.residuals(extended)) if extended else math.nan,
        "oracle": last.rms(_better(last, _again(last, effects, best.rig), effects, extended).residuals),
    }
    return {
        "held_out": held,
        "clear": {name: s.clear for name, s in seen.items()},
        "clear_parameters": {name: s.clear for name, s in wrong.items()},
        "unlisted_clear": any(s.clear and s.without > UNLISTED_LEFT for s in unlisted.values()),
        "seen": {
            n: {"without": s.without, "with": s.with_it, "t": s.t} for n, s in {**seen, **wrong, **unlisted}.items()
        },
        "wall_s": time.perf_counter() - begin,
    }


def _as_in_the_end(evidence: Evidence) -> Evidence:
    """The evidence of a diagnosis' last fit: only the judging part is held out."""
    judged = judging(evidence)
    records = [
        replace(new, train=old.train | (old.held & ~new.held))
        for old, new in zip(evidence.records, judged.records, strict=True)
    ]
    return replace(judged, records=records)


def _again(evidence: Evidence, effects: Effects, start: Rig) -> Fit:
    """Fit these effects and the nominal parameters, from their values in a rig."""
    values = {key: start.effect(*key) or there for key, there in effects.items()}
    return refit_truth(evidence, values, {n: p.value for n, p in start.config.parameters.items()})


def _better(evidence: Evidence, best: Fit, effects: Effects, extended: Rig | None) -> Fit:
    """The oracle's fit, or a better one from the diagnosed values, if the diagnosed structure is the true one.

    A fit of several effects can get stuck in a local minimum, which would flatter the diagnosis.
    """
    if extended is None or not effects or effects_of_rig(extended).keys() != effects.keys():
        return best
    again = _again(evidence, effects, extended)
    return min(best, again, key=lambda fitted: objective(evidence, fitted))


def refit_truth(evidence: Evidence, effects: Effects, parameters: dict[str, float], pinned: str | None = None) -> Fit:
    """Fit these effects and the nominal parameters, from these values of both; ``pinned`` stays nominal."""
    base = evidence.nominal
    for (place, name), values in effects.items():
        base = base.with_effect(place, name, values)
    free = [f for f in nominal_free(base) if f.name != pinned]
    start = [(parameters.get(f.name, f.centre) - f.centre) / f.scale for f in free]
    for place, name in effects:
        there = base.effect(place, name)
        if there is not None:  # at its neutral value the rig drops it
            more = effect_free(base, place, name, there)
            free, start = free + more, start + [0.0] * len(more)
    return fit(evidence, base, free, np.array(start))


def _wrong_parameters(evidence: Evidence, secret: dict[str, Any], best: Fit) -> dict[str, Seen]:
    """For a case that hides wrong parameters only: each parameter fitted and held at its nominal value."""
    if secret["kind"] != "parameters":
        return {}
    return {
        name: compare(evidence, refit_truth(evidence, {}, secret["parameters"], pinned=name).residuals, best.residuals)
        for name in secret["parameters"]
    }


def _unlisted(
    evidence: Evidence, recalibrated: Fit, extended: Rig | None, truth: dict[str, Floats] | None
) -> dict[str, Seen]:
    """{name of the catalogue's best law: compared with the true one}; empty without the truth."""
    if truth is None:
        return {}
    rivals = {"recalibrated": recalibrated.residuals}
    if extended is not None:
        rivals["diagnosed"] = evidence.residuals(extended)
    listed = candidates(recalibrated.rig, evidence.blocks, evidence.moving)
    for score in bank(evidence, recalibrated, listed)[1][:LAWS_TRIED]:
        key = score.candidate.key
        rivals[".".join(key)] = _again(evidence, {key: score.values}, recalibrated.rig).residuals
    best = min(rivals, key=lambda name: evidence.rms(rivals[name]))
    return {
        best: compare(
            evidence, rivals[best], _noise(evidence, truth), lambda squares: np.log(np.maximum(squares, 1e-300))
        )
    }


def _noise(evidence: Evidence, truth: dict[str, Floats]) -> Residuals:
    """The residuals of the true law: noise and counts of the sensors, in units of the floor."""
    (record,) = evidence.records
    return {
        b.name: [np.column_stack([record.y[c] - truth[c] for c in b.channels]) / evidence.floor[b.name]]
        for b in evidence.blocks
    }


def compare(
    evidence: Evidence, without: Residuals, best: Residuals, measure: Callable[[Floats], Floats] = np.asarray
) -> Seen:
    """The clearest channel, or, if none is clear, the one with the largest t.

    ``measure`` : applied to the mean squares of the stretches before t is taken.
    """
    found = []
    for block in evidence.blocks:
        first = evidence.stretches(without, block.name)
        second = evidence.stretches(best, block.name)
        falls = measure(first) - measure(second)
        errors = falls.std(axis=1, ddof=1) / np.sqrt(falls.shape[1]) + 1e-12
        for channel in range(len(falls)):
            t = float(falls[channel].mean() / errors[channel])
            found.append(Seen(float(first[channel].mean()), float(second[channel].mean()), t))
    return max(found, key=lambda s: (s.clear, s.t))


def described(rig: Rig) -> dict[str, Any]:
    """A diagnosed rig as JSON: values of all parameters, elements, and effects."""
    parameters = {name: p.value for name, p in rig.config.parameters.items()}
    return {"parameters": parameters, "elements": rig.config.elements, "effects": rig.effects}


def rebuilt(nominal: Rig, description: dict[str, Any]) -> Rig:
    """The rig of :func:`described` on the same nominal rig."""
    config = nominal.config
    own = {n: ParameterConfig(v) for n, v in description["parameters"].items() if n not in config.parameters}
    config = replace(config, parameters={**config.parameters, **own}, elements=description["elements"])
    rig = build_rig(config).with_parameters(description["parameters"])
    for place, there in description["effects"].items():
        for name, values in there.items():
            rig = rig.with_effect(place, name, values)
    return rig
