"""The guard between the twin and the controller: an estimate counts only when the data bear it out.

An optimiser returns *a* point; whether the gap is there is another question. The guard answers it from the
profile of the cost: for any gap, the best cost over where theta_d may have started. An estimate passes
when it

1. lies inside the physical bounds,
2. converged,
3. follows from a contact that moved the screw where the cost looks,
4. stands in a valley: a gap ``resolution_deg`` to either side fits clearly worse,
5. stands in the only valley: nowhere else within the bounds does a gap fit as well,
6. fits clearly better than the present gap, or agrees with it.

"Clearly" is a likelihood ratio: the sum of squares grows by more than ``significance`` times the noise,
which is taken from the residual itself (:meth:`Problem.noise_m2`), so that a model that does not fit makes
the guard careful.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dtbacklash.compiled import compiled_allocating
from dtbacklash.twin import observer
from dtbacklash.twin.estimate import Estimate, OptimizerLike, Problem, Start, default_start, estimate_gap
from dtbacklash.twin.observer import Path, TwinModel

Array = NDArray[np.float64]

COARSE_STARTS = 9  # first tries for theta_d0 across the gap
POLISH_STEPS = 6  # Newton steps that follow, each halved until it helps
HALVINGS = 4


@dataclass(frozen=True)
class GuardSettings:
    """What the guard asks for.

    gap_max_deg: physical bound. resolution_deg: how finely the data must determine the gap. significance: the
    growth of the sum of squares, in units of the noise, that counts as clear (16: four standard deviations).
    agreement_deg: an estimate this near to the present gap agrees with it. travel_deg: least motion of the
    screw in contact within the part of the buffer that the cost sees. scan_step_deg: grid of the profile.
    attempts: how many starts are tried in all.
    """

    gap_max_deg: float = 180.0
    resolution_deg: float = 1.0
    significance: float = 16.0
    agreement_deg: float = 0.25
    travel_deg: float = 1.0
    scan_step_deg: float = 6.0
    attempts: int = 5


@dataclass(frozen=True)
class Verdict:
    """Whether an estimate goes to the controller, and why (not) in a few words.

    settled: no other start can change that, because the estimate is the buffer's best.
    """

    accepted: bool
    reason: str
    settled: bool = False


@dataclass(frozen=True)
class Attempt:
    """One try of the twin: an estimate and what the guard said."""

    estimate: Estimate
    verdict: Verdict


@compiled_allocating
def profile_point(theta_m: Array, eps_q: Array, half_gap: float, path: Path, settle: int) -> tuple[float, float]:
    """Least cost [m^2] over theta_d0 for one gap, and that theta_d0 [rad]. Arguments as observer.cost.

    theta_d0 lies within the gap around theta_m[0]. Where it matters the cost is piecewise quadratic in it, so
    that Newton's method from the best of a few points ends at rounding.
    """
    best, best_start = np.inf, theta_m[0]
    for i in range(COARSE_STARTS):
        start = theta_m[0] + half_gap * (2.0 * i / (COARSE_STARTS - 1) - 1.0)
        value = observer.cost(theta_m, eps_q, half_gap, start, 0.0, path, settle)
        if value < best:
            best, best_start = value, start
    for _ in range(POLISH_STEPS):
        rows = observer.start_sensitivity(theta_m, eps_q, half_gap, best_start, path, settle)
        curvature = np.sum(rows[1] * rows[1])
        if curvature <= 0.0:
            break
        step = -np.sum(rows[0] * rows[1]) / curvature
        gained = 0.0
        for _ in range(HALVINGS):
            start = min(max(best_start + step, theta_m[0] - half_gap), theta_m[0] + half_gap)
            value = observer.cost(theta_m, eps_q, half_gap, start, 0.0, path, settle)
            if value < best:
                gained = best - value
                best, best_start = value, start
                break
            step *= 0.5
        if gained <= 1e-9 * best:
            break
    return best, best_start


@compiled_allocating
def _profile(theta_m: Array, eps_q: Array, gaps: Array, path: Path, settle: int) -> Array:
    out = np.empty((2, gaps.size))
    for i in range(gaps.size):
        out[0, i], out[1, i] = profile_point(theta_m, eps_q, gaps[i], path, settle)
    return out


def profile(problem: Problem, gaps_rad: Array) -> tuple[Array, Array]:
    """The cost's profile: for each gap [rad] the least cost [m^2] and the theta_d0 [rad] where it lies."""
    model = problem.model
    gaps = np.atleast_1d(np.asarray(gaps_rad, dtype=np.float64))
    costs, starts = _profile(problem.theta_m, problem.eps_q, gaps, model.from_theta_d, model.settle)
    return costs, starts


class Guard:
    """Judges estimates from one buffer against the gap in force, ``present_rad``."""

    def __init__(self, problem: Problem, present_rad: float, settings: GuardSettings | None = None) -> None:
        self.problem, self.present_rad = problem, present_rad
        self.settings = settings or GuardSettings()
        step, limit = self.settings.scan_step_deg, self.settings.gap_max_deg
        self.scan_rad = np.radians(np.linspace(0.0, limit, max(2, int(np.ceil(limit / step)) + 1)))
        self._scan: tuple[Array, Array] | None = None

    def scan(self) -> tuple[Array, Array]:
        """The profile over the whole physical range, computed once."""
        if self._scan is None:
            self._scan = profile(self.problem, self.scan_rad)
        return self._scan

    def judge(self, estimate: Estimate) -> Verdict:
        """The six questions in turn; the first that fails is the reason."""
        limit = self.settings.gap_max_deg
        gap_deg = np.degrees(estimate.gap_rad)
        if not np.isfinite(gap_deg) or not -1e-3 <= gap_deg <= limit:
            return Verdict(False, f"{gap_deg:.1f} deg is outside 0..{limit:g} deg")
        if not estimate.converged:
            return Verdict(False, f"not converged: {estimate.message}")
        if self._contact_travel(estimate) < np.radians(self.settings.travel_deg):
            return Verdict(False, "no contact seen in the buffer")
        error = self.problem.rows(estimate.fit_gap_rad, estimate.theta_d0_rad)[0]
        # the sum of squares may grow by this much, spread over the counted samples, for no reason but noise
        margin_m2 = self.settings.significance * self.problem.noise_m2(error) / self.problem.counted
        reason = self._valley(estimate, margin_m2) or self._elsewhere(estimate, margin_m2)
        if reason:
            return Verdict(False, reason)
        return self._against_present(estimate, margin_m2)

    def _contact_travel(self, estimate: Estimate) -> float:
        """How far the gear moved the screw while the cost was looking [rad], by the estimate."""
        model = self.problem.model
        memory = round(4.0 / (model.pole_rad_s * model.sample_time_s))
        theta_d = observer.play(self.problem.theta_m, estimate.fit_gap_rad, estimate.theta_d0_rad, 0.0)
        return float(np.sum(np.abs(np.diff(theta_d[max(0, model.settle - memory) :]))))

    def _valley(self, estimate: Estimate, margin_m2: float) -> str:
        """Reason for rejection if the gap could as well be a little smaller or larger; else ''."""
        width = self.settings.resolution_deg
        sides = estimate.fit_gap_rad + np.radians([-width, width])
        costs, _ = profile(self.problem, sides[sides >= 0.0])
        if np.min(costs) <= estimate.cost_m2 + margin_m2:
            return f"the buffer does not determine the gap within {width:g} deg"
        return ""

    def _elsewhere(self, estimate: Estimate, margin_m2: float) -> str:
        """Reason for rejection if a gap in another place explains the buffer as well; else ''."""
        costs, _ = self.scan()
        far = np.abs(self.scan_rad - estimate.fit_gap_rad) > np.radians(self.settings.resolution_deg)
        i = int(np.argmin(np.where(far, costs, np.inf)))
        if far[i] and costs[i] <= estimate.cost_m2 + margin_m2:
            return f"{np.degrees(self.scan_rad[i]):.0f} deg explains the buffer as well"
        return ""

    def _against_present(self, estimate: Estimate, margin_m2: float) -> Verdict:
        present_deg = np.degrees(self.present_rad)
        if abs(np.degrees(estimate.gap_rad) - present_deg) <= self.settings.agreement_deg:
            return Verdict(True, f"agrees with the present {present_deg:.1f} deg")
        costs, _ = profile(self.problem, np.array([self.present_rad]))
        if costs[0] <= estimate.cost_m2 + margin_m2:
            return Verdict(False, f"no better than the present {present_deg:.1f} deg", settled=True)
        return Verdict(True, f"better than the present {present_deg:.1f} deg")

    def further_starts(self) -> list[Start]:
        """Starts for further attempts: the profile's valleys on the grid, the deepest first."""
        costs, starts = self.scan()
        padded = np.concatenate([[np.inf], costs, [np.inf]])
        # a plateau, where no contact is seen any more, is one valley and not many
        clearly = costs * (1.0 + 1e-6)
        valleys = np.flatnonzero((clearly < padded[:-2]) & (costs <= padded[2:] * (1.0 + 1e-6)))
        order = valleys[np.argsort(costs[valleys], kind="stable")]
        return [(float(self.scan_rad[i]), float(starts[i])) for i in order]


def guarded_estimates(
    problem: Problem,
    optimizer: OptimizerLike,
    present_rad: float,
    settings: GuardSettings | None = None,
    start: Start | None = None,
    rng: np.random.Generator | None = None,
) -> list[Attempt]:
    """Estimate until the guard accepts, at most ``settings.attempts`` times; see :func:`outcome`.

    start: of the first attempt, by default :func:`default_start` from the gap in force, ``present_rad``
    [rad]. Where the guard rejects that, the twin tries again from the valleys of the profile.
    """
    guard = Guard(problem, present_rad, settings)
    attempts = [_attempt(guard, optimizer, start or default_start(problem, present_rad), rng)]
    if not (attempts[0].verdict.accepted or attempts[0].verdict.settled):
        for further in guard.further_starts()[: guard.settings.attempts - 1]:
            attempts.append(_attempt(guard, optimizer, further, rng))
            if attempts[-1].verdict.accepted or attempts[-1].verdict.settled:
                break
    return attempts


def outcome(attempts: list[Attempt]) -> Attempt:
    """The attempt that counts: the accepted one, else the one that explains the buffer best."""
    return min(
        attempts,
        key=lambda a: (not a.verdict.accepted, not np.isfinite(a.estimate.cost_m2), a.estimate.cost_m2),
    )


def warm_up(model: TwinModel, optimizer: OptimizerLike) -> None:
    """Load (the first time: compile) what an estimation needs, so that ``wall_s`` is the estimation's own."""
    theta_m = np.linspace(0.0, 1.0, model.settle + 50)
    guard = Guard(Problem(theta_m, theta_m * model.pitch_m_per_rad, model), 0.0)
    guard.judge(estimate_gap(guard.problem, optimizer, (0.1, 0.0)))
    guard.scan()


def _attempt(guard: Guard, optimizer: OptimizerLike, start: Start, rng: np.random.Generator | None) -> Attempt:
    estimate = estimate_gap(guard.problem, optimizer, start, rng)
    verdict = guard.judge(estimate)
    if verdict.accepted:
        limit = float(np.radians(guard.settings.gap_max_deg))
        estimate = replace(estimate, gap_rad=min(max(estimate.gap_rad, 0.0), limit))
    return Attempt(estimate, verdict)
