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
import time
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtbacklash.core.library import buffer, ffi, lib, struct
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.estimate import (
    ENDS,
    Estimate,
    Method,
    OptimizerLike,
    Problem,
    Start,
    default_start,
    estimate_of,
    estimate_struct,
)
from dtbacklash.twin.gap.model_error import Tolerances, model_error
from dtbacklash.twin.gap.observer import Path, TwinModel

Array = NDArray[np.float64]

#: why an estimate goes to the controller or not, by the core's number
REASONS = {
    lib.BETTER: "better than the present {about:.1f} deg",
    lib.AGREES: "agrees with the present {about:.1f} deg",
    lib.NO_BETTER: "no better than the present {about:.1f} deg: +- {std:.1f} deg",
    lib.OUTSIDE: "{about:.1f} deg is outside 0..{limit:g} deg",
    lib.NOT_CONVERGED: "not converged: {message}",
    lib.NO_CONTACT: "no contact seen in the buffer",
    lib.NOT_DETERMINED: "the buffer does not determine the gap",
    lib.ELSEWHERE: "{about:.0f} deg explains the buffer as well",
    lib.RIVAL_BETTER: "{about:.0f} deg explains the buffer better",
    lib.RIVAL: "{about:.0f} deg explains the buffer as well",
}


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
class Explanation:
    """A buffer explained: by the model that does it best (``problem``), the estimate with its standard error.

    cost_m2: mean square error and what the deviations from the believed model cost beside it. doubted: whether there
    was anything to explain; without, problem and estimate are as they came.
    """

    problem: Problem
    estimate: Estimate
    cost_m2: float
    doubted: bool


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
        ask = self.settings = settings or GuardSettings()
        self.scan_rad = scan_of(ask)
        self._profile, self._eps_q = np.empty((2, self.scan_rad.size)), np.empty(problem.theta_m.size)
        self.struct = struct(
            "Guard", problem=problem.struct(), wrong=model_error(problem.model, ask.tolerances),
            settings=settings_struct(ask), present=present_rad, eps_q=self._eps_q, profile=self._profile.ravel(),
            other=np.empty(self._profile.size),
        )  # fmt: skip

    def scan(self) -> tuple[Array, Array]:
        """The profile over the whole physical range, costs [m^2] and starts [rad], computed once."""
        self.further_starts()
        return self._profile[0], self._profile[1]

    def further_starts(self) -> list[Start]:
        """Starts for further attempts: the profile's valleys on the grid, the deepest first."""
        which = np.empty(self.scan_rad.size, dtype=np.int64)
        n = lib.dtb_valleys(self.struct, buffer(which))
        return [(float(self.scan_rad[i]), float(self._profile[1, i])) for i in which[:n]]

    def judged(self, estimate: Estimate) -> Attempt:
        """The estimate with its standard error, and the verdict on it."""
        found = ffi.new("GapAttempt *")
        lib.dtb_judge(self.struct, estimate_struct(estimate), found)
        end = found.estimate.end
        return self._attempt(found, estimate.message if end == lib.OTHERWISE else ENDS[end], estimate.wall_s)

    def explained(self, estimate: Estimate) -> Explanation:
        """The best explanation about an estimate."""
        found, about, n = ffi.new("GapEstimate *"), np.empty(2), self.problem.model.from_theta_d.b.size
        path = np.empty(2 * n + 1)
        lib.dtb_explain(self.struct, estimate_struct(estimate), found, buffer(about), buffer(path))
        message = estimate.message if found.end == lib.OTHERWISE else ENDS[found.end]
        better, doubted, problem = estimate_of(found, message, estimate.wall_s), bool(about[1]), copy(self.problem)
        if doubted:
            problem.eps_q = self._eps_q.copy()
            explaining = Path(problem.model.lags.phi, path[:n], float(path[2 * n]), path[n : 2 * n])
            problem.model = replace(problem.model, from_theta_d=explaining)
        return Explanation(problem, better, float(about[0]), doubted)

    def attempts(self, optimizer: OptimizerLike, start: Start | None = None,
                 rng: np.random.Generator | None = None) -> list[Attempt]:  # fmt: skip
        """See :func:`guarded_estimates`."""
        began, method = time.perf_counter(), Method(self.problem, optimizer, rng)
        begin = np.array(start or default_start(self.problem, self.present_rad))
        found = ffi.new("GapAttempt[]", self.settings.attempts)
        n = lib.dtb_attempts(self.struct, method.struct, buffer(begin, 2), found)
        method.calls.check()
        wall_s = (time.perf_counter() - began) / n
        return [self._attempt(found[i], method.said(found[i].estimate.end), wall_s) for i in range(n)]

    def _attempt(self, found: Any, message: str, wall_s: float) -> Attempt:
        """An attempt of the core's; its reason in words."""
        estimate, about = estimate_of(found.estimate, message, wall_s), np.degrees(found.about)
        reason = REASONS[found.reason].format(
            about=about, limit=self.settings.gap_max_deg, message=message, std=np.degrees(estimate.std_rad)
        )
        verdict = Verdict(bool(found.accepted), reason, bool(found.settled), bool(found.agrees))
        return Attempt(estimate, verdict, found.applied)


def scan_of(ask: GuardSettings) -> Array:
    """The half-gaps at which the guard looks for other valleys, rad."""
    limit = ask.gap_max_deg
    return np.asarray(np.radians(np.linspace(0.0, limit, max(2, int(np.ceil(limit / ask.scan_step_deg)) + 1))))


def settings_struct(ask: GuardSettings) -> Any:
    """What the guard asks for, as the core takes it."""
    angles = {"gap_most": ask.gap_max_deg, "agreement": ask.agreement_deg, "precise": ask.precise_deg,
              "travel": ask.travel_deg, "resolution": ask.resolution_deg}  # fmt: skip
    scan = scan_of(ask)
    return struct(
        "GuardSettings", **{name: float(np.radians(value)) for name, value in angles.items()}, attempts=ask.attempts,
        significance=ask.significance, shading=ask.shading, scans=scan.size, scan=scan,
    )  # fmt: skip


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
    return Guard(problem, present_rad, settings).attempts(optimizer, start, rng)


def outcome(attempts: list[Attempt]) -> Attempt:
    """The attempt that counts: the accepted one, else the one that explains the buffer best."""
    return min(
        attempts,
        key=lambda a: (not a.verdict.accepted, not np.isfinite(a.estimate.cost_m2), a.estimate.cost_m2),
    )


def warm_up(model: TwinModel, optimizer: OptimizerLike) -> None:
    """Load what an estimation needs, so that ``wall_s`` is the estimation's own."""
    theta_m = np.linspace(0.0, 1.0, model.settle + 50)
    guarded_estimates(Problem(theta_m, theta_m * model.pitch_m_per_rad, model), optimizer, 0.0)
