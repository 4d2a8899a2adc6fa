"""What a fit leaves of the held-out part, and whether it earns what it has more than another fit.

Two formulations of one law (how a body is held at rest, how steep a stop is) differ by a share of the law's effect,
which the catalogue declares; what they would leave counts as explained.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.free import effects_of_rig, taken_out
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import objective
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import SENSOR_PREFIX

#: stretches over which two fits are compared, standard errors of their mean, and the share of them that agree
STRETCHES, ERRORS, AGREE = 12, 3.0, 0.75
#: a model that nothing real is missing from needs no lead beyond its error; where all that is left is missing physics,
#: the other one has to leave so many times its mean square, as the missing part could favour either of them
RATIO = 1.7
#: two fits are compared where they differ: in stretches with this share of the usual difference
ACTS = 0.1


@dataclass(frozen=True)
class Lead:
    """By how much one fit leaves less than another one.

    What a model lacks has an unknown size, which is a nuisance parameter of each channel and stretch: profiled out of
    the Gaussian likelihood it leaves n/2 log(mean square) (Box and Tiao, Bayesian Inference in Statistical Analysis,
    1973, section 1.4). So the logarithm of the ratio of what two fits leave, with the floor added to both, is their
    likelihood ratio a sample; its scatter between stretches gives its error (Diebold and Mariano, J. Bus. Econ. Stat.
    13 (1995) 253), whatever is correlated within them.

    ratio : of the rms that they leave, in the channel that shows it best. t : mean over its standard error, of all
    channels together. agree : share of the stretches, of those in which the two differ. clear : whether the lead is
    beyond chance and beyond what the part that both of them lack could turn round.
    """

    ratio: float
    t: float
    agree: float
    clear: bool


def lead(evidence: Evidence, behind: Fit, ahead: Fit, part: str = "used") -> Lead:
    """By how much ``ahead`` leaves less than ``behind`` of a part of the recordings; both have to have ended."""
    samples = sum(int(getattr(r, part).sum()) for r in evidence.records)
    length = max(samples // STRETCHES, 1)
    left, differ = [], []
    for block in evidence.blocks:
        first, second = (evidence.rows(f.residuals, block.name, part) for f in (behind, ahead))
        left += list(zip(*(_means(rows**2, length) for rows in (first, second)), strict=True))
        differ.append(_means((first - second) ** 2, length).sum(axis=0))
    acts = np.sum(differ, axis=0)
    where = acts >= ACTS * acts.mean()
    ratios = np.array([np.log((a[where] + 1.0) / (b[where] + 1.0)) for a, b in left])
    best = int(np.argmax(ratios.mean(axis=1)))
    total = ratios.sum(axis=0)
    t = float(in_errors(total)) if len(total) > 2 else _in_errors_of_noise(evidence, behind, ahead, part)
    rest = float(left[best][1][where].mean())
    missing = max(rest - 1.0, 0.0) / (rest + 1.0)
    far = float(ratios[best].mean()) > math.log(1.0 + (RATIO - 1.0) * missing)
    agree = float(np.mean(total > 0.0))
    clear = t > ERRORS and agree >= AGREE and far and total.mean() > 0.0
    return Lead(math.exp(0.5 * float(ratios[best].mean())), t, agree, bool(clear))


def _means(rows: Floats, length: int) -> Floats:
    """(channels, stretches) means of (channels, samples) over stretches of a length."""
    whole = rows.shape[1] // length * length
    means: Floats = rows[:, :whole].reshape(len(rows), -1, length).mean(axis=2)
    return means


def held_loss(evidence: Evidence, fitted: Fit) -> float:
    """Root mean square of the held-out residuals of all channels, in units of the floor."""
    return evidence.rms(fitted.residuals)


def paired(evidence: Evidence, before: Fit, after: Fit) -> tuple[float, float, float]:
    """(share, floor share, t) of the fall of the held-out loss, in the block and channels that it concerns.

    share : of the excess over the floor, there or in what was fitted to, whichever is more: where something else
    happens that leaves most, a small part of it may be all that can be mended. floor share : in units of the floor.
    t : see :func:`significance`.
    """
    everywhere = _all_channels(evidence, before.residuals, after.residuals)
    return _paired(evidence, before, after, _concerned(evidence, before, after, everywhere))


def _paired(evidence: Evidence, before: Fit, after: Fit, heard: dict[str, list[int]]) -> tuple[float, float, float]:
    """The same in these channels of blocks."""
    falls, excess, worth = [], [], []
    least, passed = evidence.least(), evidence.passed()
    compared = _compared(evidence, before.residuals, after.residuals, heard)
    for name, first, second in compared:
        fall = (first - second).mean(axis=1)
        relative, over = _relative(first.mean(axis=1), fall)
        falls.append(relative)
        excess.append(over)
        worthy, exact = fall - settings().earn_counts_share * passed[name][heard[name]], least[name][heard[name]]
        # an exact sensor's channel has to fall by what the method itself leaves
        worth.append(float(np.max(np.where((exact > 1.0) & (worthy < exact), 0.0, worthy))))
    if not falls:
        return 0.0, 0.0, 0.0
    share = max(sum(falls) / sum(excess), _fitted_share(evidence, before, after, heard))
    return share, max(worth), _significance(compared)


def _concerned(evidence: Evidence, before: Fit, after: Fit, everywhere: dict[str, list[int]]) -> dict[str, list[int]]:
    """Of all channels per block (``everywhere``), those that the effects reach by which two fits differ.

    What a sensor does wrong is heard in its own channel alone, unless it drives or pulls a block. Others move a little
    with it, as all parameters are fitted anew: what is left there has nothing to do with it.
    """
    places = {place for place, _ in before.effects.keys() ^ after.effects.keys()}
    loud = {SENSOR_PREFIX + channel for b in evidence.blocks for channel in (b.imposed, b.pulled) if channel}
    if not places or any(p in loud or not p.startswith(SENSOR_PREFIX) for p in places):
        return everywhere
    own = {
        b.name: [j for j, c in enumerate(b.channels) if SENSOR_PREFIX + c in places]
        for b in evidence.blocks if b.name in everywhere
    }  # fmt: skip
    return {name: channels for name, channels in own.items() if channels}


def _all_channels(evidence: Evidence, before: Residuals, after: Residuals) -> dict[str, list[int]]:
    """All channels of the blocks that differ."""
    return {b.name: list(range(len(b.channels))) for b in evidence.blocks if after[b.name] is not before[b.name]}


def _fitted_share(evidence: Evidence, before: Fit, after: Fit, heard: dict[str, list[int]]) -> float:
    """Share of the excess over the floor that falls in what was fitted to, in these channels of blocks."""
    falls, excess = 0.0, 0.0
    first, second = (evidence.mean_square(fitted.residuals, "train") for fitted in (before, after))
    for name, channels in heard.items():
        relative, over = _relative(first[name][channels], (first[name] - second[name])[channels])
        falls, excess = falls + relative, excess + over
    return falls / excess


def _relative(before: Floats, fall: Floats) -> tuple[float, float]:
    """A fall of mean squares, and their excess over the floor, each relative to them and summed over the channels."""
    mean = np.maximum(before, 1.0)
    return float(np.sum(fall / mean)), float(np.sum(np.maximum(before - 1.0, settings().earn_floors) / mean))


def significance(evidence: Evidence, before: Residuals, after: Residuals) -> float:
    """Fall of the held-out loss, summed over the channels that differ, in standard errors over stretches.

    Of the loss or of its logarithm, whichever says more. Of the loss itself the few stretches in which it is largest
    say nearly all: of a law that takes away all of it nobody could be sure. Of the logarithm the quiet stretches say as
    much as the others, in which a model that is wrong may come nearer by chance.
    """
    return _significance(_compared(evidence, before, after, _all_channels(evidence, before, after)))


def rises(evidence: Evidence, before: Residuals, after: Residuals) -> bool:
    """Whether the held-out error rises, by more than chance and by as much as would have to be earned."""
    rise = evidence.rms(after) ** 2 - evidence.rms(before) ** 2
    return rise > settings().earn_floors and significance(evidence, before, after) < -settings().earn_errors


def _significance(compared: list[tuple[str, Floats, Floats]]) -> float:
    least = settings().numerical_error_share ** 2
    falls, ratios = [], []
    for _, first, second in compared:
        falls.append(((first - second) / np.maximum(first.mean(axis=1), 1.0)[:, None]).sum(axis=0))
        ratios.append(np.log(np.maximum(first, least) / np.maximum(second, least)).sum(axis=0))
    return max((float(in_errors(np.sum(d, axis=0))) for d in (falls, ratios) if d), default=0.0)


def in_errors(differences: Floats) -> Floats:
    """(...,) means over the last axis in their standard errors, comparable whatever the number of stretches.

    The mean of few stretches in units of its own spread is large by chance: it becomes what is as unlikely, by
    Student's distribution, of as many stretches as are usual. 0 of fewer than two.
    """
    count, usual = differences.shape[-1], settings().paired_stretches
    if count < 2:
        return np.zeros(differences.shape[:-1])
    t: Floats = differences.mean(axis=-1) / (differences.std(axis=-1, ddof=1) / np.sqrt(count) + 1e-12)
    if count >= usual:
        return t
    likely: Floats = np.sign(t) * student.isf(student.sf(np.abs(t), count - 1), usual - 1)
    return likely


def _compared(
    evidence: Evidence, before: Residuals, after: Residuals, heard: dict[str, list[int]]
) -> list[tuple[str, Floats, Floats]]:
    """Per block its name, and (channels, stretches) mean squares before and after, of the channels that are heard."""
    return [
        (name, evidence.stretches(before, name)[channels], evidence.stretches(after, name)[channels])
        for name, channels in heard.items()
    ]


def earns(evidence: Evidence, before: Fit, after: Fit, nominal: Fit) -> bool:
    """Whether ``after`` has earned what it has more than ``before``.

    What is small against the mismatch of the nominal rig is believed only where it brings the residual down to the
    noise, or takes away most of what is left; elsewhere it may as well mend the form of an effect that has been named.
    What is tiny only where no other formulation of the laws that are there already would make as much; and where one of
    the nominal rig's own laws would make all of the mismatch, nothing else does that leaves more than noise.
    """
    rules = settings()
    everywhere = _all_channels(evidence, before.residuals, after.residuals)
    heard = _concerned(evidence, before, after, everywhere)
    share, floor, t = _paired(evidence, before, after, heard)
    relief = before.penalty - after.penalty
    if heard != everywhere and merit(evidence, after) >= merit(evidence, before):
        return False
    nearly_noise = bool(heard) and worst(evidence, after, heard) < rules.nearly_noise_floors
    promises = share > rules.earn_excess_share and floor > rules.earn_floors
    if promises and (t > rules.earn_errors or (nearly_noise and _is_no_chance(evidence, before, after, heard))):
        sure = nearly_noise or share > rules.decisive_share
        mismatch = worst(evidence, nominal, heard)
        if not nearly_noise and mismatch < formulation_floors(evidence, nominal):
            return False
        if floor > (rules.negligible_share if sure else rules.minor_share) * mismatch:
            return True
        return sure and floor > formulation_floors(evidence, before)
    if relief <= rules.earn_penalty:
        return False
    return _paired(evidence, before, after, everywhere)[0] > -rules.earn_penalty_loss_share


def _is_no_chance(evidence: Evidence, before: Fit, after: Fit, heard: dict[str, list[int]]) -> bool:
    return in_errors_of_noise(evidence, before, after, heard) > settings().earn_seldom_errors


def _in_errors_of_noise(evidence: Evidence, before: Fit, after: Fit, part: str) -> float:
    everywhere = {b.name: list(range(len(b.channels))) for b in evidence.blocks}
    return in_errors_of_noise(evidence, before, after, everywhere, part)


def in_errors_of_noise(
    evidence: Evidence, before: Fit, after: Fit, heard: dict[str, list[int]], part: str = "held"
) -> float:
    """How much nearer ``after`` is to what is held out than it would be if ``before`` left noise alone, in its errors.

    Two models differ by d. If the first is true and leaves white noise e of variance s, the sum of squares falls by
    2 e d - d^2, whose mean is -|d|^2 and whose standard deviation is 2 sqrt(s) |d|, however seldom they differ.
    Stretches do not say that: a resonance that a chirp passes once lies in few of them. What is above the floor is
    correlated, and counts as often less.
    """
    fall = energy = 0.0
    for name, channels in heard.items():
        first, second = (evidence.rows(f.residuals, name, part)[channels] for f in (before, after))
        level = np.maximum(np.mean(second**2, axis=1), 1.0)
        level *= 1.0 + (level - 1.0) / level * (evidence.correlated - 1.0)
        fall += float(np.sum((first**2 - second**2) / level[:, None]))
        energy += float(np.sum((first - second) ** 2 / level[:, None]))
    return (fall + energy) / (2.0 * np.sqrt(energy)) if energy > 0.0 else 0.0


def worst(evidence: Evidence, fitted: Fit, heard: dict[str, list[int]] | None = None) -> float:
    """Largest held-out mean square of a fit in these channels of blocks, or in all, in units of the floor's."""
    squares = evidence.mean_square(fitted.residuals, "held")
    if heard is None:
        return max(float(of_block.max()) for of_block in squares.values())
    return max(float(squares[name][channels].max()) for name, channels in heard.items())


def is_noise(evidence: Evidence, fitted: Fit) -> bool:
    """Whether a fit leaves nothing but noise of what is held out."""
    squares, least = evidence.mean_square(fitted.residuals, "held"), evidence.least()
    return all(bool(np.all(squares[n] < settings().noise_floors * least[n])) for n in squares)


def merit(evidence: Evidence, trial_fit: Fit) -> float:
    """What the best of several fits is least in: minus twice the held-out log-likelihood, and the prior's penalty."""
    weight = settings().merit_train_weight
    return objective(evidence, trial_fit, "held") + weight * objective(evidence, trial_fit, "train")


def same(evidence: Evidence, chosen: Fit, rival: Fit) -> bool:
    """Whether this recording cannot tell a rival from what was chosen."""
    rules = settings()
    if rival.penalty - chosen.penalty > rules.earn_penalty:
        return False
    first, second = held_loss(evidence, chosen), held_loss(evidence, rival)
    t = paired(evidence, rival, chosen)[2]
    if second < first * (1.0 + rules.same_loss_share):
        return True
    return t < rules.earn_errors and second < first * (1.0 + rules.same_uncertain_share)


def nearly(evidence: Evidence, best: Fit, simpler: Fit) -> bool:
    """Whether what ``best`` gains on ``simpler`` is less than a parameter more has to earn."""
    if simpler.penalty - best.penalty > settings().earn_penalty:
        return False
    return same(evidence, best, simpler) or paired(evidence, simpler, best)[0] < settings().earn_excess_share


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
        share = (settings().formulation_deviations * error) ** 2
        for name, squares in evidence.mean_square(residuals, part).items():
            total[name] += share * np.maximum(squares - here[name], 0.0)
    return total


def formulation_floors(evidence: Evidence, fitted: Fit) -> float:
    """What other formulations of all laws of a fit would leave in the worst channel, in units of the floor's."""
    left_out = {
        key: evidence.residuals(taken_out(fitted.rig, key), fitted.residuals, {key[0]})
        for key in effects_of_rig(fitted.rig)
    }
    return max(float(v.max()) for v in other_formulations(evidence, fitted, left_out).values())
