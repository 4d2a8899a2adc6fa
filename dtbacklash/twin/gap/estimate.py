"""Estimation of the gap from one buffer: eq. (18) minimised by a method of SciPy.

The optimisers see two variables in degrees (half gap, theta_d(0) relative to theta_m(0)) and the cost in
units of (what 1 deg of theta_d does to the structure at rest)^2, so that both are of order one and a
tolerance means the same for every rig. One registry, :data:`OPTIMIZERS`, maps ``optimizer.name`` to a
function.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dtbacklash.errors import UserError
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.observer import TwinModel

Array = NDArray[np.float64]
Start = tuple[float, float]

#: A point counts as stationary when the Gauss-Newton step from it moves the gap by less than this [deg].
STATIONARY_DEG = 0.05
#: Growth of the gap within the buffer is used only if it explains this many times the noise ...
GROWTH_SIGNIFICANCE = 25.0
#: ... and moves the estimate, which refers to the middle of the buffer, by no more than this [deg].
GROWTH_SHIFT_MAX_DEG = 1.0
#: A cost below (this many degrees of theta_d)^2 is rounding and interpolation, not information.
FLOOR_DEG = 0.05


class OptimizerLike(Protocol):
    """The settings that :func:`estimate_gap` reads; ``dtbacklash.config.run.OptimizerConfig`` is one."""

    name: str
    max_evaluations: int
    tolerance: float


@dataclass(frozen=True)
class Estimate:
    """Outcome of one estimation.

    gap_rad: half gap in the middle of the buffer. fit_gap_rad, theta_d0_rad: the minimiser of eq. (18),
    which takes the gap as constant; cost_m2: the mean square error there. std_rad: standard error of
    gap_rad (inf where the data do not determine it). growth_rad_s: growth of the gap within the buffer, 0
    where the data show none; growth_std_rad_s: its standard error (inf where the data do not determine it).
    """

    gap_rad: float
    fit_gap_rad: float
    theta_d0_rad: float
    cost_m2: float
    std_rad: float
    growth_rad_s: float
    growth_std_rad_s: float
    evaluations: int
    converged: bool
    message: str
    wall_s: float


class _OutOfEvaluations(Exception):
    """Raised out of a SciPy method when the allowed number of evaluations is spent."""


class Problem:
    """One buffer and the model it is explained by; every cost of it goes through here.

    theta_m_rad, q3_m: (N,) measured, N above model.settle. Raises UserError for another shape or for NaN.
    """

    def __init__(self, theta_m_rad: Array, q3_m: Array, model: TwinModel, gap_max_rad: float = np.pi) -> None:
        self.theta_m = np.ascontiguousarray(theta_m_rad, dtype=np.float64)
        q3 = np.ascontiguousarray(q3_m, dtype=np.float64)
        if self.theta_m.ndim != 1 or self.theta_m.shape != q3.shape or q3.size <= model.settle:
            shapes = (self.theta_m.shape, q3.shape)
            allowed = f"two equal columns of more than settle={model.settle} samples"
            raise UserError("twin.buffer", shapes, allowed)
        if not (np.all(np.isfinite(self.theta_m)) and np.all(np.isfinite(q3))):
            raise UserError("twin.buffer", "nan", "finite measurements only")
        self.model = model
        self.gap_max_rad = gap_max_rad
        self.q3 = q3
        self.eps_q = observer.filtered(q3, model.from_q3)
        self.unit_m2 = float((model.pitch_m_per_rad * np.pi / 180.0) ** 2)
        self.floor_m2 = self.unit_m2 * FLOOR_DEG**2
        self.rest_rad = float(q3[0] / model.pitch_m_per_rad)
        self.counted = q3.size - model.settle

    def cost(self, gap_rad: float, theta_d0_rad: float) -> float:
        """Mean square output error [m^2] with a constant gap, eq. (18)."""
        path, settle = self.model.from_theta_d, self.model.settle
        return float(observer.cost(self.theta_m, self.eps_q, gap_rad, theta_d0_rad, 0.0, path, settle))

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Scaled cost and gradient at x = (half gap, theta_d0 - theta_m0) in degrees."""
        rad, path = np.pi / 180.0, self.model.from_theta_d
        gap, start = x[0] * rad, self.theta_m[0] + x[1] * rad
        value, by_gap, by_start = observer.cost_and_gradient(
            self.theta_m, self.eps_q, gap, start, path, self.model.settle
        )
        scale = 1.0 / self.unit_m2
        return value * scale, np.array([by_gap, by_start]) * (rad * scale)

    def rows(self, gap_rad: float, theta_d0_rad: float, growth_rad_s: float = 0.0) -> Array:
        """Output error and its derivatives by gap, theta_d0 and growth [rad/s]: (4, counted samples), SI."""
        model = self.model
        rows = observer.sensitivities(
            self.theta_m,
            self.eps_q,
            gap_rad,
            theta_d0_rad,
            growth_rad_s * model.sample_time_s,
            model.from_theta_d,
            model.settle,
        )
        rows[3] *= model.sample_time_s
        return np.asarray(rows)

    def noise_m2(self, error: Array) -> float:
        """Noise of the cost: the variance that one independent sample of ``error`` would have [m^2].

        The sensitivities to the parameters vary slowly, so what counts is the error's power at low frequency.
        The largest of: the power that white noise of a sensor would have there after the observer; the power
        measured there, by means over blocks of half the observer's memory; and rounding.
        """
        memory = round(2.0 / (self.model.pole_rad_s * self.model.sample_time_s))
        block = max(1, min(memory, error.size // 4))
        count = error.size // block
        means = error[error.size - count * block :].reshape(count, block).mean(axis=1)
        white = min(self.model.noise_colour, block) * np.mean(error**2)
        return float(max(block * np.mean(means**2), white, self.floor_m2))


def default_start(problem: Problem, gap_rad: float) -> Start:
    """(half gap, theta_d0) [rad] to begin with, from the gap in force now.

    Before a buffer starts the structure is at rest, so theta_d0 shows in q3 itself; and the gap is at least
    the distance from there to theta_m.
    """
    return max(gap_rad, abs(float(problem.theta_m[0]) - problem.rest_rad)), problem.rest_rad


class _Counted:
    """The cost as SciPy wants it; counts, keeps the best point, and stops when the evaluations are spent."""

    def __init__(self, problem: Problem, allowed: int) -> None:
        self.problem, self.allowed = problem, allowed
        self.count, self.best, self.best_x = 0, np.inf, np.zeros(2)

    def _spend(self) -> None:
        if self.count >= self.allowed:
            raise _OutOfEvaluations
        self.count += 1

    def _keep(self, value: float, x: Array) -> None:
        if value < self.best:
            self.best, self.best_x = value, np.array(x, dtype=float)

    def value(self, x: Array) -> float:
        self._spend()
        rad, problem = np.pi / 180.0, self.problem
        value = problem.cost(x[0] * rad, problem.theta_m[0] + x[1] * rad) / problem.unit_m2
        self._keep(value, x)
        return value

    def with_gradient(self, x: Array) -> tuple[float, Array]:
        self._spend()
        value, gradient = self.problem.gradient(x)
        self._keep(value, x)
        return value, gradient

    def bounds(self) -> list[tuple[float, float]]:
        limit = float(np.degrees(self.problem.gap_max_rad))
        return [(0.0, limit), (-limit, limit)]


def _scipy(name: str) -> Any:
    """A function of scipy.optimize, imported when it is needed: the import takes half a second."""
    from scipy import optimize

    return getattr(optimize, name)


def _bfgs(cost: _Counted, x0: Array, settings: OptimizerLike, rng: np.random.Generator) -> Any:
    """The paper's choice: unconstrained quasi-Newton."""
    options = {"gtol": settings.tolerance}
    return _scipy("minimize")(cost.with_gradient, x0, jac=True, method="BFGS", options=options)


def _lbfgsb(cost: _Counted, x0: Array, settings: OptimizerLike, rng: np.random.Generator) -> Any:
    """Quasi-Newton within the physical bounds."""
    bounds = cost.bounds()
    start = np.clip(x0, *np.transpose(bounds))
    options = {"gtol": settings.tolerance, "ftol": 1e-14}
    return _scipy("minimize")(cost.with_gradient, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)


def _nelder_mead(cost: _Counted, x0: Array, settings: OptimizerLike, rng: np.random.Generator) -> Any:
    """Simplex search within the physical bounds, without derivatives; first simplex 10 deg wide."""
    # the cost is even in the gap: a lower bound at zero would only let the simplex collapse onto it
    limit = cost.bounds()[0][1]
    bounds = [(-limit, limit)] * 2
    low, high = np.transpose(bounds)
    start = np.clip(x0, low, high)
    step = np.where(start + 10.0 > high, -10.0, 10.0)
    simplex = start + np.array([[0.0, 0.0], [step[0], 0.0], [0.0, step[1]]])
    tolerances = {"xatol": max(settings.tolerance, 1e-4), "fatol": settings.tolerance}
    options = {**tolerances, "initial_simplex": simplex}
    return _scipy("minimize")(cost.value, start, method="Nelder-Mead", bounds=bounds, options=options)


def _differential_evolution(cost: _Counted, x0: Array, settings: OptimizerLike, rng: np.random.Generator) -> Any:
    """Global search by a population within the physical bounds, then L-BFGS-B from the best member."""
    bounds = cost.bounds()
    members = 8  # per variable; each generation then costs 16 evaluations
    generations = max(1, int(0.8 * settings.max_evaluations) // (2 * members) - 1)
    _scipy("differential_evolution")(
        cost.value, bounds, maxiter=generations, popsize=members, tol=1e-3, polish=False, rng=rng,
        x0=np.clip(x0, *np.transpose(bounds)),
    )  # fmt: skip
    return _lbfgsb(cost, cost.best_x, settings, rng)


def _dual_annealing(cost: _Counted, x0: Array, settings: OptimizerLike, rng: np.random.Generator) -> Any:
    """Global search by annealing within the physical bounds, then L-BFGS-B from the best point."""
    bounds = cost.bounds()
    steps = max(1, int(0.8 * settings.max_evaluations))
    _scipy("dual_annealing")(
        cost.value, bounds, maxfun=steps, maxiter=steps, no_local_search=True, rng=rng,
        x0=np.clip(x0, *np.transpose(bounds)),
    )  # fmt: skip
    return _lbfgsb(cost, cost.best_x, settings, rng)


Optimizer = Callable[[_Counted, Array, OptimizerLike, np.random.Generator], Any]
OPTIMIZERS: dict[str, Optimizer] = {
    "bfgs": _bfgs,
    "lbfgsb": _lbfgsb,
    "nelder_mead": _nelder_mead,
    "differential_evolution": _differential_evolution,
    "dual_annealing": _dual_annealing,
}


def estimate_gap(
    problem: Problem, optimizer: OptimizerLike, start: Start, rng: np.random.Generator | None = None
) -> Estimate:
    """Minimise eq. (18) from ``start`` = (half gap, theta_d0) [rad] by the method that ``optimizer`` names.

    rng: for the global methods (seed 0 without one). Raises UserError for an unknown method. A search that
    spends its evaluations returns its best point, not converged.
    """
    if optimizer.name not in OPTIMIZERS:
        raise UserError("optimizer.name", optimizer.name, "one of " + ", ".join(OPTIMIZERS))
    begin = time.perf_counter()
    counted = _Counted(problem, optimizer.max_evaluations)
    x0 = np.degrees([start[0], start[1] - problem.theta_m[0]])
    success, message = False, f"stopped after {optimizer.max_evaluations} evaluations"
    try:
        result = OPTIMIZERS[optimizer.name](counted, x0, optimizer, rng or np.random.default_rng(0))
        success, message = bool(result.success), str(result.message)
    except _OutOfEvaluations:
        pass
    fit_gap = float(np.radians(abs(counted.best_x[0])))
    theta_d0 = float(problem.theta_m[0] + np.radians(counted.best_x[1]))
    rows = problem.rows(fit_gap, theta_d0)
    step, variances = linear_step(problem, rows[:3])
    # a gap cannot shrink below zero: there a step downwards is no step, and the cost may have a corner
    move = max(float(step[0]), -fit_gap)
    stationary = bool(np.isfinite(variances[0])) and abs(move) < np.radians(STATIONARY_DEG)
    growth, growth_std, shift = _growth(problem, rows, fit_gap, theta_d0)
    return Estimate(
        gap_rad=max(fit_gap + shift, 0.0),
        fit_gap_rad=fit_gap,
        theta_d0_rad=theta_d0,
        cost_m2=float(np.mean(rows[0] ** 2)),
        std_rad=float(np.sqrt(variances[0] * problem.noise_m2(rows[0]))),
        growth_rad_s=growth,
        growth_std_rad_s=growth_std,
        evaluations=counted.count,
        converged=success or stationary,
        message=message,
        wall_s=time.perf_counter() - begin,
    )


def linear_step(problem: Problem, rows: Array) -> tuple[Array, Array]:
    """Gauss-Newton step (n,) from rows (1 + n, samples) of error and derivatives; its variances per noise.

    A parameter that the data do not see at all (theta_d0 after an early contact) stays: step 0, variance inf.
    """
    error, jacobian = rows[0], rows[1:]
    information = jacobian @ jacobian.T
    seen = np.diag(information) > 1e-6 * error.size * problem.model.pitch_m_per_rad**2
    step, variances = np.zeros(len(jacobian)), np.full(len(jacobian), np.inf)
    if np.any(seen):
        inverse = np.linalg.pinv(information[np.ix_(seen, seen)], rcond=1e-9)
        step[seen] = -inverse @ (jacobian[seen] @ error)
        variances[seen] = np.diag(inverse)
    return step, variances


def _growth(problem: Problem, rows: Array, gap: float, theta_d0: float) -> tuple[float, float, float]:
    """Growth of the gap within the buffer [rad/s], its standard error, and the estimate's shift to the middle [rad].

    Eq. (18) takes the gap as constant and so finds the gap of the samples it weighs most, which lie after the
    middle: where the gap grows it would be biased. One more parameter, fitted by two linear steps, takes
    the bias out. Where the data do not show growth clearly the answer is 0, inf and 0, the paper's estimate.
    """
    x = np.array([gap, theta_d0, 0.0])
    refined = rows
    for _ in range(2):
        x = x + linear_step(problem, refined)[0]
        if x[0] < 0.0:
            return 0.0, np.inf, 0.0
        refined = problem.rows(*x)
    gain = float(np.sum(rows[0] ** 2) - np.sum(refined[0] ** 2))
    significant = gain > GROWTH_SIGNIFICANCE * problem.noise_m2(refined[0])
    if not significant or abs(x[0] - gap) > np.radians(GROWTH_SHIFT_MAX_DEG):
        return 0.0, np.inf, 0.0
    std = np.sqrt(linear_step(problem, refined)[1][2] * problem.noise_m2(refined[0]))
    return float(x[2]), float(std), float(x[0] - gap)
