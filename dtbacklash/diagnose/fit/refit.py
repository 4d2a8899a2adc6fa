"""Fit effects and nominal parameters together, by simulation, with the parameters' priors, in rounds."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.free import Free
from dtbacklash.diagnose.fit.problem import Fit, Problem, inside, limits_of
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig

#: another round follows one that lowers the mean square by this share; near noise, one that lowers minus twice the
#: log-likelihood by more than an additional parameter would by chance (95 % of chi-square)
WORTH_A_ROUND, BY_CHANCE = 0.1, 3.84
#: a bound so many natural steps away does not count in a round
FAR = 10.0


@dataclass(frozen=True)
class Rounds:
    """How thoroughly to fit: coarse rounds, the largest number of fine rounds, and evaluations in each."""

    coarse: int
    fine: int
    evaluations: int = 8


#: a rough fit; a full one; one that starts where another fit ended
QUICK, FULL, ON = Rounds(1, 0, 5), Rounds(1, 8), Rounds(0, 8)


def fit(
    evidence: Evidence,
    base: Rig,
    free: list[Free],
    start: Floats | None = None,
    known: Residuals | None = None,
    rounds: Rounds = FULL,
) -> Fit:
    """Fit the free parameters, in rounds that each take their weights from the end of the last one.

    Fine rounds go on until one gains nothing more, so that fits can be compared.

    start : (free,) x of the free parameters; None: 0. known : residuals of a rig that differs from ``base`` only where
    ``free`` acts, which saves simulating the rest.
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
    """Whether a round has gained enough for another one: see WORTH_A_ROUND and BY_CHANCE."""
    evidence = problem.evidence
    first, second = (_left(problem, residuals) for residuals, _ in (before, after))
    if second > SETTINGS.nearly_noise_floors:
        return second < (1.0 - WORTH_A_ROUND) * first
    gains = [likelihood(evidence, residuals) + float(x[problem.prior] @ x[problem.prior])
             for residuals, x in (before, after)]  # fmt: skip
    return gains[0] - gains[1] > BY_CHANCE


def _left(problem: Problem, residuals: Residuals) -> float:
    """Geometric mean over the channels of the training part's mean square, in units of the floor's."""
    squares = problem.evidence.mean_square(residuals, "train")
    channels = np.concatenate([squares[name] for name in problem.touched])
    return float(np.exp(np.mean(np.log(np.maximum(channels, 1.0)))))


def solve(problem: Problem, x: Floats, evaluations: int) -> Floats:
    """(free,) the best x of a least-squares fit from ``x`` on, also where it ends with an error.

    The solver takes its first trust region from the distance of the start from 0: so its variables start at 1, which is
    a natural step (a tolerance, a factor of e, twice the size). It also scales a variable by the distance of its
    bounds: so distant bounds are left out.
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
    """Minus twice the log-likelihood of a part, with the number of independent samples, plus the priors' penalty."""
    return fitted.penalty + likelihood(evidence, fitted.residuals, part)


def likelihood(evidence: Evidence, residuals: Residuals, part: str = "train") -> float:
    """Minus twice the log-likelihood of a part, with the number of independent samples."""
    total = 0.0
    for block in evidence.blocks:
        rows = evidence.rows(residuals, block.name, part)
        squares = np.mean(rows**2, axis=1)
        above = np.maximum(squares, 1.0)
        share = (above - 1.0) / above
        count = rows.shape[1] / (1.0 + share * (evidence.correlated - 1.0))
        # relative to a residual that is all noise, as the count depends on the residual
        total += float(np.sum(count * (np.log(above) + squares / above - 1.0)))
    return total
