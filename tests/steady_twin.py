"""A twin that needs no model: it always answers with the same gap."""

import math
from dataclasses import dataclass, field

from dtbacklash.twin.gap.estimate import Estimate
from dtbacklash.twin.gap.guard import Attempt, Verdict
from dtbacklash.twin.link.service import Answer, Reply


@dataclass
class SteadyTwin:
    """The service of such a twin; gap : its answer, rad."""

    gap: float
    waiting: list = field(default_factory=list)

    def warm_up(self):
        pass

    def ask(self, request):
        estimate = Estimate(self.gap, self.gap, 0.0, 0.0, 0.0, 0.0, math.inf, 1, True, "", 0.0)
        answer = Answer((Attempt(estimate, Verdict(True, "sure"), self.gap),), True, 0.0)
        self.waiting.append(Reply(request, answer))

    def replies(self):
        found, self.waiting = self.waiting, []
        return found
