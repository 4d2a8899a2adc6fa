"""A guard by the likelihood ratio alone, to compare with: it knows noise, and nothing of a wrong model.

An estimate passes if it lies inside the bounds, converged, follows from a contact that the cost saw, if gaps a degree
to either side and gaps elsewhere fit clearly worse, and if it fits clearly better than the present gap or agrees with
it. "Clearly" is a growth of the sum of squares by ``SIGNIFICANCE`` times the noise, taken from the residual.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.estimate import Estimate, OptimizerLike, Problem, default_start, estimate_gap
from dtbacklash.twin.gap.guard import Attempt, Guard, Verdict, profile

RESOLUTION_DEG, SIGNIFICANCE, AGREEMENT_DEG = 1.0, 16.0, 0.25


class LikelihoodGuard(Guard):
    """Judges estimates from one buffer against the gap in force by likelihood ratios of the plain model."""

    def judged(self, estimate: Estimate) -> Attempt:
        """The estimate as it is, and the verdict on it."""
        verdict = self._verdict(estimate)
        limit = float(np.radians(self.settings.gap_max_deg))
        estimate = replace(estimate, gap_rad=min(max(estimate.gap_rad, 0.0), limit)) if verdict.accepted else estimate
        return Attempt(estimate, verdict, estimate.gap_rad)

    def _verdict(self, estimate: Estimate) -> Verdict:
        if not (0.0 <= estimate.gap_rad <= np.radians(self.settings.gap_max_deg) and estimate.converged):
            return Verdict(False, f"out of bounds, or not converged: {estimate.message}")
        model, problem = self.problem.model, self.problem
        seen = max(0, model.settle - round(4.0 / (model.pole_rad_s * model.sample_time_s)))
        theta_d = observer.play(problem.theta_m, estimate.fit_gap_rad, estimate.theta_d0_rad, 0.0)[seen:]
        if np.sum(np.abs(np.diff(theta_d))) < np.radians(self.settings.travel_deg):
            return Verdict(False, "no contact seen in the buffer")
        error = problem.rows(estimate.fit_gap_rad, estimate.theta_d0_rad)[0]
        enough = estimate.cost_m2 + SIGNIFICANCE * problem.noise_m2(error) / problem.counted
        sides = estimate.fit_gap_rad + np.radians([-RESOLUTION_DEG, RESOLUTION_DEG])
        if np.min(profile(problem, sides[sides >= 0.0])[0]) <= enough:
            return Verdict(False, "the buffer does not determine the gap")
        far = np.abs(self.scan_rad - estimate.fit_gap_rad) > np.radians(RESOLUTION_DEG)
        if np.min(self.scan()[0][far]) <= enough:
            return Verdict(False, "another gap explains the buffer as well")
        if abs(estimate.gap_rad - self.present_rad) <= np.radians(AGREEMENT_DEG):
            return Verdict(True, "agrees with the present")
        if profile(problem, np.array([self.present_rad]))[0][0] <= enough:
            return Verdict(False, "no better than the present", settled=True)
        return Verdict(True, "better than the present")


def likelihood_estimates(problem: Problem, optimizer: OptimizerLike, present_rad: float) -> list[Attempt]:
    """As :func:`dtbacklash.twin.gap.guard.guarded_estimates`, by the likelihood ratio alone."""
    guard, attempts = LikelihoodGuard(problem, present_rad), list[Attempt]()
    for start in [default_start(problem, present_rad), *guard.further_starts()][: guard.settings.attempts]:
        attempts.append(guard.judged(estimate_gap(problem, optimizer, start)))
        if attempts[-1].verdict.accepted or attempts[-1].verdict.settled:
            break
    return attempts
