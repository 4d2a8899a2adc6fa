"""Estimation of the gap from one buffer: eq. (18) minimised by the core's BFGS, or by a method of SciPy.

The optimisers see two variables in degrees (half gap, theta_d(0) relative to theta_m(0)) and the cost in
units of (what 1 deg of theta_d does to the structure at rest)^2, so that both are of order one and a
tolerance means the same for every rig. One registry, :data:`OPTIMIZERS`, maps ``optimizer.name`` to a
function of SciPy; ``bfgs`` is the core's (``bfgs.c``), and what follows from the minimum is in ``estimate.c``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dtbacklash.core.library import Calls, buffer, copied, ffi, lib, struct
from dtbacklash.errors import UserError
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.observer import TwinModel

Array = NDArray[np.float64]
Start = tuple[float, float]

BFGS = "bfgs"
#: how a search of the core ended, by its number
ENDS = {
    lib.ENDED: "no element of the gradient is above the tolerance",
    lib.STUCK: "no lower cost along the line of search",
    lib.NO_END: "no end of the fit with model error in 12 steps",
}


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
        self.counted = q3.size - model.settle
        self.calls = Calls()

    def cost(self, gap_rad: float, theta_d0_rad: float) -> float:
        """Mean square output error [m^2] with a constant gap, eq. (18)."""
        path, settle = self.model.from_theta_d, self.model.settle
        return float(observer.cost(self.theta_m, self.eps_q, gap_rad, theta_d0_rad, 0.0, path, settle))

    def cost_and_gradient(self, gap_rad: float, theta_d0_rad: float) -> tuple[float, float, float]:
        """Mean square output error [m^2] and its derivatives by gap and theta_d0 [m^2/rad], with a constant gap."""
        path, settle = self.model.from_theta_d, self.model.settle
        return observer.cost_and_gradient(self.theta_m, self.eps_q, gap_rad, theta_d0_rad, path, settle)

    def gradient(self, x: Array) -> tuple[float, Array]:
        """Scaled cost and gradient at x = (half gap, theta_d0 - theta_m0) in degrees."""
        rad, scale = np.pi / 180.0, 1.0 / self.unit_m2
        value, by_gap, by_start = self.cost_and_gradient(x[0] * rad, self.theta_m[0] + x[1] * rad)
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
        """Noise of the cost: the variance that one independent sample of ``error`` would have [m^2]."""
        found: float = lib.dtb_noise(observer.model_struct(self.model), error.size, copied(error))
        return found

    def struct(self) -> Any:
        """The buffer and its model as the core takes them."""
        data = observer.buffer_struct(self.theta_m, self.eps_q, self.model.from_theta_d, self.model.settle)
        model, room = observer.model_struct(self.model), np.empty(6 * self.model.from_theta_d.b.size)
        return struct("TwinProblem", model=model, data=data, q3=self.q3, room=room, **self.simulation())

    def simulation(self) -> dict[str, Any]:
        """What the core calls instead of its own functions: fields of a ``TwinProblem``."""
        return {}


def default_start(problem: Problem, gap_rad: float) -> Start:
    """(half gap, theta_d0) [rad] to begin with, from the gap in force now.

    Before a buffer starts the structure is at rest, so theta_d0 shows in q3 itself; and the gap is at least
    the distance from there to theta_m.
    """
    found = np.empty(2)
    lib.dtb_default_start(problem.struct(), gap_rad, buffer(found))
    return float(found[0]), float(found[1])


class _OutOfEvaluations(Exception):
    """Raised out of a SciPy method when the allowed number of evaluations is spent."""


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
OPTIMIZERS: dict[str, Optimizer | None] = {
    BFGS: None,  # the core's
    "lbfgsb": _lbfgsb,
    "nelder_mead": _nelder_mead,
    "differential_evolution": _differential_evolution,
    "dual_annealing": _dual_annealing,
}


class Method:
    """The optimizer that the settings name, for one problem, as the core takes it.

    message : of the last search, where SciPy made it.
    """

    def __init__(self, problem: Problem, optimizer: OptimizerLike, rng: np.random.Generator | None = None) -> None:
        if optimizer.name not in OPTIMIZERS:
            raise UserError("optimizer.name", optimizer.name, "one of " + ", ".join(OPTIMIZERS))
        self.problem, self.settings, self.rng = problem, optimizer, rng or np.random.default_rng(0)
        self.spent = self.message = f"stopped after {optimizer.max_evaluations} evaluations"
        self.calls = Calls()
        given: dict[str, Any] = {"most": optimizer.max_evaluations, "tolerance": optimizer.tolerance}
        if OPTIMIZERS[optimizer.name] is not None:
            given["other"] = self.calls("void(void *, double *, int64_t *)", self._search)
        self.struct = struct("Optimizer", **given)

    def _search(self, _: Any, x: Any, done: Any) -> None:
        counted, success = _Counted(self.problem, self.settings.max_evaluations), False
        search, self.message = OPTIMIZERS[self.settings.name], self.spent
        assert search is not None
        try:
            result = search(counted, np.array([x[0], x[1]]), self.settings, self.rng)
            success, self.message = bool(result.success), str(result.message)
        except _OutOfEvaluations:
            pass
        x[0], x[1] = (float(value) for value in counted.best_x)
        done[0], done[1] = counted.count, success

    def said(self, end: int) -> str:
        """How a search has ended."""
        return {lib.SPENT: self.spent, lib.OTHERWISE: self.message}.get(end) or ENDS[end]


def estimate_gap(
    problem: Problem, optimizer: OptimizerLike, start: Start, rng: np.random.Generator | None = None
) -> Estimate:
    """Minimise eq. (18) from ``start`` = (half gap, theta_d0) [rad] by the method that ``optimizer`` names.

    rng: for the global methods (seed 0 without one). Raises UserError for an unknown method. A search that
    spends its evaluations returns its best point, not converged.
    """
    begin, method, found = time.perf_counter(), Method(problem, optimizer, rng), ffi.new("GapEstimate *")
    given = problem.struct()
    lib.dtb_estimate(given, method.struct, buffer(np.array(start, dtype=float), 2), found)
    for calls in (method.calls, problem.calls):
        calls.check()
    return estimate_of(found, method.said(found.end), time.perf_counter() - begin)


def estimate_of(found: Any, message: str, wall_s: float) -> Estimate:
    """An estimate of the core's."""
    return Estimate(found.gap, found.fit_gap, found.theta_d0, found.cost, found.std, found.growth, found.growth_std,
                    found.evaluations, bool(found.converged), message, wall_s)  # fmt: skip


def estimate_struct(estimate: Estimate) -> Any:
    """An estimate as the core takes it; its message stays here."""
    return struct(
        "GapEstimate", gap=estimate.gap_rad, fit_gap=estimate.fit_gap_rad, theta_d0=estimate.theta_d0_rad,
        cost=estimate.cost_m2, std=estimate.std_rad, growth=estimate.growth_rad_s, growth_std=estimate.growth_std_rad_s,
        evaluations=estimate.evaluations, converged=estimate.converged, end=lib.OTHERWISE,
    )  # fmt: skip
