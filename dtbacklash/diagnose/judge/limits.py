"""How large an effect that was not found could still be: what the recording would have shown.

The last bank holds a signature of each effect that is left, about the last fit and with what the nominal parameters
could take up taken out of it. The residual's share along a signature, with its standard error, bounds the effect's
size, as a law changes the output in proportion to its size while that is small. Its other parameters (an absorber's
frequency, a stop's clearance) stand where the bank thought most of them: elsewhere the bound may be another one.
"""

import math

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import unit_at
from dtbacklash.diagnose.fit.intervals import NORMAL95, group_sums
from dtbacklash.diagnose.propose.locate import Score
from dtbacklash.diagnose.result import Limit
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.physics.effects.declare import Parameter

#: of a signature that is left beside what the parameters can do, less is the simulation's own error (share of the
#: norm)
LIMIT_KEPT_SHARE = 3e-3

#: further from the size of its signature than this, a law is not taken to be proportional to its size
EXTRAPOLATED_MAX = 30.0


def limits(model: Model, log: Log) -> tuple[Limit, ...]:
    """For each effect that was asked about last and not found, a 95 % bound on its size, or that it cannot be seen."""
    if not log.banks:
        return ()
    asked = log.banks[-1]
    left = sorted((s for s in asked.scores if s.candidate.key not in model.keys), key=lambda s: s.candidate.key)
    return tuple(_limit(asked.evidence, score, asked.residual) for score in left)


def _limit(evidence: Evidence, score: Score, residual: Floats) -> Limit:
    place, name = score.candidate.key
    size = score.candidate.effect.size
    unit = unit_at(evidence.nominal, place, size.unit)
    share, error = share_along(evidence, score.signature, residual, LIMIT_KEPT_SHARE * score.whole)
    at = score.made_at[size.name]
    others = {name: value for name, value in score.made_at.items() if name != size.name}
    if size.neutral == 0.0:
        bound = _upper(share, error, at, size)
        return Limit(place, name, size.name, unit, others, upper95=bound)
    # less is more (a saturation): what the signature was made at, or anything below it, would have been seen
    excluded = share + NORMAL95 * error < 1.0
    return Limit(place, name, size.name, unit, others, lower95=at if excluded else None)


def _upper(share: float, error: float, at: float, size: Parameter) -> float | None:
    """Largest magnitude of a size within 95 %; None where the recording does not bound it."""
    both = size.low < 0.0
    most = abs(share) if both else max(share, 0.0)
    factor = most + NORMAL95 * error
    bound = factor * abs(at)
    widest = max(abs(size.low), abs(size.high)) if both else size.high
    return bound if factor < EXTRAPOLATED_MAX and bound < widest else None


def share_along(evidence: Evidence, signature: Floats, residual: Floats, least: float = 0.0) -> tuple[float, float]:
    """The residual's share along a signature, and its standard error.

    signature, residual : (rows,) weighted, channel after channel, then the rows of the priors. The error is that of
    white rows, or what the sums over stretches show where that is more, as residuals are correlated. Where the samples
    hold a norm of the signature below ``least``, the parameters take up all of it, and what is left is the simulation's
    own error: then their priors bound it, of which each is strained by one standard deviation.
    """
    samples = sum(int(r.train.sum()) for r in evidence.records)
    rows = len(residual) // samples * samples
    strained, away = signature[rows:], residual[rows:]
    signature, residual = signature[:rows], residual[:rows]
    norm = float(signature @ signature)
    if norm <= least**2:
        strain = float(strained @ strained)
        return (float(strained @ away) / strain, 1.0 / math.sqrt(strain)) if strain > 0.0 else (0.0, math.inf)
    share = float(signature @ residual) / norm
    rest = residual - share * signature
    white = norm * float(rest @ rest) / len(rest)
    sums = group_sums(evidence, (signature * rest)[:, None])
    return share, math.sqrt(max(white, float(np.sum(sums**2)))) / norm
