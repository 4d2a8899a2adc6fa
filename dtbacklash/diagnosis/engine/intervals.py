"""What the values of a fitted rig may be off by: from the curvature, and from how the score varies between stretches.

What no model explains is systematic, so that the curvature alone gives errors that are too small: the sandwich of Huber
and White over stretches of time is taken where it is wider. The catalogue adds the error of a law's formulation.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy import special

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.fit import LADDER, FitProblem, FittedModel
from dtbacklash.diagnosis.engine.least_squares import STEP_MAX
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.parameters import Errors, FreeParameter, Key, apply, unit_of
from dtbacklash.diagnosis.engine.predictor import Gains
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.parallel import spread
from dtbacklash.diagnosis.plot_data import Profile
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Role
from dtbacklash.physics.effects.table import VALUES

#: what people call a parameter, of all recordings or of one
Label = Callable[[str, int | None], str]
#: standard errors to each side of a 95 % interval
NORMAL95 = 1.96
#: stretches over which the score's scatter is taken
STRETCHES = 24
#: a stretch that alone shows a parameter is left out by at least so much of the curvature (share)
ALONE = 0.25
#: the least determined directions are measured once more, so many, until none changes by more than this share
LEAST_SEEN, PASSES, MOVED = 3, 5, 0.3
#: steps to both sides: what they change all innovations by at most (norm), and along a direction a parameter (x)
CHANGE, WIDE = 10.0, 0.05
#: values of a profile to each side of the best one, how far it reaches (standard errors), and steps of each fit
PROFILE_POINTS, PROFILE_REACH, PROFILE_STEPS = 5, 3.0, 10
#: steps by precise differences, until all of one is below so much (standard errors)
POLISHED, NEAR = 3, 0.1


@dataclass(frozen=True)
class Values:
    """A model's values and what they may be off by.

    Attributes
    ----------
    free : the free parameters, about the model's own values. x : (free,) where the model stands. jacobian, rows :
    (rows, free) and (rows,) of whitened innovations, then of priors and of how tables bend. covariance : (free, free)
    of x, of the curvature and as wide as the sandwich where that is wider. errors : (place, effect, name) -> standard
    error in the parameter's unit, with that of the law's formulation; ('', '', name) of a nominal one; what
    belongs to one recording by its label.
    """

    free: tuple[FreeParameter, ...]
    x: Floats
    jacobian: Floats = field(repr=False)
    rows: Floats = field(repr=False)
    covariance: Floats = field(repr=False)
    errors: Errors = field(repr=False)

    def of_table(self, table: Key) -> Floats:
        """(KNOTS, KNOTS) covariance of a table's values, in their unit."""
        here = {f.name: j for j, f in enumerate(self.free) if f.key == table}
        js = [here[name] for name in VALUES]
        scales = np.array([self.free[j].scale for j in js])
        covariance: Floats = self.covariance[np.ix_(js, js)] * np.outer(scales, scales)
        return covariance


def values(segments: Segments, motion: Motion, model: FittedModel) -> Values:
    """What the values of a model may be off by; nominal parameters are believed as they are given."""
    problem = _problem(segments, motion, model, 1.0)
    x, gains = problem.start(), segments.gains(model.rig, model.noise_levels)
    rows = problem.residuals(x, gains)
    if rows is None or not problem.free:
        nothing = np.zeros(0) if rows is None else rows
        n = len(problem.free)
        return Values(tuple(problem.free), x, np.zeros((len(nothing), n)), nothing, np.full((n, n), np.nan), {})
    led = problem.leads(x, gains, kept=problem.dear)
    jacobian = _along_the_least_seen(problem, x, gains, _columns(problem, x, gains, rows, led), led)
    covariance = covariance_of(jacobian, rows, stretches(segments))
    return Values(tuple(problem.free), x, jacobian, rows, covariance, _errors(model, problem.free, x, covariance))


def _errors(model: FittedModel, free: Sequence[FreeParameter], x: Floats, covariance: Floats) -> Errors:
    """Standard errors in the parameters' units, with those of how laws are formulated."""
    errors = {}
    for f, xi, variance in zip(free, x, np.diag(covariance), strict=True):
        slope = abs(float(f.per_x(xi)))
        law = slope * find(model.rig.kind_at(f.place), f.effect, f.place).formulation_error if f.effect else 0.0
        errors[f.place, f.effect, f.label] = math.hypot(slope * math.sqrt(max(float(variance), 0.0)), law)
    return errors


def polished(segments: Segments, motion: Motion, model: FittedModel) -> tuple[FittedModel, Values]:
    """A model after steps by precise differences, its sizes and priors as they are, while it is likelier; its values.

    A fit ends where a step by rough differences brings little: in directions that are hardly seen, standard errors off.
    segments : in fine steps (:attr:`.Segments.fine`) where intervals count. Rough times of sticking and slipping make
    innovations jump: noise in their differences, by which a direction that changes nothing seems to be seen.
    """
    problem = _problem(segments, motion, model, model.stiff)
    model = _at(problem, model, problem.start()) or model
    found = values(segments, motion, model)
    for _ in range(POLISHED):
        problem = _problem(segments, motion, model, model.stiff)
        own = np.ones(len(found.rows))
        own[problem.innovation_rows : problem.innovation_rows + problem.priors] = problem.weights
        jacobian, rows = found.jacobian * own[:, None], found.rows * own
        if not found.errors:
            break
        step = -inverse(jacobian) @ (jacobian.T @ rows)
        if np.all(np.abs(step) < NEAR * np.sqrt(np.diag(found.covariance))):
            break
        better = _at(problem, model, found.x + np.clip(step, -STEP_MAX, STEP_MAX))
        if better is None or not better.loss < model.loss:
            break
        model = better
        found = values(segments, motion, model)
    return model, _over_horizons(segments, motion, model, found)


def _over_horizons(segments: Segments, motion: Motion, model: FittedModel, found: Values) -> Values:
    """The same values, as uncertain as they differ at a longer horizon of the predictor, too.

    A right model has the same values at any horizon. What it lacks is systematic: it pulls alike in every stretch, so
    that no scatter shows it, but it pulls more the less the readings correct the rig.
    """
    problem = _problem(segments, motion, model, model.stiff)
    far, squares = problem.gauss_newton(segments.scaled(model.noise_levels, LADDER[0]), found.x, 2)
    if not found.errors or not np.isfinite(squares):
        return found
    covariance = found.covariance + np.outer(far - found.x, far - found.x)
    return replace(found, covariance=covariance, errors=_errors(model, found.free, found.x, covariance))


@dataclass(frozen=True, eq=False)
class Profiles:
    """The profile likelihoods of a model's parameters, each computed where it is asked for.

    found : the values of the model on these segments. titles : as people read them -> :attr:`.FreeParameter.title`.
    units : the same -> unit, SI.
    """

    segments: Segments
    motion: Motion
    model: FittedModel
    found: Values
    titles: Mapping[str, str]
    units: Mapping[str, str]

    def __call__(self, title: str) -> Profile:
        """The likelihood along one parameter, all others fitted anew at each value, at the model's noise levels.

        Venzon and Moolgavkar, Appl. Statist. 37 (1988) 87.

        Raises
        ------
        UserError : there is no such parameter, the recording says nothing of it, or the rig is not finite beside it.
        """
        if title not in self.titles:
            raise UserError("profile", title, f"choose one of {', '.join(self.titles)}")
        j = next(k for k, f in enumerate(self.found.free) if f.title == self.titles[title])
        f, variance = self.found.free[j], float(self.found.covariance[j, j])
        if not 0.0 < variance < math.inf:
            raise UserError("profile", title, "a parameter that the recording shows")
        steps = PROFILE_REACH * math.sqrt(variance) * np.linspace(-1.0, 1.0, 2 * PROFILE_POINTS + 1)
        along = self.found.covariance[:, j] / variance  # how the others move with it, to first order
        costs = {}
        for step in steps.tolist():
            x = self.found.x + step * along
            value = f.centre + f.scale * float(x[j]) if f.role is Role.ANGLE else f.value(float(x[j]))
            if f.role is Role.ANGLE or f.low < value < f.high or not step:
                costs[value] = self._pinned(x, j)
        kept = {value: cost for value, cost in sorted(costs.items()) if math.isfinite(cost)}
        if len(kept) < PROFILE_POINTS:
            raise UserError("profile", title, "a parameter beside whose value the rig can be simulated")
        rises = np.array(list(kept.values())) - min(kept.values())
        error = self.found.errors[f.place, f.effect, f.label]
        return Profile(title, np.array(list(kept)), rises, f.value(float(self.found.x[j])), error)

    def _pinned(self, x: Floats, j: int) -> float:
        """-2 log likelihood with priors, one parameter as in x, and all others fitted anew from there."""
        model, free = self.model, self.found.free
        try:
            moved = replace(model, rig=apply(model.rig, [free[j]], x[j : j + 1]))
            problem = _problem(self.segments, self.motion, moved, 1.0)
            if [f.title for f in problem.free] != [f.title for f in free]:
                return math.inf  # the effect is nothing there
            problem.hold(j)
            _, squares = problem.gauss_newton(model.noise_levels, np.delete(x, j), PROFILE_STEPS)
            logs = sum(g.logs for g in self.segments.gains(problem.base, model.noise_levels))
        except (UserError, np.linalg.LinAlgError):
            return math.inf
        return squares + logs + (float(x[j]) ** 2 if free[j].prior else 0.0)


def profiles(segments: Segments, motion: Motion, model: FittedModel, found: Values, label: Label) -> Profiles:
    """The profiles of what is free in a model, but the values of tables.

    label : (title without a recording, its number or None) -> the title as people read it.
    """
    free = [f for f in found.free if f.name not in VALUES]
    titles = {label(f.shared_title, f.recording): f.title for f in free}
    units = {label(f.shared_title, f.recording): unit_of(segments.nominal, f) for f in free}
    return Profiles(segments, motion, model, found, titles, units)


def _problem(segments: Segments, motion: Motion, model: FittedModel, stiff: float) -> FitProblem:
    """The values of a model about itself; what came to nothing in its rig has none."""
    keys = [key for key in model.keys if model.rig.effect(*key) is not None]
    return FitProblem(segments, model.rig, keys, motion, stiff, model.smooth)


def _at(problem: FitProblem, model: FittedModel, x: Floats) -> FittedModel | None:
    """The model at other values; None where its simulation does not run."""
    segments = problem.segments
    try:
        rig = problem.rig(x)
        gains = segments.gains(rig, model.noise_levels)
        likelihood = sum(p.likelihood(rig, g) for p, g in zip(segments.predictors, gains, strict=True))
    except (UserError, np.linalg.LinAlgError):
        return None
    return problem.model(x, model.noise_levels, likelihood)


def stretches(segments: Segments, number: int = STRETCHES) -> list[slice]:
    """About so many equal stretches of the rows that are innovations; none reaches into another recording."""
    samples = [len(p.readings.y) for p in segments.predictors]
    found, first = [], 0
    for p, n in zip(segments.predictors, samples, strict=True):
        channels = p.readings.y.shape[1]
        ends = np.linspace(0, n, max(1, round(number * n / sum(samples))) + 1).astype(int)
        found += [slice(first + a * channels, first + b * channels) for a, b in pairwise(ends.tolist())]
        first += n * channels
    return found


def covariance_of(jacobian: Floats, rows: Floats, parts: Sequence[slice]) -> Floats:
    """(free, free) covariance: that of the curvature, as wide as the sandwich where that is wider.

    parts : stretches of the rows that are innovations; the others, of priors, follow. The sandwich is the jackknife
    over the stretches (MacKinnon, White, J. Econometrics 29 (1985) 305): what a fit without each would have moved by.
    It has no more directions than there are stretches, so that it only widens the curvature's; and a normal interval
    made of it is as wide as Student's.
    """
    data, n = parts[-1].stop, len(parts)
    roots = _roots(jacobian)
    bread = roots @ roots.T
    curved = np.diag(bread)
    beside = jacobian[data:] @ roots
    meat = beside.T @ beside
    if n > 1:
        sums = np.array([_left_out(jacobian[at] @ roots, rows[at]) for at in parts])
        # at the optimum the sums add up to what the priors pull: their scatter counts, not their mean
        sums -= sums.mean(axis=0)
        student = float(special.stdtrit(n - 1, 0.975) / special.ndtri(0.975))
        meat = meat + student**2 * (n - 1.0) / n * sums.T @ sums
    wider = np.maximum(np.einsum("ij,jk,ik->i", roots, meat, roots), curved)
    root = np.sqrt(wider / np.maximum(curved, 1e-300))
    covariance: Floats = bread * np.outer(root, root)
    return covariance


def _left_out(jacobian: Floats, rows: Floats) -> Floats:
    """(free,) score of a stretch, larger by what it pulls the fit itself; both in directions of unit curvature."""
    pulls, directions = np.linalg.eigh(jacobian.T @ jacobian)
    score = directions.T @ (jacobian.T @ rows)
    found: Floats = directions @ (score / np.maximum(1.0 - pulls, ALONE))
    return found


def inverse(jacobian: Floats) -> Floats:
    """Inverse of J'J by the singular values of J, whose columns differ by many decades."""
    roots = _roots(jacobian)
    found: Floats = roots @ roots.T
    return found


def _roots(jacobian: Floats) -> Floats:
    """(free, free) whose square is the inverse of J'J: a direction of unit curvature a column."""
    norms, sizes, directions = _decomposed(jacobian)
    found: Floats = directions.T / np.maximum(sizes, 1e-12 * sizes[0]) / norms[:, None]
    return found


def _decomposed(jacobian: Floats) -> tuple[Floats, Floats, Floats]:
    """Norms of the columns, 1 for one of zeros; singular values and right singular vectors (rows) of the normalised."""
    norms = np.linalg.norm(jacobian, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    # by QR first: the rows are many, the columns few
    _, sizes, directions = np.linalg.svd(np.linalg.qr(jacobian / norms, mode="r"))
    return norms, sizes, directions


def _columns(
    problem: FitProblem, x: Floats, gains: Sequence[Gains], rows: Floats, led: dict[str, Floats]
) -> Floats:  # fmt: skip
    """(rows, free) Jacobian by central differences, by one side only where a value stands at its end or is dear.

    led : columns by what parameters add to each sample, for the sizes of steps.
    """
    found = np.zeros((len(rows), len(x)))

    def fill(j: int) -> None:
        f = problem.free[j]
        # over the usual step of a fit the innovations of a light resonance bend by more than what is unseen adds up to
        rough = float(np.linalg.norm(led[f.title] if f.title in led else problem.sensitivity(j, x, gains, rows)))
        h = min(f.step, CHANGE / max(rough, 1e-300))
        ends: dict[float, Floats] = {}
        for sign in (-1.0, 1.0):
            if ends and problem.dear and f.title in led:
                continue
            z = x.copy()
            z[j] += sign * h
            there = (
                problem.residuals(z, gains, f.recording, rows)
                if f.role is Role.ANGLE or f.low < f.value(z[j]) < f.high
                else None
            )
            if there is not None:
                ends[sign] = there
        if ends:
            low, high = ends.get(-1.0, rows), ends.get(1.0, rows)
            found[:, j] = (high - low) / (len(ends) * h)

    some = spread if problem.dear else map
    list(some(fill, range(len(x))))
    return found


def _along_the_least_seen(
    problem: FitProblem, x: Floats, gains: Sequence[Gains], jacobian: Floats, led: dict[str, Floats]
) -> Floats:
    """The Jacobian, measured anew along the directions that the recording determines least.

    Where all forces, masses and springs grow alike nothing changes and the columns cancel, but the errors of their
    differences do not, and hide the direction. The columns of what each parameter adds to a sample, carried on by the
    linear part, have no such errors: they show it. A difference along such a direction has none either.
    """
    rough = jacobian.copy()
    for title, column in led.items():
        rough[: len(column), [f.title for f in problem.free].index(title)] = column
    for turn in range(PASSES):
        norms, _, directions = _decomposed(jacobian if turn else rough)
        moved = 0.0
        for unit in directions[::-1][:LEAST_SEEN]:
            step = unit / norms
            before = jacobian @ step
            h = min(WIDE / float(np.abs(step).max()), CHANGE / max(float(np.linalg.norm(before)), 1e-300))
            low, high = problem.residuals(x - h * step, gains), problem.residuals(x + h * step, gains)
            if low is None or high is None:
                continue
            there = (high - low) / (2.0 * h)
            moved = max(moved, float(np.linalg.norm(there - before)) / max(float(np.linalg.norm(before)), 1e-300))
            # a difference that is larger has met a corner or an end
            if there @ there < before @ before:
                jacobian = jacobian + np.outer(there - before, unit * norms)
        if turn and moved < MOVED:
            break
    return jacobian
