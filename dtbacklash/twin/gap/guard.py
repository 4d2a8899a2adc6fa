"""The guard between the twin and the controller: an estimate counts only when the data bear it out.

An optimiser returns *a* point; whether the gap is there is another question, and a model that is wrong shifts it. So an
estimate is fitted again with what may be wrong in the model, which gives it a standard error that holds model error
(:mod:`.model_error`). Then it passes when it

1. lies inside the physical bounds,
2. converged,
3. follows from a contact that moved the screw where the cost looks,
4. stands in the only valley: nowhere else within the bounds does a gap fit as well,
5. differs from the present gap by more than ``significance`` standard errors, or agrees with it and is precise.

"As well" is a likelihood ratio: the sum of squares grows by less than ``significance``^2 times the noise, which is
taken from the residual itself (:meth:`Problem.noise_m2`). What goes to the controller (:attr:`Attempt.applied_rad`)
is the present gap where the estimate lies within one standard error of it, else the estimate less that error, at least
0: too large a gap does more harm than too small a one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dtbacklash.core.library import buffer, lib
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.estimate import Estimate, OptimizerLike, Problem, Start, default_start, estimate_gap
from dtbacklash.twin.gap.model_error import Explanation, Tolerances, explained
from dtbacklash.twin.gap.observer import Path, TwinModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GuardSettings:
    """What the guard asks for.

    gap_max_deg: physical bound. significance: standard errors that count as clear (4: with a model that is wrong in
    ways that nobody listed, errors have longer tails than a normal distribution). shading: standard errors by which an
    estimate is put in force too small (1: five in six are then not too large). agreement_deg:
    an estimate this near to the present gap changes nothing, however precise it is. precise_deg: standard error up to
    which an estimate that agrees with the present gap confirms it. travel_deg: least motion of the screw in
    contact within the part of the buffer that the cost sees. resolution_deg: how near another gap is the same valley,
    at least. scan_step_deg: grid of the profile. attempts: how many starts are tried in all. tolerances: of the model.
    """

    gap_max_deg: float = 180.0
    significance: float = 4.0
    shading: float = 1.0
    agreement_deg: float = 0.25
    precise_deg: float = 3.0
    travel_deg: float = 1.0
    resolution_deg: float = 1.0
    scan_step_deg: float = 6.0
    attempts: int = 5
    tolerances: Tolerances = field(default_factory=Tolerances)


@dataclass(frozen=True)
class Verdict:
    """Whether an estimate goes to the controller, and why (not) in a few words.

    settled: no other start can change that, because the estimate is the buffer's best. agrees: with the present gap.
    """

    accepted: bool
    reason: str
    settled: bool = False
    agrees: bool = False


@dataclass(frozen=True)
class Attempt:
    """One try of the twin: an estimate, what the guard said, and the gap that goes to the controller if accepted."""

    estimate: Estimate
    verdict: Verdict
    applied_rad: float = math.nan


def _profile(theta_m: Array, eps_q: Array, gaps: Array, path: Path, settle: int) -> Array:
    """For each gap the least cost [m^2] over theta_d0, and that theta_d0 [rad], (2, gaps).

    theta_d0 lies within the gap around theta_m[0]. Where it matters the cost is piecewise quadratic in it, so
    that Newton's method from the best of a few points ends at rounding. Arguments as observer.cost.
    """
    out, given = np.empty((2, gaps.size)), observer.buffer_struct(theta_m, eps_q, path, settle)
    lib.dtb_profile(given, gaps.size, buffer(gaps, gaps.size), buffer(out), observer.room(path, 3))
    return out


def profile(problem: Problem, gaps_rad: Array) -> tuple[Array, Array]:
    """The cost's profile: for each gap [rad] the least cost [m^2] and the theta_d0 [rad] where it lies."""
    model = problem.model
    gaps = np.ascontiguousarray(gaps_rad, dtype=np.float64)
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

    def judged(self, estimate: Estimate) -> Attempt:
        """The estimate with its standard error, and the verdict on it."""
        if reason := self._impossible(estimate):
            return Attempt(estimate, Verdict(False, reason))
        found = explained(self.problem, estimate, self.settings.tolerances)
        verdict = self._judge(found)
        better = found.estimate
        if not verdict.accepted:
            return Attempt(better, verdict)
        limit = np.radians(self.settings.gap_max_deg)
        better = replace(better, gap_rad=min(max(better.gap_rad, 0.0), float(limit)))
        lowered = max(better.gap_rad - self.settings.shading * better.std_rad, 0.0)
        error = max(self.settings.shading * better.std_rad, np.radians(self.settings.agreement_deg))
        near = abs(better.gap_rad - self.present_rad) <= error
        return Attempt(better, verdict, self.present_rad if verdict.agrees and near else lowered)

    def _judge(self, found: Explanation) -> Verdict:
        """The questions in turn; the first that fails is the reason."""
        estimate = found.estimate
        if reason := self._impossible(estimate):
            return Verdict(False, reason)
        if not estimate.converged:
            return Verdict(False, f"not converged: {estimate.message}")
        if self._contact_travel(found.problem, estimate) < np.radians(self.settings.travel_deg):
            return Verdict(False, "no contact seen in the buffer")
        if not np.isfinite(estimate.std_rad):
            return Verdict(False, "the buffer does not determine the gap")
        if reason := self._elsewhere(found) or (self._rival(found) if found.doubted else ""):
            return Verdict(False, reason)
        return self._against_present(estimate)

    def _impossible(self, estimate: Estimate) -> str:
        gap_deg, limit = np.degrees(estimate.gap_rad), self.settings.gap_max_deg
        inside = np.isfinite(gap_deg) and -1e-3 <= gap_deg <= limit
        return "" if inside else f"{gap_deg:.1f} deg is outside 0..{limit:g} deg"

    def _contact_travel(self, problem: Problem, estimate: Estimate) -> float:
        """How far the gear moved the screw while the cost was looking [rad], by the estimate."""
        model = problem.model
        memory = round(4.0 / (model.pole_rad_s * model.sample_time_s))
        theta_d = observer.play(problem.theta_m, estimate.gap_rad, estimate.theta_d0_rad, 0.0)
        return float(np.sum(np.abs(np.diff(theta_d[max(0, model.settle - memory) :]))))

    def _far(self, gap_rad: Array, estimate: Estimate) -> NDArray[np.bool_]:
        """Which gaps are not those of the estimate's own valley."""
        width = max(np.radians(self.settings.resolution_deg), self.settings.significance * estimate.std_rad)
        return np.asarray(np.abs(gap_rad - estimate.gap_rad) > width)

    def _margin_m2(self, problem: Problem, estimate: Estimate) -> float:
        """By how much the mean square error may grow for no reason but noise."""
        error = problem.rows(estimate.gap_rad, estimate.theta_d0_rad, estimate.growth_rad_s)[0]
        return self.settings.significance**2 * problem.noise_m2(error) / problem.counted

    def _elsewhere(self, found: Explanation) -> str:
        """Reason for rejection if with the same model a gap in another place explains the buffer as well; else ''."""
        problem, estimate = found.problem, found.estimate
        costs = profile(problem, self.scan_rad)[0] if found.doubted else self.scan()[0]
        error = problem.rows(estimate.gap_rad, estimate.theta_d0_rad, estimate.growth_rad_s)[0]
        far = self._far(self.scan_rad, estimate)
        i = int(np.argmin(np.where(far, costs, np.inf)))
        if far[i] and costs[i] <= float(np.mean(error**2)) + self._margin_m2(problem, estimate):
            return f"{np.degrees(self.scan_rad[i]):.0f} deg explains the buffer as well"
        return ""

    def _rival(self, found: Explanation) -> str:
        """The same for another gap with another model, sought from the believed model's best gap elsewhere."""
        resolution = np.radians(self.settings.resolution_deg)
        starts = [s for s in self.further_starts() if abs(s[0] - found.estimate.fit_gap_rad) > resolution]
        if not starts:
            return ""
        begun = replace(found.estimate, gap_rad=starts[0][0], theta_d0_rad=starts[0][1], growth_rad_s=0.0)
        other = explained(self.problem, begun, self.settings.tolerances)
        margin_m2 = self._margin_m2(found.problem, found.estimate)
        gap = other.estimate.gap_rad
        if self._impossible(other.estimate) or abs(gap - found.estimate.gap_rad) <= resolution:
            return ""
        # beside a clearly better explanation an estimate is no minimum, and its standard error says nothing
        if other.cost_m2 < found.cost_m2 - margin_m2:
            return f"{np.degrees(gap):.0f} deg explains the buffer better"
        if other.cost_m2 <= found.cost_m2 + margin_m2 and self._far(np.array(gap), found.estimate):
            return f"{np.degrees(gap):.0f} deg explains the buffer as well"
        return ""

    def _against_present(self, estimate: Estimate) -> Verdict:
        present_deg, std_deg = np.degrees(self.present_rad), np.degrees(estimate.std_rad)
        if abs(estimate.gap_rad - self.present_rad) > self.settings.significance * estimate.std_rad:
            return Verdict(True, f"better than the present {present_deg:.1f} deg")
        if std_deg <= self.settings.precise_deg:
            return Verdict(True, f"agrees with the present {present_deg:.1f} deg", agrees=True)
        return Verdict(False, f"no better than the present {present_deg:.1f} deg: +- {std_deg:.1f} deg", settled=True)

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
    return attempts_of(Guard(problem, present_rad, settings), optimizer, start, rng)


def attempts_of(
    guard: Guard, optimizer: OptimizerLike, start: Start | None = None, rng: np.random.Generator | None = None
) -> list[Attempt]:
    """:func:`guarded_estimates` by a guard that is there already."""
    attempts = [_attempt(guard, optimizer, start or default_start(guard.problem, guard.present_rad), rng)]
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
    """Load what an estimation needs, so that ``wall_s`` is the estimation's own."""
    theta_m = np.linspace(0.0, 1.0, model.settle + 50)
    guard = Guard(Problem(theta_m, theta_m * model.pitch_m_per_rad, model), 0.0)
    guard.judged(estimate_gap(guard.problem, optimizer, (0.1, 0.0)))
    guard.scan()
    observer.filtered(theta_m, model.lags[0])


def _attempt(guard: Guard, optimizer: OptimizerLike, start: Start, rng: np.random.Generator | None) -> Attempt:
    return guard.judged(estimate_gap(guard.problem, optimizer, start, rng))
