"""The least-squares problem of a fit: rows of weighted residuals and Gaussian priors, and their Jacobian.

The likelihood counts the independent samples of a residual: otherwise many correlated samples of a residual that is not
noise would overrule every prior.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Steps, places_of
from dtbacklash.diagnose.data.evidence import RUNAWAY, Evidence, Residuals
from dtbacklash.diagnose.fit.free import Effects, Free, apply, effects_of_rig, penalty_of
from dtbacklash.physics.effects.declare import Role
from dtbacklash.physics.effects.table import bends, table_of
from dtbacklash.physics.rig import Rig

#: columns of the nominal parameters are reused until one of these has moved by so many tolerances
STALE = 0.05
#: a Jacobian is updated within its round while its error is less than this share of a step's change of the rows
MENDED = 0.3
#: step of a finite difference in x: of any parameter, and of a wave number
STEP, STEP_WAVE = 0.03, 1e-3
#: a precise column's step is narrowed by this factor, at most so often, until columns differ by less than this share
NARROW, NARROWER, ALIKE = 0.1, 4, 1e-3
#: narrowing ends where two columns differ so many times more than wider ones did
ROUNDING_GROWS = 3.0
#: distance of a fit from the ends of a parameter's range, in x
INSIDE = 1e-9


@dataclass(frozen=True)
class Fit:
    """A rig whose free parameters have been fitted.

    Attributes
    ----------
    rig : with the fitted values. free, x : the parameters and their values. residuals : in units of the floor.
    penalty : sum of the squared deviations of the nominal parameters in tolerances. weights : per block, (channels,)
        weight of a squared residual in the likelihood.
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
    """Per block, (channels,) the weight of a squared residual: 1 at the floor, far less where it is not noise."""
    weights = {}
    for name, squares in evidence.mean_square(residuals, "train").items():
        above = np.maximum(squares, 1.0)
        share = np.clip((above - 1.0) / above, 0.0, 1.0)  # of the residual that is not noise
        weights[name] = 1.0 / (above * (1.0 + share * (evidence.correlated - 1.0)))
    return weights


class Problem:
    """The least-squares problem of one set of free parameters."""

    def __init__(self, evidence: Evidence, base: Rig, free: list[Free], known: Residuals | None = None) -> None:
        self.evidence, self.base, self.free = evidence, base, free
        self.places = set[str]().union(*(f.places for f in free))
        self.known = known
        rig = apply(base, free, np.zeros(len(free)))
        self.touched = [
            b.name for b in evidence.blocks if known is None or b.name not in known or self.places & places_of(rig, b)
        ]
        self.weights: dict[str, Floats] = {}
        self.steps: Steps = "fine"
        self.prior = np.array([f.prior for f in free])
        self.bent, self.bent_at_0 = _bends(rig, free)
        self._last: dict[tuple[Steps, bytes], Residuals] = {}
        self._kept: dict[int, Floats] = {}
        self._kept_at = np.zeros(0)
        #: of the last Jacobian of this round: parameters, rows, and the Jacobian itself
        self._at: tuple[Floats, Floats, Floats] | None = None

    def weigh(self, residuals: Residuals) -> None:
        """Take the weights of these residuals, also for the reused columns."""
        before, self.weights, self._at = self.weights, weights_for(self.evidence, residuals), None
        if self._kept:
            ratio = np.concatenate([np.sqrt(self.weights[name] / before[name]) for name in self.touched])
            samples = sum(int(r.train.sum()) for r in self.evidence.records)
            scale = np.concatenate([np.repeat(ratio, samples), np.ones(self.priors)])
            self._kept = {j: column * scale for j, column in self._kept.items()}

    @property
    def priors(self) -> int:
        """How many rows are not data: the priors, and what holds a table straight."""
        return int(self.prior.sum()) + len(self.bent_at_0)

    def finely(self) -> None:
        """Simulate finely from now on, with differences to both sides."""
        self.steps, self._kept, self._at = "fine", {}, None

    def residuals(self, x: Floats) -> Residuals:
        """Residuals at x; the last ones are cached."""
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
        """Residuals and rows at x."""
        residuals = self._simulated(x, steps)
        return residuals, self.stack(residuals, x)

    def data(self, residuals: Residuals, name: str) -> Floats:
        """(channels, rows) of one block, each of variance 1 where its residual is the floor's noise."""
        return self.evidence.rows(residuals, name, "train")

    def stack(self, residuals: Residuals, x: Floats) -> Floats:
        """(rows,) whose squares are summed: weighted residuals of the training part, priors, and bends of tables."""
        data = [(self.data(residuals, name) * np.sqrt(self.weights[name])[:, None]).ravel() for name in self.touched]
        return np.concatenate([*data, x[self.prior], self.bent_at_0 + self.bent @ x])

    def jacobian(self, x: Floats) -> Floats:
        """(rows, free) by differences; within a round by Broyden's update (Math. Comp. 19 (1965) 577) if it is good."""
        rows = self._rows(x, self.steps)[1]
        jacobian = self._mended(x, rows)
        if jacobian is None:
            jacobian = self.differences(x)
        self._at = x.copy(), rows, jacobian
        return jacobian

    def _mended(self, x: Floats, rows: Floats) -> Floats | None:
        if self._at is None:
            return None
        there, before, jacobian = self._at
        step, change = x - there, rows - before
        missed = change - jacobian @ step
        size = float(step @ step)
        if size == 0.0 or not float(missed @ missed) < MENDED**2 * float(change @ change):
            return None
        return np.asarray(jacobian + np.outer(missed, step / size))

    def differences(self, x: Floats) -> Floats:
        """(rows, free) Jacobian by finite differences; blocks that a parameter does not touch are not simulated."""
        coarse, rows = self._rows(x, "coarse")
        if self._kept and np.abs(x - self._kept_at)[self.prior].max() > STALE:
            self._kept = {}
        if not self._kept:
            self._kept_at = x.copy()
        columns = np.empty((len(rows), len(self.free)))
        for j, f in enumerate(self.free):
            if j in self._kept:
                columns[:, j] = self._kept[j]
                continue
            both = self.steps == "fine"
            columns[:, j] = self._difference(x, j, (coarse, rows), "coarse", both)(self._step(j))
            if f.prior:  # these are most of the simulations
                self._kept[j] = columns[:, j].copy()
        return columns

    def _difference(
        self, x: Floats, j: int, at: tuple[Residuals, Floats], steps: Steps, both: bool
    ) -> Callable[[float], Floats]:
        """A function step -> column, by a difference to both sides if wanted and within the limits, else to one.

        A side on which the simulation runs away, as that of a spring that softens too much, says nothing of the slope.

        at : residuals and rows at x.
        """
        here, rows = at
        low, high = self.free[j].limits()

        def column(step: float) -> Floats:
            sides = [side for side in (1.0, -1.0) if low <= x[j] + side * step <= high] or [1.0]
            ends: list[tuple[float, Floats]] = []
            for side in sides:
                end, bounded = self._moved(x, j, side * step, here, steps)
                if bounded or (side == sides[-1] and not ends):
                    ends.append((side * step, end))
                if ends and not both:
                    break
            if len(ends) == 2:
                return (ends[0][1] - ends[1][1]) / (2.0 * step)
            return (ends[0][1] - rows) / ends[0][0]

        return column

    def precise_jacobian(self, x: Floats) -> Floats:
        """(rows, free) by central differences, each with a step on which the column does not depend.

        Otherwise directions that only the priors determine (all masses, springs and forces grow alike) would look
        determined.
        """
        at = self._rows(x, "fine")
        return np.column_stack([self._precise(x, j, at) for j in range(len(self.free))])

    def _precise(self, x: Floats, j: int, at: tuple[Residuals, Floats]) -> Floats:
        return _suited(self._difference(x, j, at, "fine", both=True), self._step(j))

    def _step(self, j: int) -> float:
        return STEP_WAVE if self.free[j].role is Role.WAVE else STEP

    def _moved(self, x: Floats, j: int, step: float, here: Residuals, steps: Steps = "fine") -> tuple[Floats, bool]:
        """The rows with one parameter moved, and whether the simulation stays bounded."""
        at = x.copy()
        at[j] += step
        there = self.evidence.residuals(apply(self.base, self.free, at), here, set(self.free[j].places), steps)
        bounded = all(np.abs(rows).max() < RUNAWAY for name in self.touched for rows in there[name])
        return self.stack(there, at), bounded


def _bends(rig: Rig, free: list[Free]) -> tuple[Floats, Floats]:
    """(rows, free) and (rows,) how each table that is fitted bends, in units of its ``bend``: by x, and at x = 0."""
    by_x, at_0 = [np.zeros((0, len(free)))], [np.zeros(0)]
    for place, name in dict.fromkeys((f.place, f.effect) for f in free if f.role is Role.KNOT and not f.prior):
        values = rig.effects[place][name]
        knots, efforts = table_of(values)
        rows = bends(knots) / values["bend"]
        here = [j for j, f in enumerate(free) if (f.place, f.effect) == (place, name)]
        wide = np.zeros((len(rows), len(free)))
        wide[:, here] = rows * [free[j].scale for j in here]
        by_x, at_0 = [*by_x, wide], [*at_0, rows @ efforts]
    return np.concatenate(by_x), np.concatenate(at_0)


def _suited(column: Callable[[float], Floats], step: float) -> Floats:
    """The column by the step, narrowed from ``step``, from which the next narrower one differs least.

    A wide step shows the curvature of the response, a narrow one the ticks to which contacts are located. Dry friction
    is linear up to a step of 0.1 and shows ticks below 0.01; a motor that snaps between teeth is linear up to 1e-5.
    """
    last = best = column(step)
    least = np.inf
    for _ in range(NARROWER):
        step *= NARROW
        there = column(step)
        apart = float(np.linalg.norm(there - last)) / max(float(np.linalg.norm(there)), 1e-300)
        if apart < ALIKE:
            return there
        if apart < least:
            best, least = last, apart
        if apart > ROUNDING_GROWS * least:
            break
        last = there
    return best


def limits_of(free: list[Free]) -> Floats:
    """(2, parameters) lower and upper limits of x."""
    return np.array([f.limits() for f in free]).T


def inside(x: Floats, limits: Floats) -> Floats:
    """x a little inside of its limits: an effect at its neutral value would be dropped from the rig."""
    return np.clip(x, limits[0] + INSIDE, limits[1] - INSIDE)
