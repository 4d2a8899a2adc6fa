"""What a wrong model does to an estimate: the gap, fitted again with what may be wrong, and its standard error.

Method. The output error is linear in the coefficients of the structure's polynomials: with F = pole/(s + pole) it is
``e = v(psi)' R``, where R are the powers of F applied to q3, to theta_d, to the direction of q3's motion (for dry
friction at a mass), and a constant. psi says what may be wrong: stiffness and damping (their logarithms), the
pitch, compliance of the screw, an offset between the two sensors (or the screw's local pitch error), dry friction at
each mass. Each has a prior N(0, sigma_i^2) from :class:`Tolerances`. Gap, start, growth and psi are fitted together
by Gauss-Newton, ``min |e|^2 / s^2 + sum psi_i^2 / sigma_i^2``; the gap's standard error is the root of its element
of the inverse of ``J J'/s^2 + diag(1/sigma_i^2)``. The noise s^2 is the power of what is left at low frequency
(:meth:`.Problem.noise_m2`). So a wrong stiffness, which the residual shows, costs the gap nothing, and friction,
which looks like a gap, as much as the residual leaves open. Where the plain fit leaves less than rounding
(``FLOOR_DEG``), nothing can hide in it, and the estimate and its error stay those of the plain fit.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dtbacklash.control.chain import (
    StructureParameters,
    structure_matrices,
    structure_polynomials,
    tridiagonal_determinant,
)
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.estimate import Estimate, Problem, linear_step
from dtbacklash.twin.gap.observer import in_lags, sampled_path

Array = NDArray[np.float64]

STEPS = 12  # Gauss-Newton steps, each halved until it helps
HALVINGS = 4
CONVERGED = 0.01  # a step of the gap in its standard errors after which there is no further one
STATIONARY = 0.5  # a step of the gap in its standard errors that is left at most
DIFFERENCE = 1e-5  # of a parameter for a derivative of the coefficients, in its standard deviations


@dataclass(frozen=True)
class Tolerances:
    """How wrong a model may be, one standard deviation each.

    stiffness, damping: relative; that of their ratios to the masses, in which alone they show (twice the rig's own
    tolerances: what is concealed from a twin is not drawn from its data sheet). pitch: relative, locally (0.015: a
    pitch error of 5 um once a turn). compliance: of the screw, relative to that of the first link (0.05: 5e-6 m/N).
    offset_m: between the zeros of both sensors, or the screw's local pitch error (5 um: a rolled screw).
    friction_m: dry friction at a mass, by what it moves the last mass at rest (20 um: 0.1 N behind two springs of
    1e4 N/m, a well lubricated slide). growth_deg_s: of the gap.
    presliding_m: motion that turns friction round, above a position sensor's noise.
    """

    stiffness: float = 0.2
    damping: float = 0.3
    pitch: float = 0.015
    compliance: float = 0.05
    offset_m: float = 5e-6
    friction_m: float = 20e-6
    growth_deg_s: float = 2.0
    presliding_m: float = 4e-6

    def deviations(self, masses: int) -> Array:
        """(5 + masses,) standard deviations of psi."""
        first = [self.stiffness, self.damping, self.pitch, self.compliance, self.offset_m]
        return np.array([*first, *[self.friction_m] * masses])


@dataclass(frozen=True)
class Explanation:
    """A buffer explained: by the model that does it best (``problem``), the estimate with its standard error.

    cost_m2: mean square error and what the deviations from the believed model cost beside it. doubted: whether there
    was anything to explain; without, problem and estimate are as they came.
    """

    problem: Problem
    estimate: Estimate
    cost_m2: float
    doubted: bool


def explained(problem: Problem, estimate: Estimate, tolerances: Tolerances) -> Explanation:
    """The best explanation about an estimate; ``fit_gap_rad`` stays the minimiser of eq. (18)."""
    plain = problem.rows(estimate.gap_rad, estimate.theta_d0_rad, estimate.growth_rad_s)[0]
    if np.mean(plain**2) > problem.floor_m2:
        estimate, plain = _grown(problem, estimate)
    if not np.mean(plain**2) > problem.floor_m2:
        return Explanation(problem, estimate, estimate.cost_m2, False)
    fit = _Fit(problem, tolerances)
    first = [estimate.gap_rad, estimate.theta_d0_rad, estimate.growth_rad_s]
    x, covariance, converged = fit.solve(np.append(first, np.zeros(fit.deviations.size - 3)))
    error = fit.error(x)
    mean_square = float(np.mean(error**2))
    deviation = float(np.sum((x / fit.deviations) ** 2)) * problem.noise_m2(error) / problem.counted
    better = replace(
        estimate, gap_rad=float(x[0]), theta_d0_rad=float(x[1]), growth_rad_s=float(x[2]), cost_m2=mean_square,
        std_rad=_std(covariance[0, 0]), growth_std_rad_s=_std(covariance[2, 2]), converged=converged,
        message=estimate.message if converged else f"no end of the fit with model error in {STEPS} steps",
    )  # fmt: skip
    return Explanation(fit.with_model(x), better, mean_square + deviation, True)


def _grown(problem: Problem, estimate: Estimate) -> tuple[Estimate, Array]:
    """The estimate with gap, start and growth fitted to the end, and the output error that it leaves.

    The plain estimate has taken two linear steps towards the growth, and may have the screw rest on the wrong side of
    the gap: the fit also begins where the structure at rest says that the screw is.
    """
    first = np.array([estimate.gap_rad, estimate.theta_d0_rad, estimate.growth_rad_s])
    best, rows, variances = first, problem.rows(*first), np.full(3, np.inf)
    for rest in (estimate.theta_d0_rad, problem.rest_rad):
        found, left, spread = _descended(problem, np.array([first[0], rest, first[2]]))
        if np.mean(left[0] ** 2) < np.mean(rows[0] ** 2):
            best, rows, variances = found, left, spread
        if np.mean(rows[0] ** 2) <= problem.floor_m2:
            break
    if not np.mean(rows[0] ** 2) <= problem.floor_m2:
        return estimate, problem.rows(*first)[0]
    std, _, growth_std = np.sqrt(variances * problem.noise_m2(rows[0]))
    better = replace(
        estimate, gap_rad=float(best[0]), theta_d0_rad=float(best[1]), growth_rad_s=float(best[2]), converged=True,
        std_rad=float(std), growth_std_rad_s=float(growth_std),
    )  # fmt: skip
    return better, rows[0]


def _std(variance: float) -> float:
    """The standard error of a variance; inf where the data do not see what it is of."""
    return float(np.sqrt(variance)) if variance > 0.0 else np.inf


def _descended(problem: Problem, x: Array) -> tuple[Array, Array, Array]:
    """Gap, start and growth (3,) where Gauss-Newton ends; the rows there, and their variances per noise (3,)."""
    rows = problem.rows(*x)
    step, variances = linear_step(problem, rows)
    for _ in range(STEPS):
        for _ in range(HALVINGS):
            moved = np.array([max(x[0] + step[0], 0.0), *(x[1:] + step[1:])])
            trial = problem.rows(*moved)
            if np.mean(trial[0] ** 2) < np.mean(rows[0] ** 2):
                break
            step = 0.5 * step
        else:
            break
        x, rows = moved, trial
        step, variances = linear_step(problem, rows)
    return x, rows, variances


class _Fit:
    """Gap, start, growth and psi, (8 + N,), fitted to one buffer; SI."""

    def __init__(self, problem: Problem, tolerances: Tolerances) -> None:
        self.problem, self.tolerances = problem, tolerances
        model = problem.model
        order = len(model.lags) - 1
        # what each power of s, the highest first, is in lags
        self.powers = np.array([in_lags(unit, order, model.pole_rad_s) for unit in np.eye(order + 1)])
        self.from_q3 = _lagged(problem.q3, model.lags)
        after = observer.play(problem.q3, tolerances.presliding_m, problem.q3[0], 0.0)
        self.friction = _lagged((problem.q3 - after) / tolerances.presliding_m, model.lags)
        growth = np.radians(tolerances.growth_deg_s)
        masses = len(model.structure.masses_kg)
        self.deviations = np.concatenate([[np.inf, np.inf, growth], tolerances.deviations(masses)])

    def coefficients(self, psi: Array) -> Array:
        """(3n + 4,) coefficients v of the lags of q3, theta_d and friction, and of the constant, n = 2N."""
        model, believed = self.problem.model, self.problem.model.structure
        order, pole = len(model.lags) - 1, model.pole_rad_s
        structure = replace(
            believed,
            stiffnesses_n_per_m=tuple(k * float(np.exp(psi[0])) for k in believed.stiffnesses_n_per_m),
            dampings_n_s_per_m=tuple(c * float(np.exp(psi[1])) for c in believed.dampings_n_s_per_m),
            pitch_m_per_rad=believed.pitch_m_per_rad * (1.0 + psi[2]),
        )
        num, den = structure_polynomials(structure)
        yielding_q3, yielding_theta_d = _yielding(structure, num)
        polynomials = np.zeros((3, order + 1))
        polynomials[0] = den
        polynomials[0, -yielding_q3.size :] += psi[3] * yielding_q3
        polynomials[1, -num.size :] = -num
        polynomials[1, -yielding_theta_d.size :] += psi[3] * yielding_theta_d
        for force, moved_m in zip(_forces(structure), psi[5:], strict=True):
            polynomials[2, -force.size :] += moved_m * den[-1] / force[-1] * force
        return np.append(polynomials @ self.powers, psi[4] * den[-1] / pole**order)

    def regressors(self, theta_d: Array) -> Array:
        """R, (3n + 4, N)."""
        return np.concatenate([self.from_q3, _lagged(theta_d, self.problem.model.lags), self.friction,
                               np.ones((1, theta_d.size))])  # fmt: skip

    def error(self, x: Array) -> Array:
        """Output error of the counted samples [m]."""
        model = self.problem.model
        theta_d = observer.play(self.problem.theta_m, x[0], x[1], x[2] * model.sample_time_s)
        return np.asarray(self.coefficients(x[3:]) @ self.regressors(theta_d)[:, model.settle :])

    def linearised(self, x: Array) -> tuple[Array, Array]:
        """Output error and its derivatives by x: (counted,), (8 + N, counted)."""
        model, theta_m = self.problem.model, self.problem.theta_m
        rows = np.empty((4, theta_m.size))
        observer.play_sensitivities(theta_m, x[0], x[1], x[2] * model.sample_time_s, rows)
        rows[3] *= model.sample_time_s
        regressors = self.regressors(rows[0])[:, model.settle :]
        v = self.coefficients(x[3:])
        through = v[len(model.lags) : 2 * len(model.lags)]
        derivatives = [through @ _lagged(row, model.lags)[:, model.settle :] for row in rows[1:]]
        for i, deviation in enumerate(self.deviations[3:]):
            psi = x[3:].copy()
            psi[i] += DIFFERENCE * deviation
            derivatives.append((self.coefficients(psi) - v) @ regressors / (DIFFERENCE * deviation))
        return v @ regressors, np.array(derivatives)

    def solve(self, x: Array) -> tuple[Array, Array, bool]:
        """The best x from a first one, its covariance as :meth:`covariance`, and whether its gap is stationary."""
        prior = 1.0 / self.deviations**2
        error, jacobian = self.linearised(x)
        for _ in range(STEPS):
            noise = self.problem.noise_m2(error)
            covariance = self.covariance(jacobian, noise)
            step = -covariance @ (jacobian @ error / noise + prior * x)
            before = np.sum(error**2) / noise + np.sum(prior * x**2)
            for _ in range(HALVINGS):
                trial = x + step
                trial[0] = max(trial[0], 0.0)
                if np.sum(self.error(trial) ** 2) / noise + np.sum(prior * trial**2) <= before:
                    break
                step = 0.5 * step
            else:
                break
            moved, x = abs(trial[0] - x[0]), trial
            error, jacobian = self.linearised(x)
            if moved < CONVERGED * np.sqrt(covariance[0, 0]):
                break
        noise = self.problem.noise_m2(error)
        covariance = self.covariance(jacobian, noise)
        step = -(covariance @ (jacobian @ error / noise + prior * x))[0]
        return x, covariance, bool(abs(max(step, -x[0])) < STATIONARY * _std(covariance[0, 0]))

    def covariance(self, jacobian: Array, noise: float) -> Array:
        """Of x; rows and columns of zeros for what neither data nor prior knows (theta_d0 after a contact)."""
        information = jacobian @ jacobian.T
        seen = np.diag(information) > 1e-6 * self.problem.counted * self.problem.model.pitch_m_per_rad**2
        seen[2:] = True
        total = (information / noise + np.diag(1.0 / self.deviations**2))[np.ix_(seen, seen)]
        scale = 1.0 / np.sqrt(np.diag(total))
        found = np.zeros_like(information)
        found[np.ix_(seen, seen)] = np.linalg.pinv(total * np.outer(scale, scale), rcond=1e-12) * np.outer(scale, scale)
        return found

    def with_model(self, x: Array) -> Problem:
        """The same buffer, for which the model at x is the twin's."""
        problem, model = copy(self.problem), self.problem.model
        v = self.coefficients(x[3:])
        one = len(model.lags)
        problem.eps_q = np.ascontiguousarray(v[:one] @ self.from_q3 + v[2 * one : 3 * one] @ self.friction + v[-1])
        path = sampled_path(v[one : 2 * one], model.pole_rad_s, model.sample_time_s)
        problem.model = replace(model, from_theta_d=path)
        return problem


def _lagged(u: Array, lags: tuple[observer.Path, ...]) -> Array:
    return np.array([observer.filtered(u, path) for path in lags])


def _forces(structure: StructureParameters) -> list[Array]:
    """For each mass, the polynomial from a force on it [N] to den(s) q3, highest power first."""
    mass, damping, stiffness, _, _ = structure_matrices(structure)
    found = []
    for j in range(len(structure.masses_kg)):
        through = np.asarray(tridiagonal_determinant(mass[:j, :j], damping[:j, :j], stiffness[:j, :j]))
        for c, k in zip(structure.dampings_n_s_per_m[j + 1 :], structure.stiffnesses_n_per_m[j + 1 :], strict=True):
            through = np.asarray(np.polymul(through, [c, k]), dtype=np.float64)
        found.append(np.asarray(through / np.prod(structure.masses_kg)))
    return found


def _yielding(structure: StructureParameters, num: Array) -> tuple[Array, Array]:
    """What compliance of the screw, relative to the first link's, adds to den (of q3) and to -num (of theta_d).

    The base is then at p theta_d less the compliance times the force through the screw. The structure does not say what
    else the base carries: a mass and a link to the ground like the first ones, as in the paper.
    """
    mass, damping, stiffness, _, _ = structure_matrices(structure)
    m, c, k = structure.masses_kg[0], structure.dampings_n_s_per_m[0], structure.stiffnesses_n_per_m[0]
    others = tridiagonal_determinant(mass[1:, 1:], damping[1:, 1:], stiffness[1:, 1:])
    q3 = -np.polymul(np.polymul([c, k], [c, k]), others) / np.prod(structure.masses_kg)
    # behind a single mass the base's inertia would differentiate: it is left out there
    theta_d = np.polymul(num, [m, 2.0 * c, 2.0 * k])[-(2 * len(structure.masses_kg) + 1) :]
    return np.asarray(q3 / k), np.asarray(theta_d / k)
