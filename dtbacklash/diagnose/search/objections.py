"""What speaks against a named effect although it fits held-out data.

The free simulation is worse with it, or the held-out error rises with it.
"""

import math
from dataclasses import replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.comparison import lead_of, worst
from dtbacklash.diagnose.fit.errors import free_squares
from dtbacklash.diagnose.fit.free import Errors, Key, as_given, known_free
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import ON, fit
from dtbacklash.diagnose.search.slow_pull import slow_evidence
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Parameter
from dtbacklash.physics.rig import Rig

#: so many times slower a pull has to agree, where a free run says nothing (ratio)
PULL_AGREES_RATIO = 3.0
#: a law may make the free simulation worse by so much by chance: it drifts (ratio of mean squares)
FREE_WORSE_RATIO = 1.2
#: a run that noise or another formulation turns elsewhere, by this share of its error, judges no law (share of the
#: error)
REPEATED_SHARE = 0.5


def spoils_the_free_run(evidence: Evidence, nominal: Fit, fitted: Fit, order: tuple[Key, ...]) -> Key | None:
    """The effect whose removal improves the free simulation most, if that is worse with all effects than with none.

    Such a law only helps while the measurement pulls the simulation along. It is judged among all of them, since
    what is missing beside it may spoil the free run of a law that is right.
    """
    if not order or not any(b.pulled and b.gains[0] > 0.0 for b in evidence.blocks):
        return None  # where nothing is pulled, the comparison is a free simulation itself
    with_all = free_error(evidence, fitted.rig)
    if with_all <= FREE_WORSE_RATIO * free_error(evidence, nominal.rig):
        return None
    if _predicts(evidence, nominal, fitted) or _holds_slowly(evidence, nominal, fitted, order):
        return None
    without = {key: free_error(evidence, as_given(evidence.nominal, fitted.rig, key)) for key in order}
    best = min(without, key=lambda k: without[k])
    return best if without[best] < with_all else None


def _predicts(evidence: Evidence, nominal: Fit, fitted: Fit) -> bool:
    """Whether the effects together leave noise, and take away most of the error under a slower pull as well.

    A carriage on magnets snaps to another cog after the smallest error and stays there, so its free run says nothing.
    A law that only hands the measurement back fails under a third of the pull that it was fitted with.
    """
    if worst(evidence, fitted) > settings().nearly_noise_floors:
        return False
    slower = slow_evidence(evidence, PULL_AGREES_RATIO)
    before, after = (slower.rms(slower.residuals(rig)) ** 2 for rig in (nominal.rig, fitted.rig))
    return slower is not evidence and after < 0.5 * before


def _holds_slowly(evidence: Evidence, nominal: Fit, fitted: Fit, order: tuple[Key, ...]) -> bool:
    """Whether the rig with all effects is no worse than with none if both are pulled slowly, or nobody can know.

    A machine that integrates drifts away after the smallest error of its parameters, so its free run says nothing about
    its laws. The slow pull holds it, but moves nothing that does not move by itself; the nominal parameters are fitted
    under it, and the laws stay. An unstable machine (a motor on top of a cog, an inverted pendulum) goes another way
    after the smallest disturbance, whatever the pull: then nobody can know.
    """
    slow = slow_evidence(evidence)
    if slow is evidence:
        return False
    before, after = (fit(slow, rig, *known_free(slow, rig), rounds=ON) for rig in (nominal.rig, fitted.rig))
    holds = slow.rms(after.residuals) ** 2 <= FREE_WORSE_RATIO * slow.rms(before.residuals) ** 2
    return holds or not _repeats(slow, after, order)


def _repeats(evidence: Evidence, fitted: Fit, order: tuple[Key, ...]) -> bool:
    """Whether a run repeats itself with the sensors' noise added and the laws changed by their formulation error.

    The noise acts on the first state and on the signal that pulls.
    """
    rng, rig = np.random.default_rng(0), fitted.rig
    for key in order:
        entry, values = find(rig.kind_at(key[0]), key[1], key[0]), rig.effect(*key) or {}
        other = 1.0 + settings().formulation_deviations * entry.formulation_error
        rig = rig.with_effect(*key, {**values, entry.size.name: other * values[entry.size.name]})
    pulled = {b.pulled for b in evidence.blocks if b.pulled}
    noisy = [{c: evidence.noise[c][0] * rng.standard_normal(r.samples) for c in pulled} for r in evidence.records]
    records = [
        replace(r, y=r.y | {c: r.y[c] + e for c, e in more.items()})
        for r, more in zip(evidence.records, noisy, strict=True)
    ]  # fmt: skip
    again = replace(evidence, records=records).residuals(rig)
    apart: Residuals = {}
    for block in evidence.blocks:
        added = [
            np.column_stack([more.get(c, np.zeros(len(e))) for c in block.channels]) / evidence.floor[block.name]
            for more, e in zip(noisy, again[block.name], strict=True)
        ]
        apart[block.name] = [
            there - here - more
            for there, here, more in zip(again[block.name], fitted.residuals[block.name], added, strict=True)
        ]
    return evidence.rms(apart) < REPEATED_SHARE * evidence.rms(fitted.residuals)


def free_error(evidence: Evidence, rig: Rig) -> float:
    """Mean square error of the free simulation over all channels and samples, relative to the signals.

    Infinite if it runs away.
    """
    squares = free_squares(evidence, rig)
    total: Floats = np.concatenate(list(squares.values()))
    return float(np.mean(total)) if np.isfinite(total).all() else math.inf


def raises_the_error(evidence: Evidence, nominal: Fit, fitted: Fit, order: tuple[Key, ...]) -> Key | None:
    """The effect whose removal lowers the held-out error significantly, and most; None if there is none.

    The effect that was added last, if all together leave more than the recalibrated rig does.
    """
    if order and lead_of(evidence, fitted.residuals, nominal.residuals).clear:
        return order[-1]
    without = {}
    for key in order:
        residuals = evidence.residuals(as_given(evidence.nominal, fitted.rig, key), fitted.residuals, {key[0]})
        if lead_of(evidence, fitted.residuals, residuals).clear:
            without[key] = evidence.rms(residuals)
    return min(without, key=lambda k: without[k], default=None)


def distance(evidence: Evidence, rig: Rig, key: Key, errors: Errors) -> float:
    """Distance of an effect from where it does nothing, in standard errors; NaN where that is not known.

    The largest over its amplitudes: an effect with two of them does something if either one does.
    """
    return max((d for d in distances(evidence, rig, key, errors).values() if math.isfinite(d)), default=math.nan)


def distances(evidence: Evidence, rig: Rig, key: Key, errors: Errors) -> dict[str, float]:
    """Distance of each fitted amplitude from where it does nothing, in standard errors; NaN where it is not known."""
    entry, values = find(rig.kind_at(key[0]), key[1], key[0]), rig.effect(*key) or {}
    found = {}
    for p in entry.amplitudes:
        if p.name in entry.idle(values):
            continue
        error = errors.get((*key, p.name), math.nan)
        known = math.isfinite(error) and error > 0.0
        found[p.name] = abs(values[p.name] - nothing(evidence, p)) / error if known else math.nan
    return found


def unseen(evidence: Evidence, rig: Rig, key: Key, errors: Errors) -> set[str]:
    """The amplitudes of an effect whose intervals include zero, beside at least one whose interval does not."""
    away = distances(evidence, rig, key, errors)
    seen = {name for name, d in away.items() if d >= settings().away_errors}
    return set(away) - seen if seen else set()


def nothing(evidence: Evidence, size: Parameter) -> float:
    """The value at which an amplitude does nothing; for a limit, the largest command."""
    neutral = size.neutral or 0.0
    return neutral if math.isfinite(neutral) else max(float(np.abs(r.u).max()) for r in evidence.records)
