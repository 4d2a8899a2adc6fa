"""Refit: effects and nominal parameters together, by simulation, under the parameters' priors.

The nominal parameters are free within their tolerances: the prior of each is Gaussian, and the likelihood counts as
many independent samples as the residual has, not as many as were taken; otherwise 30 000 correlated samples of a
residual that is not noise would overrule every prior.
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.compare import Steps, places_of
from dtbacklash.diagnose.evidence import Evidence, Residuals
from dtbacklash.diagnose.free import Effects, Free, apply, effects_of_rig, penalty_of
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Role
from dtbacklash.physics.rig import Rig

#: the Jacobian's columns of the nominal parameters serve until one of these has moved by as many tolerances
STALE = 0.05
#: a column's step is made ten times smaller so often, until two differ by less than this share of them
SMALLER_STEPS, SAME_COLUMN = 3, 1e-4
#: where the difference of two steps' columns grows by more with the next one, they show the contacts' last tick
TICKS_GROW = 3.0
#: a delay is moved by at least so much of a sample, unless its logarithm would by more than this
DELAY_STEP_SAMPLES, DELAY_STEP_MAX = 0.05, 0.5


@dataclass(frozen=True)
class Fit:
    """A rig whose free parameters have been fitted.

    Attributes
    ----------
    rig : with the fitted values. free, x : the parameters and where they ended. residuals : in units of the floor.
    penalty : sum of the squared deviations of the nominal parameters in tolerances. weights : per block (channels,)
        what one squared residual weighs in the likelihood.
    """

    rig: Rig
    base: Rig
    free: list[Free]
    x: Floats
    residuals: Residuals
    penalty: float
    weights: dict[str, Floats]

    @property
    def effects(self) -> Effects:
        """The effects of the rig by place and name."""
        return effects_of_rig(self.rig)


def weights_for(evidence: Evidence, residuals: Residuals) -> dict[str, Floats]:
    """Per block, (channels,) the weight of a squared residual: 1 at the floor, and far below where it is not noise."""
    mean = evidence.mean_square(residuals, "train")
    least = evidence.correlated
    result = {}
    for name, squares in mean.items():
        above = np.maximum(squares, 1.0)
        share = np.clip((above - 1.0) / above, 0.0, 1.0)  # of the residual that is not noise
        result[name] = 1.0 / (above * (1.0 + share * (least - 1.0)))
    return result


class Problem:
    """The least-squares problem of one set of free parameters."""

    def __init__(self, evidence: Evidence, base: Rig, free: list[Free], known: Residuals | None = None) -> None:
        self.evidence, self.base, self.free = evidence, base, free
        everything = set().union(*(f.places for f in free)) if free else set()
        self.places = everything
        self.known = known
        rig = apply(base, free, np.zeros(len(free)))
        self.touched = [
            b.name for b in evidence.blocks if known is None or b.name not in known or everything & places_of(rig, b)
        ]
        self.weights: dict[str, Floats] = {}
        self.fine = False
        self.steps: Steps = "fine"
        self.prior = np.array([f.prior for f in free])
        self._last: dict[tuple[Steps, bytes], Residuals] = {}
        self._kept: dict[int, Floats] = {}
        self._kept_at = np.zeros(0)

    def weigh(self, residuals: Residuals) -> None:
        """Take the weights of these residuals; the columns that are kept take them, too."""
        before, self.weights = self.weights, weights_for(self.evidence, residuals)
        if self._kept:
            ratio = np.concatenate([np.sqrt(self.weights[name] / before[name]) for name in self.touched])
            samples = sum(int(r.train.sum()) for r in self.evidence.records)
            scale = np.concatenate([np.repeat(ratio, samples), np.ones(int(self.prior.sum()))])
            self._kept = {j: column * scale for j, column in self._kept.items()}

    def residuals(self, x: Floats) -> Residuals:
        """Residuals at x; the last ones are remembered."""
        return self._simulated(x, self.steps)

    def ended(self, x: Floats) -> Fit:
        """The fit that ends at x."""
        residuals, rig = self._simulated(x, "fine"), apply(self.base, self.free, x)
        penalty, weights = penalty_of(rig, self.evidence.nominal), weights_for(self.evidence, residuals)
        return Fit(rig, self.base, self.free, x, residuals, penalty, weights)

    def _simulated(self, x: Floats, steps: Steps) -> Residuals:
        key = steps, x.tobytes()
        if key not in self._last:
            there = self.evidence.residuals(apply(self.base, self.free, x), self.known, self.places, steps)
            self._last = {at: kept for at, kept in self._last.items() if at[0] != steps} | {key: there}
        return self._last[key]

    def _rows(self, x: Floats, steps: Steps) -> tuple[Residuals, Floats]:
        """Residuals at x, and the rows made of them."""
        residuals = self._simulated(x, steps)
        return residuals, self.stack(residuals, x)

    def stack(self, residuals: Residuals, x: Floats) -> Floats:
        """The rows whose squares are summed: weighted residuals of the training part, then the priors."""
        rows = []
        for name in self.touched:
            part = self.evidence.rows(residuals, name, "train")
            rows.append((part * np.sqrt(self.weights[name])[:, None]).ravel())
        rows.append(x[self.prior])
        return np.concatenate(rows)

    def jacobian(self, x: Floats) -> Floats:
        """Forward differences; blocks that a parameter does not touch are not simulated."""
        here, start = self._rows(x, "fine") if any(map(self._late, self.free)) else ({}, np.zeros(0))
        coarse, coarse_start = self._rows(x, "coarse")
        if self._kept and np.abs(x - self._kept_at)[self.prior].max() > STALE:
            self._kept = {}
        if not self._kept:
            self._kept_at = x.copy()
        columns = np.empty((len(coarse_start), len(self.free)))
        for j, f in enumerate(self.free):
            if j in self._kept:
                columns[:, j] = self._kept[j]
                continue
            step = self._difference(j, x[j], self.fine)
            if self._late(f):
                columns[:, j] = (self._moved(x, j, step, here) - start) / step
            else:
                columns[:, j] = (self._moved(x, j, step, coarse, "coarse") - coarse_start) / step
            if f.prior:  # these are most of the simulations
                self._kept[j] = columns[:, j].copy()
        return columns

    def precise_jacobian(self, x: Floats) -> Floats:
        """Central differences, of each parameter by a step at which they do not depend on it.

        Directions that only the priors determine (all masses, springs and forces grow alike) show as such only if
        neither the contacts' last tick nor the curvature of the response is in the differences: a motor that snaps from
        tooth to tooth answers linearly to a hundred thousandth, dry friction only to a hundredth.
        """
        return np.column_stack([self._column(x, j) for j in range(len(self.free))])

    def _column(self, x: Floats, j: int) -> Floats:
        """One column: of the steps tried the one from which a smaller one differs least."""
        step = self._difference(j, x[j], True)
        found, apart = [self._central(x, j, step)], np.inf
        for _ in range(0 if self._late(self.free[j]) else SMALLER_STEPS):
            step *= 0.1
            found.append(self._central(x, j, step))
            before, apart = apart, float(np.linalg.norm(found[-1] - found[-2]))
            if apart > before:  # what is left are the contacts' ticks, which weigh as much more as the step is smaller
                return found[-2] if apart < TICKS_GROW * before else found[-3]
            if apart < SAME_COLUMN * float(np.linalg.norm(found[-1])):
                break
        return found[-1]

    def _central(self, x: Floats, j: int, step: float) -> Floats:
        """Central difference of one column; to one side where the other one has no room."""
        low, high = self.free[j].limits()
        here = self._simulated(x, "fine")
        room = min(high - x[j], x[j] - low)
        if room < abs(step):
            return (self._moved(x, j, step, here) - self.stack(here, x)) / step
        return (self._moved(x, j, step, here) - self._moved(x, j, -step, here)) / (2.0 * step)

    def _difference(self, j: int, x: float, fine: bool) -> float:
        """Step of a difference; a delay moves by many of the ticks that it is rounded to."""
        f = self.free[j]
        step = _step(f, x, fine)
        if not self._late(f):
            return step
        slope = abs(f.value(x)) if f.log else f.scale
        least = DELAY_STEP_SAMPLES * self.evidence.records[0].sample_time_s / max(slope, 1e-300)
        wide = float(np.clip(least, abs(step), DELAY_STEP_MAX))
        return -wide if step < 0.0 or x + wide > f.limits()[1] else wide

    def _late(self, free: Free) -> bool:
        """Whether it is of a delay, which is rounded to ticks of a substep."""
        return bool(free.effect) and isinstance(
            find(self.base.kind_at(free.place), free.effect, free.place).slot, slots.Late
        )

    def _moved(self, x: Floats, j: int, step: float, here: Residuals, steps: Steps = "fine") -> Floats:
        """The rows with one parameter moved."""
        at = x.copy()
        at[j] += step
        there = self.evidence.residuals(apply(self.base, self.free, at), here, set(self.free[j].places), steps)
        return self.stack(there, at)


def _step(free: Free, x: float, fine: bool) -> float:
    """Step of a difference: of a nominal parameter about 5e-4 of its value, of an effect's 1e-2, or fine 1e-3.

    Large enough that contacts found a tick earlier or later do not show in it. The larger one looks across the small
    valleys that sticking and slipping make; the fine one is small enough that a motor which snaps from tooth to tooth
    answers linearly.
    """
    high = free.limits()[1]
    step = 1e-3 if free.effect and (fine or free.role is Role.WAVE) else 1e-2
    return -step if x + step > high else step


def fit(
    evidence: Evidence,
    base: Rig,
    free: list[Free],
    start: Floats | None = None,
    known: Residuals | None = None,
    rounds: int = 2,
    evaluations: int = 8,
) -> Fit:
    """Fit the free parameters; ``rounds`` times with the weights of where the last round ended, the last one finely.

    Coarse steps are enough to come near.

    ``known`` : residuals of a rig that differs from ``base`` only where ``free`` acts; saves simulating the rest.
    """
    problem = Problem(evidence, base, free, known)
    x = np.zeros(len(free)) if start is None else np.asarray(start, dtype=float)
    bounds = np.array([f.limits() for f in free]).reshape(-1, 2).T
    x = np.clip(x, bounds[0] + 1e-9, bounds[1] - 1e-9) if free else x
    for k in range(rounds if free else 0):
        problem.fine = 0 < k == rounds - 1
        problem.steps = "fine" if problem.fine else "coarse"
        problem.weigh(problem.residuals(x))
        x = _solve(problem, x, bounds, evaluations)
    return problem.ended(x)


def _solve(problem: Problem, x: Floats, bounds: Floats, evaluations: int) -> Floats:
    """The least squares from ``x`` on; where the simulation cannot go on, the best that was seen.

    The solver takes its first trust region from how far from 0 it starts, and a fit starts at 0. So it is handed
    variables that start at 1, which is a natural step of all of them: a tolerance, a factor of e, twice the size.
    """
    least, best, shift = np.inf, x, 1.0 - x

    def rows(at: Floats) -> Floats:
        nonlocal least, best
        at = at - shift
        there = _guarded(problem.stack(problem.residuals(at), at))
        cost = float(there @ there)
        if cost < least:
            least, best = cost, at
        return there

    def columns(at: Floats) -> Floats:
        return _guarded(problem.jacobian(at - shift))

    with suppress(UserError, np.linalg.LinAlgError):
        least_squares(
            rows, x + shift, columns, tuple(bounds + shift), max_nfev=evaluations, x_scale="jac", ftol=1e-4, xtol=1e-6
        )
    return best


def _guarded(rows: Floats) -> Floats:
    return np.nan_to_num(rows, nan=1e6, posinf=1e6, neginf=-1e6)


def objective(evidence: Evidence, fitted: Fit, part: str = "train") -> float:
    """Minus twice the log-likelihood of a part, with as many samples as count, plus the prior's penalty."""
    total = fitted.penalty
    for block in evidence.blocks:
        rows = evidence.rows(fitted.residuals, block.name, part)
        squares = np.mean(rows**2, axis=1)
        above = np.maximum(squares, 1.0)
        share = (above - 1.0) / above
        count = rows.shape[1] / (1.0 + share * (evidence.correlated - 1.0))
        # counted from a residual that is all noise, as the count itself falls with what is not
        total += float(np.sum(count * (np.log(above) + squares / above - 1.0)))
    return total
