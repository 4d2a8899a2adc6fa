"""A twin that asks the bank: it answers with a gap and, where something else has changed, with another model."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.control.belief import Belief
from dtbacklash.errors import UserError
from dtbacklash.twin.bank.bank import Buffer, Diagnosis, diagnose_buffer
from dtbacklash.twin.gap.estimate import Estimate
from dtbacklash.twin.gap.guard import Attempt, Verdict
from dtbacklash.twin.link.service import Answer, Request, Twin

#: a gap whose standard error is greater is not put in force: the old one is kept as far as the interval allows, rad
UNSURE_RAD = math.radians(2.0)
#: what a hypothesis that leaves only noise may still leave out of the gap, rad
SHADE_RAD = math.radians(0.5)


@dataclass
class BankTwin:
    """The bank beside the twin that estimates the gap alone, to which a buffer goes that the bank cannot explain.

    belief : what is believed where a request does not say it. twin_for : the estimating twin of a belief.
    """

    belief: Belief
    twin_for: Callable[[Belief], Twin]
    sample_time_s: float

    def __post_init__(self) -> None:
        self._twin = self.belief, self.twin_for(self.belief)

    def warm_up(self) -> None:
        """Load (the first time: compile) what an answer needs."""
        self._twin[1].warm_up()
        rest = np.zeros(500)
        diagnose_buffer(self.belief, Buffer(rest, rest, rest, self.sample_time_s), 0.0)

    def answer(self, request: Request) -> Answer:
        """What the bank says; the estimate of the gap alone, through its guard, where the bank knows of none."""
        began = time.perf_counter()
        if request.u is None:
            raise UserError("twin.on_alarm", "bank", "estimate, where the command is not sent with the buffer")
        belief = request.believed or self.belief
        buffer = Buffer(request.u, request.theta_m, request.q3, self.sample_time_s)
        said = diagnose_buffer(belief, buffer, request.present_rad)
        if math.isnan(said.gap_rad):
            answer = self._estimating(belief).answer(self._shortened(request))
            return replace(answer, wall_s=time.perf_counter() - began, found=said.found)
        attempt = _attempt(said, request.present_rad)
        changed = said.belief if said.changes and all(change.sure for change in said.changes) else None
        return Answer((attempt,), True, time.perf_counter() - began, said.found, changed)

    def _estimating(self, belief: Belief) -> Twin:
        if belief is not self._twin[0]:
            self._twin = belief, self.twin_for(belief)
        return self._twin[1]

    def _shortened(self, request: Request) -> Request:
        """The request as the estimating twin has it: from the event on, and not longer than its buffer."""
        first = max(request.moved, request.first) - request.first
        stop = first + self._twin[1].settings.buffer
        return replace(
            request, first=request.first + first, theta_m=request.theta_m[first:stop], q3=request.q3[first:stop]
        )


def _attempt(said: Diagnosis, present_rad: float) -> Attempt:
    """The bank's gap, shaded low by its standard error, at least SHADE_RAD: a gap that is too large costs more."""
    applied = max(said.gap_rad - max(said.gap_std_rad, SHADE_RAD), 0.0)
    if said.gap_std_rad > UNSURE_RAD:
        low, high = said.gap_rad - 2.0 * said.gap_std_rad, said.gap_rad + 2.0 * said.gap_std_rad
        applied = max(min(max(present_rad, low), high), 0.0)
    estimate = Estimate(
        said.gap_rad, said.gap_rad, math.nan, math.nan, said.gap_std_rad, said.halves[0].growth_rad_s,
        said.halves[0].growth_std_rad_s, 0, True, said.found, said.wall_s,
    )  # fmt: skip
    return Attempt(estimate, Verdict(True, f"the bank: {said.found}"), applied)
