"""The one comparison of two fits, and what a fit leaves.

What a model lacks has an unknown size, which is a nuisance parameter of each channel and stretch: profiled out of the
Gaussian likelihood it leaves n/2 log(mean square) (Box and Tiao, Bayesian Inference in Statistical Analysis, 1973,
section 1.4). So the logarithm of the ratio of what two fits leave, with the floor added to both, is their likelihood
ratio a sample; its scatter between stretches gives its error, whatever is correlated within them (Diebold and Mariano,
J. Bus. Econ. Stat. 13 (1995) 253). Near noise this is the usual test; far from it, it is free of scale.

Two formulations of one law (how a body is held at rest, how steep a stop is) differ by a share of the law's effect,
which the catalogue declares; what they would leave is no lead.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.free import effects_of_rig, is_known, taken_out
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import objective
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.catalogue import find

#: of the fitted part's loss beside the choosing part's in ranking fits: it was fitted to (ratio)
MERIT_TRAIN_WEIGHT = 0.5

#: share of the stretches that has to agree
AGREE = 0.75


class Bar(NamedTuple):
    """How far one fit has to lead another one.

    errors : mean of the stretches in standard errors. ratio : a model from which nothing is missing needs no lead
    beyond its error; where all that is left is missing physics, the other one has to leave so many times its mean
    square.
    """

    errors: float
    ratio: float


#: to earn a place among what is looked at further, and to be told from a name
EARNS, TOLD = Bar(2.0, 1.25), Bar(3.0, 1.7)
#: two fits are compared where they differ: in stretches with this share of their usual rms difference, relative to
#: what they leave
ACTS = 0.2
#: what happens in one or two stretches has to lead by so many errors of the noise: of fifty candidates one does so by
#: chance once in seventy thousand recordings
SELDOM = 5.0
#: other formulations of the laws leave no more than so many floors, mean square
FORMULATION_MAX = 3.0
#: of what an encoder's counts pass on to a channel this much may be fitted by chance
COUNTS = 0.25


@dataclass(frozen=True)
class Lead:
    """By how much one fit leaves less than another one.

    ratio : of the rms that they leave, in the channel that shows it best. t : mean over its standard error, of all
    channels together, with what parameters and priors cost. agree : share of the stretches in which the two differ.
    far : whether the lead is beyond what the part that both of them lack, or another formulation, could turn round.
    clear : whether it is also beyond chance, and nearly everywhere.
    """

    ratio: float
    t: float
    agree: float
    far: bool
    clear: bool


#: per block, (channels,) mean square, in units of the floor's
Squares = dict[str, Floats]


def lead(
    evidence: Evidence,
    behind: Fit,
    ahead: Fit,
    bar: Bar = EARNS,
    part: str = "held",
    allowed: Squares | None = None,
) -> Lead:
    """By how much ``ahead`` leaves less than ``behind`` of a part of the recordings; both have to have ended.

    bar : that the lead has to reach. allowed : what other formulations of the laws of ``behind`` leave.
    """
    more = parameters_of(evidence, ahead) - parameters_of(evidence, behind)
    relief = behind.penalty - ahead.penalty
    return lead_of(evidence, behind.residuals, ahead.residuals, bar, part, allowed, (more, relief))


def lead_of(
    evidence: Evidence, behind: Residuals, ahead: Residuals, bar: Bar = EARNS, part: str = "held",
    allowed: Squares | None = None, cost: tuple[int, float] = (0, 0.0),
) -> Lead:  # fmt: skip
    """The same of what two fits leave. cost : how many more parameters the second has, and how much less its prior."""
    samples = sum(int(getattr(r, part).sum()) for r in evidence.records)
    least, passed, acts = evidence.least(), evidence.passed(), np.zeros(1)
    floors, before, after, slack = [], [], [], []
    for block in evidence.blocks:
        if ahead[block.name] is behind[block.name]:
            continue
        first, second = (evidence.rows(left, block.name, part) for left in (behind, ahead))
        floors.append(least[block.name])
        before.append(evidence.means(first**2, part))
        after.append(evidence.means(second**2, part))
        exact = np.where(least[block.name] > 1.0, least[block.name], 0.0)
        known = allowed[block.name] if allowed else 0.0
        slack.append(np.maximum(COUNTS * passed[block.name] + known, exact))
        both = before[-1] + after[-1] + floors[-1][:, None]
        acts = acts + np.sqrt(evidence.means((first - second) ** 2, part) / both).sum(axis=0)
    if not before or acts.max(initial=0.0) == 0.0:
        return Lead(1.0, 0.0, 0.0, False, False)
    floor, where = np.concatenate(floors)[:, None], acts >= ACTS * acts.mean()
    a, b = (np.concatenate(rows)[:, where] for rows in (before, after))
    ratios = np.log((a + floor) / (b + floor))
    missing = np.maximum(b - floor, 0.0) / (b + floor)
    counts = samples / (1.0 + missing.mean(axis=1) * (evidence.correlated - 1.0))
    price = (cost[1] - cost[0] * np.log(counts)) / counts
    total = ratios.sum(axis=0) + float(price.mean())
    seldom = len(total) <= 2
    t = _in_errors_of_noise(evidence, behind, ahead, part) if seldom else float(in_errors(total))
    beyond = (ratios - np.log(1.0 + (bar.ratio - 1.0) * missing)).mean(axis=1) + price
    far = bool(np.any((beyond > 0.0) & ((a - b).mean(axis=1) + price > np.concatenate(slack))))
    best = int(np.argmax(beyond))
    agree = float(np.mean(total > 0.0))
    clear = far and t > (SELDOM if seldom else bar.errors) and agree >= AGREE
    return Lead(math.exp(0.5 * float(ratios[best].mean())), t, agree, far, clear)


def ratio_in_each(evidence: Evidence, behind: Fit, ahead: Fit) -> tuple[float, ...]:
    """Of each recording the ratio of the rms that two fits leave there, as :attr:`Lead.ratio`."""
    number, found = evidence.recordings_of_stretches("used"), []
    a, b = (
        np.concatenate([evidence.stretches(f.residuals, block.name, "used") for block in evidence.blocks]) + 1.0
        for f in (behind, ahead)
    )
    for one in np.unique(number):
        found.append(float(np.exp(0.5 * np.log(a / b)[:, number == one].mean(axis=1).max())))
    return tuple(found)


def alike(evidence: Evidence, best: Fit, other: Fit, bar: Bar = EARNS) -> bool:
    """Whether the recordings can hardly tell two fits: the better one leads neither clearly nor by much."""
    ahead = lead(evidence, other, best, bar)
    return not ahead.clear and ahead.ratio < math.sqrt(bar.ratio)


def parameters_of(evidence: Evidence, fitted: Fit) -> int:
    """How many parameters a fit's effects have beside the nominal rig's."""
    rig = evidence.nominal
    return sum(
        find(rig.kind_at(place), name, place).counts for place, name in fitted.effects
        if not is_known(fitted.rig, (place, name))
    )  # fmt: skip


def _in_errors_of_noise(evidence: Evidence, behind: Residuals, ahead: Residuals, part: str) -> float:
    """How much nearer ``ahead`` is to a part than it would be if ``behind`` left noise alone, in its errors.

    For what happens too seldom to show in several stretches. Two models differ by d. If the first is true and leaves
    white noise e of variance s, the sum of squares falls by 2 e d - d^2, whose mean is -|d|^2 and whose standard
    deviation is 2 sqrt(s) |d|, however seldom they differ. What is above the floor is correlated, and counts as often
    less.
    """
    fall = energy = 0.0
    for block in evidence.blocks:
        first, second = (evidence.rows(left, block.name, part) for left in (behind, ahead))
        level = np.maximum(np.mean(second**2, axis=1), 1.0)
        level *= 1.0 + (level - 1.0) / level * (evidence.correlated - 1.0)
        fall += float(np.sum((first**2 - second**2) / level[:, None]))
        energy += float(np.sum((first - second) ** 2 / level[:, None]))
    return (fall + energy) / (2.0 * np.sqrt(energy)) if energy > 0.0 else 0.0


def held_loss(evidence: Evidence, fitted: Fit) -> float:
    """Root mean square of the held-out residuals of all channels, in units of the floor."""
    return evidence.rms(fitted.residuals)


def in_errors(differences: Floats) -> Floats:
    """(...,) means over the last axis in their standard errors, comparable whatever the number of stretches.

    The mean of few stretches in units of its own spread is large by chance: it becomes what is as unlikely, by
    Student's distribution, of as many stretches as are usual. 0 of fewer than two.
    """
    count, usual = differences.shape[-1], SETTINGS.paired_stretches
    if count < 2:
        return np.zeros(differences.shape[:-1])
    t: Floats = differences.mean(axis=-1) / (differences.std(axis=-1, ddof=1) / np.sqrt(count) + 1e-12)
    if count >= usual:
        return t
    likely: Floats = np.sign(t) * student.isf(student.sf(np.abs(t), count - 1), usual - 1)
    return likely


def worst(evidence: Evidence, fitted: Fit, heard: dict[str, list[int]] | None = None) -> float:
    """Largest held-out mean square of a fit in these channels of blocks, or in all, in units of the floor's."""
    squares = evidence.mean_square(fitted.residuals, "held")
    if heard is None:
        return max(float(of_block.max()) for of_block in squares.values())
    return max(float(squares[name][channels].max()) for name, channels in heard.items())


def is_noise(evidence: Evidence, fitted: Fit) -> bool:
    """Whether a fit leaves nothing but noise of what is held out."""
    squares, least = evidence.mean_square(fitted.residuals, "held"), evidence.least()
    return all(bool(np.all(squares[n] < SETTINGS.noise_floors * least[n])) for n in squares)


def merit(evidence: Evidence, trial_fit: Fit) -> float:
    """What the best of several fits is least in: minus twice the held-out log-likelihood, and the prior's penalty."""
    weight = MERIT_TRAIN_WEIGHT
    return objective(evidence, trial_fit, "held") + weight * objective(evidence, trial_fit, "train")


def other_formulations(
    evidence: Evidence, fitted: Fit, left_out: dict[tuple[str, str], Residuals], part: str = "held"
) -> dict[str, Floats]:
    """Per block, (channels,) mean square that they would leave, in units of the floor's.

    left_out : per effect, what is left without it.
    """
    here = evidence.mean_square(fitted.residuals, part)
    total = {name: np.zeros(len(squares)) for name, squares in here.items()}
    for (place, effect), residuals in left_out.items():
        error = find(evidence.nominal.kind_at(place), effect, place).formulation_error
        share = (SETTINGS.formulation_deviations * error) ** 2
        for name, squares in evidence.mean_square(residuals, part).items():
            total[name] += share * np.maximum(squares - here[name], 0.0)
    return {name: np.minimum(squares, FORMULATION_MAX) for name, squares in total.items()}


def formulations(evidence: Evidence, fitted: Fit) -> Squares:
    """What other formulations of all laws of a fit would leave, a few floors at most."""
    left_out = {
        key: evidence.residuals(taken_out(fitted.rig, key), fitted.residuals, {key[0]})
        for key in effects_of_rig(fitted.rig)
    }
    return other_formulations(evidence, fitted, left_out)
