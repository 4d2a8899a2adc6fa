"""Standard errors of a fit: from the curvature, and from the variation of the score between stretches of time.

Residuals are correlated (an encoder's counts, unexplained physics), so that the curvature alone gives errors that are
too small: the sandwich of Huber and White over stretches is taken where it is larger. The catalogue adds the error of a
law's formulation.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import Errors, all_free
from dtbacklash.diagnose.fit.problem import Fit, Problem, inside, limits_of
from dtbacklash.diagnose.fit.scaling import unseen_scalings
from dtbacklash.physics.catalogue import find

#: the score's scatter is taken over as many of the stretches that judge: it is correlated for longer (stretches)
ERROR_STRETCHES = 2
#: over at least as many groups, or the scatter is not known itself (groups)
ERROR_GROUPS_MIN = 16

#: steps to both sides along a direction that the recording hardly determines: in tolerances, or as logarithms
WIDE = (0.05, 0.3)
#: so many least determined directions are measured at once, so often, until none changes by more than this share
LEAST_SEEN, PASSES, MOVED = 3, 5, 0.3
#: two wide differences agree that differ by less than this share
AGREE = 0.5
#: standard errors to each side of a 95 % interval
NORMAL95 = 1.96


@dataclass(frozen=True)
class Linear:
    """A fit's problem, linearised at its end ``x``: rows, and their Jacobian by the free parameters."""

    problem: Problem
    x: Floats
    jacobian: Floats
    rows: Floats


def linear(evidence: Evidence, fitted: Fit) -> Linear:
    """A fit's problem, linearised at its end."""
    free, x = all_free(evidence, fitted.rig)
    problem = Problem(evidence, fitted.rig, free)
    problem.weights = fitted.weights
    rows = problem.stack(problem.residuals(x), x)
    if not free:
        return Linear(problem, x, np.zeros((len(rows), 0)), rows)
    # rows of a simulation that diverged do not count
    jacobian, rows = (
        np.nan_to_num(part, nan=0.0, posinf=0.0, neginf=0.0) for part in (problem.precise_jacobian(x), rows)
    )
    return Linear(problem, x, _along_the_least_seen(problem, x, jacobian), rows)


def polished(evidence: Evidence, fitted: Fit) -> tuple[Fit, Linear]:
    """The fit after one more step, by precise differences, if it is better; and its problem, linearised there.

    In directions that only the priors determine, the fit's rough differences do not find the middle of the priors.
    """
    about = linear(evidence, fitted)
    problem = about.problem
    if not problem.free:
        return fitted, about
    x = inside(about.x - inverse(about.jacobian) @ (about.jacobian.T @ about.rows), limits_of(problem.free))
    rows = problem.stack(problem.residuals(x), x)
    if not np.isfinite(rows).all() or rows @ rows >= about.rows @ about.rows:
        return fitted, about
    return problem.ended(x), replace(about, x=x, rows=rows)


def standard_errors(evidence: Evidence, fitted: Fit, about: Linear | None = None) -> Errors:
    """(place, effect, name) -> standard error, in the parameter's unit; ('', '', name) for a nominal one."""
    about = about or linear(evidence, fitted)
    free, x = about.problem.free, about.x
    if not free:
        return {}
    covariance = covariance_of(evidence, about)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    result = {}
    for f, at, error in zip(free, x, errors, strict=True):
        slope = float(f.value(at) if f.log else f.scale)
        counted = _counted(evidence) if f.counted else 0.0
        law = slope * find(fitted.rig.kind_at(f.place), f.effect, f.place).formulation_error if f.effect else 0.0
        result[(f.place, f.effect, f.name)] = math.hypot(slope * float(error), counted, law)
    return result


def _along_the_least_seen(problem: Problem, x: Floats, jacobian: Floats) -> Floats:
    """The Jacobian, measured anew along the directions that the recording determines least.

    Where all forces, masses and springs grow alike nothing changes and the columns cancel, but their errors do not. A
    wide step along such a direction has a smaller error.
    """
    limits = limits_of(problem.free)
    jacobian = jacobian.copy()
    for _ in range(PASSES):
        norms, _, directions = _decomposed(jacobian)
        moved = 0.0
        for unit in directions[::-1][:LEAST_SEEN]:
            step = unit / norms
            size = float(np.abs(step).max())
            before = jacobian @ step
            ends = (size * _difference(problem, x, step / size, h, limits, len(before)) for h in WIDE)
            there = _agreed(before, *ends)
            moved = max(moved, float(np.linalg.norm(there - before)) / max(float(np.linalg.norm(before)), 1e-300))
            jacobian += np.outer(there - before, unit * norms)
        if moved < MOVED:
            break
    return _without_scalings(problem, x, jacobian)


def _without_scalings(problem: Problem, x: Floats, jacobian: Floats) -> Floats:
    """The Jacobian, exactly zero along the directions of :func:`.scaling.unseen_scalings`."""
    data = len(jacobian) - problem.priors
    for direction in unseen_scalings(problem.evidence, problem.base, problem.free, x):
        norms = _norms(jacobian)
        unit = direction * norms / np.linalg.norm(direction * norms)
        jacobian[:data] -= np.outer(jacobian[:data] @ (unit / norms), unit * norms)
    return jacobian


def _agreed(before: Floats, near: Floats, far: Floats) -> Floats:
    """The change along a direction: by the wide steps if they agree, else the smaller one of the other two."""
    if np.isfinite(far).all() and np.linalg.norm(far - near) < AGREE * np.linalg.norm(far):
        return far
    return min((before, near), key=lambda rows: float(rows @ rows))


def _difference(problem: Problem, x: Floats, direction: Floats, wide: float, limits: Floats, rows: int) -> Floats:
    """(rows,) derivative along a direction, by a central difference; infinite where the limits leave no room."""
    ends = [x + sign * wide * direction for sign in (-1.0, 1.0)]
    if any(np.any(end < limits[0]) or np.any(end > limits[1]) for end in ends):
        return np.full(rows, np.inf)
    low, high = (problem.stack(problem.residuals(end), end) for end in ends)
    change: Floats = (high - low) / (2.0 * wide)
    return change


def _counted(evidence: Evidence) -> float:
    """Standard error of a gap because of an encoder's counts, in the encoder's unit.

    At a reversal the turning point is wrong by up to half a count, always outwards, so that it does not average out.
    """
    counts = [evidence.noise[b.imposed][1] for b in evidence.blocks if b.imposed]
    return max(counts, default=0.0) / (2.0 * math.sqrt(12.0))


def _norms(jacobian: Floats) -> Floats:
    """Norms of the columns; 1 for a column of zeros."""
    norms = np.linalg.norm(jacobian, axis=0)
    return np.where(norms > 0.0, norms, 1.0)


def _decomposed(jacobian: Floats) -> tuple[Floats, Floats, Floats]:
    """Norms of the columns; singular values and right singular vectors (rows) of the normalised columns."""
    norms = _norms(jacobian)
    _, sizes, directions = np.linalg.svd(jacobian / norms, full_matrices=False)
    return norms, sizes, directions


def inverse(jacobian: Floats) -> Floats:
    """Inverse of J'J by the singular values of J, whose columns differ by many decades."""
    norms, sizes, directions = _decomposed(jacobian)
    scaled = directions.T / np.maximum(sizes, 1e-12 * sizes[0]) / norms[:, None]
    inverse: Floats = scaled @ scaled.T
    return inverse


def group_sums(evidence: Evidence, scores: Floats) -> Floats:
    """(groups, columns) sums over stretches of the training part of (rows, columns), channel after channel."""
    samples = sum(int(r.train.sum()) for r in evidence.records)
    length = max(2, min(ERROR_STRETCHES * evidence.stretch, samples // ERROR_GROUPS_MIN))
    contributions = scores.reshape(-1, samples, scores.shape[1]).sum(axis=0)
    whole = samples // length * length
    sums: Floats = contributions[:whole].reshape(-1, length, scores.shape[1]).sum(axis=1)
    return sums


def covariance_of(evidence: Evidence, about: Linear) -> Floats:
    """(free, free) covariance of the x of a fit: that of the curvature, as wide as the sandwich where that is wider.

    The sandwich itself has no more directions than there are groups of stretches.
    """
    problem, jacobian, rows = about.problem, about.jacobian, about.rows
    priors = problem.priors
    data, e = jacobian[: len(jacobian) - priors], rows[: len(rows) - priors]
    bread = inverse(jacobian)
    sums = group_sums(evidence, data * e[:, None])
    prior_part = jacobian[len(jacobian) - priors :]
    groups = len(sums)
    small = groups / max(groups - data.shape[1], 1.0)  # each fitted parameter takes up a part of the spread
    meat = min(small, 2.0) * sums.T @ sums + prior_part.T @ prior_part
    sandwich = bread @ meat @ bread
    wider = np.maximum(np.diag(sandwich), np.diag(bread))
    root = np.sqrt(wider / np.maximum(np.diag(bread), 1e-300))
    covariance: Floats = bread * np.outer(root, root)
    np.fill_diagonal(covariance, wider)
    return covariance
