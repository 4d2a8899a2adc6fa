"""What a fit is worth: what it leaves of the held-out part, and whether it has earned what it has more than another."""

import numpy as np

from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.refit import Fit, objective

#: standard errors that the held-out loss has to fall by, in the paired test over stretches
T_MIN = 2.0
#: least share of the held-out excess over the floor that an effect has to take away, and of the floor itself
SHARE_MIN, FLOOR_MIN = 0.2, 0.015
#: what the counts of an encoder pass on to a channel may be fitted by chance: this share of it is not earned
BY_CHANCE = 0.25
#: what happens seldom falls in few stretches: not significant over all, but sure where this share of it is gone
SURE = 0.9
#: as much of the prior's penalty (in -2 log) makes up for no gain on held-out data
PENALTY_MIN = 15.0
#: less than this share of the nominal rig's mean square is minor; a residual below this one is nearly noise
MINOR, NEARLY_NOISE = 2e-3, 2.0
#: less than this one is what another formulation of a large effect makes, even where nearly noise is left
NEGLIGIBLE = 1e-5
#: two fits are the same where their held-out losses differ by less than this share and not significantly
SAME = 0.02


def held_loss(evidence: Evidence, fitted: Fit) -> float:
    """Root mean square of the held-out residuals of all channels, in units of the floor."""
    return evidence.rms(fitted.residuals)


def paired(evidence: Evidence, before: Fit, after: Fit) -> tuple[float, float, float]:
    """(share, floor share, t) of the fall of the held-out loss, in the block and channels that it concerns.

    share : of the excess over the floor. floor share : in units of the floor. t : in standard errors over stretches.
    """
    falls, excess, worth = [], [], []
    least, passed = evidence.least(), evidence.passed()
    for block in evidence.blocks:
        if after.residuals[block.name] is before.residuals[block.name]:
            continue
        first = evidence.stretches(before.residuals, block.name)
        second = evidence.stretches(after.residuals, block.name)
        mean = np.maximum(first.mean(axis=1), 1.0)
        falls.append((first - second) / mean[:, None])
        fall = (first - second).mean(axis=1) - BY_CHANCE * passed[block.name]
        # an exact sensor's channel has to fall by what the method itself leaves
        worth.append(float(np.max(np.where((least[block.name] > 1.0) & (fall < least[block.name]), 0.0, fall))))
        excess.append(np.maximum(first.mean(axis=1) - 1.0, FLOOR_MIN) / mean)
    if not falls:
        return 0.0, 0.0, 0.0
    d = np.concatenate(falls).sum(axis=0)
    error = float(np.std(d, ddof=1) / np.sqrt(len(d))) + 1e-12
    total = float(np.concatenate(excess).sum())
    return float(d.mean()) / total, max(worth), float(d.mean()) / error


def earns(evidence: Evidence, before: Fit, after: Fit, nominal: Fit) -> bool:
    """Whether ``after`` has earned what it has more than ``before``.

    What is small against the mismatch of the nominal rig is believed only where it brings the residual down to the
    noise; elsewhere it may as well mend the form of an effect that has been named. What is tiny never is.
    """
    share, floor, t = paired(evidence, before, after)
    relief = before.penalty - after.penalty
    names = [b.name for b in evidence.blocks if after.residuals[b.name] is not before.residuals[b.name]]
    seldom = share > SURE and floor > 1.0 and _worst(evidence, after, names) < NEARLY_NOISE
    if share > SHARE_MIN and floor > FLOOR_MIN and (t > T_MIN or seldom):
        least = NEGLIGIBLE if _worst(evidence, after, names) < NEARLY_NOISE else MINOR
        return floor > least * _worst(evidence, nominal, names)
    return relief > PENALTY_MIN and share > -SHARE_MIN / 4


def _worst(evidence: Evidence, fitted: Fit, names: list[str]) -> float:
    """Largest held-out mean square of a fit in these blocks, in units of the floor's."""
    squares = evidence.mean_square(fitted.residuals, "held")
    return max(float(squares[n].max()) for n in names)


def merit(evidence: Evidence, trial_fit: Fit) -> float:
    """What the best of several fits is least in: minus twice the held-out log-likelihood, and the prior's penalty."""
    return objective(evidence, trial_fit, "held") + 0.5 * objective(evidence, trial_fit, "train")


def same(evidence: Evidence, chosen: Fit, rival: Fit) -> bool:
    """Whether this recording cannot tell a rival from what was chosen."""
    if rival.penalty - chosen.penalty > PENALTY_MIN:
        return False
    first, second = held_loss(evidence, chosen), held_loss(evidence, rival)
    t = paired(evidence, rival, chosen)[2]
    return second < first * (1.0 + SAME) or (t < T_MIN and second < first * (1.0 + 5 * SAME))


def nearly(evidence: Evidence, best: Fit, simpler: Fit) -> bool:
    """Whether what ``best`` gains on ``simpler`` is less than a parameter more has to earn."""
    if simpler.penalty - best.penalty > PENALTY_MIN:
        return False
    return same(evidence, best, simpler) or paired(evidence, simpler, best)[0] < SHARE_MIN
