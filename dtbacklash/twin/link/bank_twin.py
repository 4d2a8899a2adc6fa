"""A twin that asks the bank: it answers with a gap and, where something else has changed, with another model."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from dtbacklash.control.belief import Belief
from dtbacklash.errors import UserError
from dtbacklash.twin.link.service import Answer, Request, Twin

if TYPE_CHECKING:
    from dtbacklash.twin.bank.bank import Buffer, Diagnosis


@dataclass
class BankTwin:
    """The bank beside the twin that estimates the gap alone, which it does with the model that the bank has left.

    belief : what is believed where a request does not say it. sensors : names of those of theta_m and q3.
    twin_for : the estimating twin of a belief. before : the last buffer that a law explains, with its gap: one that
    acts one way looks like others, and like a gap that grows, until a move the other way.
    """

    belief: Belief
    sensors: tuple[str, str]
    twin_for: Callable[[Belief], Twin]
    sample_time_s: float
    before: tuple[Belief, Buffer, float] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        self._twin = self.belief, self.twin_for(self.belief)

    def warm_up(self) -> None:
        """Load what an answer needs."""
        self._twin[1].warm_up()
        from dtbacklash.twin.bank.bank import warm_up

        warm_up(self.belief, self.sensors, self.sample_time_s)

    def answer(self, request: Request) -> Answer:
        """The gap as without the bank, with the model that the bank names; without a name, that of before."""
        began = time.perf_counter()
        if request.u is None:
            raise UserError("twin.on_alarm", "bank", "estimate, where the command is not sent with the buffer")
        belief = request.believed or self.belief
        said = self._said(belief, request)
        changed = None
        if said.verdict == "changed" and said.sure:
            try:
                said.belief.linear()
                self.twin_for(said.belief)
                changed = said.belief
            except UserError:  # a model that no twin and no design is made for
                pass
        answer = self._estimating(changed or belief).answer(self._shortened(request))
        return replace(answer, wall_s=time.perf_counter() - began, found=said.found, belief=changed)

    def _said(self, belief: Belief, request: Request) -> Diagnosis:
        """The bank's word on a buffer; of a law, only where the two last ones have it together."""
        from dtbacklash.twin.bank.bank import Buffer, diagnose_buffers

        assert request.u is not None
        readings = dict(zip(self.sensors, (request.theta_m, request.q3), strict=True))
        buffer = Buffer(request.u, readings, self.sample_time_s)
        said = diagnose_buffers(belief, [buffer], [request.present_rad])
        if not said.names or not said.is_law:
            self.before = None
            return said
        earlier, self.before = self.before, (belief, buffer, said.gap_rad)
        if earlier is not None and earlier[0] is belief:
            both = diagnose_buffers(belief, [earlier[1], buffer], [earlier[2], said.gap_rad])
            if both.verdict == "changed" and both.names[0] in said.names:
                return both
        return replace(said, sure=False)

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
