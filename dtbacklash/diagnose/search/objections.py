"""What speaks against a named effect although it fits held-out data.

Under a slower pull the rig is worse with it, or the held-out error rises with it.
"""

import math

import numpy as np

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import lead_of
from dtbacklash.diagnose.fit.free import Errors, Key, as_given
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.search.slow_pull import slower
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Parameter
from dtbacklash.physics.rig import Rig

#: so many times slower a pull has to agree (ratio)
PULL_AGREES_RATIO = 3.0


def hands_back(evidence: Evidence, nominal: Fit, fitted: Fit, order: tuple[Key, ...]) -> Key | None:
    """The effect whose removal helps most under a slower pull, if there the recalibrated rig leads the one with all.

    A law that only hands the measurement back fails under a third of the pull that it was fitted with. It is judged
    among all of them, since what is missing beside it may spoil the run of a law that is right.
    """
    slow = slower(evidence, PULL_AGREES_RATIO)
    if not order or slow is evidence:
        return None  # where nothing is pulled, the comparison is a free simulation itself
    with_all = slow.residuals(fitted.rig)
    if not lead_of(slow, with_all, slow.residuals(nominal.rig)).clear:
        return None
    without = {key: slow.rms(slow.residuals(as_given(evidence.nominal, fitted.rig, key))) for key in order}
    best = min(without, key=lambda k: without[k])
    return best if without[best] < slow.rms(with_all) else None


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
    seen = {name for name, d in away.items() if d >= SETTINGS.away_errors}
    return set(away) - seen if seen else set()


def nothing(evidence: Evidence, size: Parameter) -> float:
    """The value at which an amplitude does nothing; for a limit, the largest command."""
    neutral = size.neutral or 0.0
    return neutral if math.isfinite(neutral) else max(float(np.abs(r.u).max()) for r in evidence.records)
