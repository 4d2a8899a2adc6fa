"""Refit: effects and nominal parameters together, by simulation, under the parameters' priors, in rounds."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.free import Free
from dtbacklash.diagnose.fit.problem import Fit, Problem, inside, limits_of
from dtbacklash.diagnose.settings import settings
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig

#: a round is worth another one if it takes away this share of what is left; near noise, if minus twice the
#: log-likelihood falls by more than one parameter more would make it by chance (95 % of chi-square)
WORTH_A_ROUND, BY_CHANCE = 0.1, 3.84
#: a bound so many natural steps away is out of reach of a round
FAR = 10.0


@dataclass(frozen=True)
class Rounds:
    """How thoroughly to fit: rounds by coarse steps, fine ones at most, and evaluations in each."""

    coarse: int
    fine: int
    evaluations: int = 8


#: a look at what a fit would be; a fit; one from where another one ended
QUICK, FULL, ON = Rounds(1, 0, 5), Rounds(1, 8), Rounds(0, 8)


def fit(
    evidence: Evidence,
    base: Rig,
    free: list[Free],
    start: Floats | None = None,
    known: Residuals | None = None,
    rounds: Rounds = FULL,
) -> Fit:
    """Fit the free parameters, in rounds with the weights of where the last round ended.

    Coarse steps are enough to come near. Fine rounds go on until one gains nothing more: what is compared with a fit
    that has not ended, with one effect more or another one, owes its gain to the way that was left.

    ``known`` : residuals of a rig that differs from ``base`` only where ``free`` acts; saves simulating the rest.
    """
    problem = Problem(evidence, base, free, known)
    x = np.zeros(len(free)) if start is None else np.asarray(start, dtype=float)
    if not free:
        return problem.ended(x)
    x = inside(x, limits_of(free))
    problem.steps = "coarse"
    for _ in range(rounds.coarse):
        problem.weigh(problem.residuals(x))
        x = solve(problem, x, rounds.evaluations)
    problem.finely()
    for _ in range(rounds.fine):
        before = problem.residuals(x), x
        problem.weigh(before[0])
        x = solve(problem, x, rounds.evaluations)
        if not _worth_another(problem, before, (problem.residuals(x), x)):
            break
    return problem.ended(x)


def _worth_another(problem: Problem, before: tuple[Residuals, Floats], after: tuple[Residuals, Floats]) -> bool:
    """Whether a round has gained so much that the next one may: far from noise a share of what is left, near it chance.

    There a percent of many samples is decisive; elsewhere it is not, as the law is another one.
    """
    evidence = problem.evidence
    first, second = (_left(problem, residuals) for residuals, _ in (before, after))
    if second > settings().nearly_noise_floors:
        return second < (1.0 - WORTH_A_ROUND) * first
    gains = [likelihood(evidence, residuals) + float(x[problem.prior] @ x[problem.prior])
             for residuals, x in (before, after)]  # fmt: skip
    return gains[0] - gains[1] > BY_CHANCE


def _left(problem: Problem, residuals: Residuals) -> float:
    """Geometric mean over the channels of what is left of the fitted part, in units of the floor's mean square."""
    squares = problem.evidence.mean_square(residuals, "train")
    channels = np.concatenate([squares[name] for name in problem.touched])
    return float(np.exp(np.mean(np.log(np.maximum(channels, 1.0)))))


def solve(problem: Problem, x: Floats, evaluations: int) -> Floats:
    """The least squares from ``x`` on; where the simulation cannot go on, the best that was seen.

    The solver takes its first trust region from how far from 0 it starts, and a fit starts at 0. So it is handed
    variables that start at 1, which is a natural step of all of them: a tolerance, a factor of e, twice the size. It
    weighs a variable by how far its bounds are, too: bounds that are out of reach are none, or the trust region would
    shrink in all variables but in those.
    """
    least, best, shift = np.inf, x, 1.0 - x
    bounds = limits_of(problem.free)
    ends = np.where(np.abs(bounds - x) > FAR, np.copysign(np.inf, bounds), bounds)

    def rows(at: Floats) -> Floats:
        nonlocal least, best
        at = inside(at - shift, bounds)
        there = _guarded(problem.stack(problem.residuals(at), at))
        cost = float(there @ there)
        if cost < least:
            least, best = cost, at
        return there

    def columns(at: Floats) -> Floats:
        return _guarded(problem.jacobian(inside(at - shift, bounds)))

    with suppress(UserError, np.linalg.LinAlgError):
        least_squares(
            rows, x + shift, columns, tuple(ends + shift), max_nfev=evaluations, x_scale="jac", ftol=1e-4, xtol=1e-6
        )
    return best


def _guarded(rows: Floats) -> Floats:
    return rows if np.isfinite(rows).all() else np.nan_to_num(rows, nan=1e6, posinf=1e6, neginf=-1e6)


def objective(evidence: Evidence, fitted: Fit, part: str = "train") -> float:
    """Minus twice the log-likelihood of a part, with as many samples as count, plus the prior's penalty."""
    return fitted.penalty + likelihood(evidence, fitted.residuals, part)


def likelihood(evidence: Evidence, residuals: Residuals, part: str = "train") -> float:
    """Minus twice the log-likelihood of a part, with as many samples as count."""
    total = 0.0
    for block in evidence.blocks:
        rows = evidence.rows(residuals, block.name, part)
        squares = np.mean(rows**2, axis=1)
        above = np.maximum(squares, 1.0)
        share = (above - 1.0) / above
        count = rows.shape[1] / (1.0 + share * (evidence.correlated - 1.0))
        # counted from a residual that is all noise, as the count itself falls with what is not
        total += float(np.sum(count * (np.log(above) + squares / above - 1.0)))
    return total
