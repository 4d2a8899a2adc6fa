"""The twin at work during a run: when it is asked, what it answers, and when its answer is in force."""

import math
import time
from dataclasses import dataclass, field
from typing import Any, TypedDict

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats, Ints
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import Belief
from dtbacklash.experiment.sensors import roles as roles_of
from dtbacklash.experiment.watch import Watcher
from dtbacklash.twin.guard import Attempt
from dtbacklash.twin.link import FullBuffer, TwinLink
from dtbacklash.twin.service import Answer, LocalTwin, Reply, Request, Twin, TwinService

#: samples between two looks for an answer that has not come
LOOK = 10


class EstimateRow(TypedDict):
    """One attempt of the twin, or a request that nobody answered: times s, gaps deg, cost mm^2.

    std_deg : standard error of gap_deg. applied_deg : what the controller gets. subsystem : what the indexes said of
    the buffer.
    """

    t_event_s: float
    t_applied_s: float
    gap_deg: float
    true_gap_deg: float
    accepted: bool
    reason: str
    cost: float
    evaluations: int
    wall_s: float
    std_deg: float
    applied_deg: float
    subsystem: str  # of runs that watch the indexes


class LateAnswer(TypedDict):
    """An answer that was not there when it should have come into force: to which event, and how late it came, s."""

    t_event_s: float
    late_s: float


ESTIMATE_COLUMNS = [name for name in EstimateRow.__annotations__ if name != "subsystem"]


def twin_of(config: RunConfig, belief: Belief) -> Twin:
    """The twin of a configuration whose ``auto`` is settled; raises UserError as :meth:`.service.Twin.of`."""
    output = list(belief.rig.sensors.values())[roles_of(belief.rig, True)[1]]
    return Twin.of(belief, output, config.twin, config.optimizer, config.sample_time_s)


@dataclass
class Estimation:
    """The twin and its link to the controller, from the first sample to the last.

    changes : samples at which the reference changes. seen : (N+1, sensors) what the sensors show, filled by the loop;
    roles : which of them are theta_m and q3. gap : (N+1,) the true half-gap, rad, for the table only. gap_hat : the
    half-gap that the controller believes in, rad. service : who estimates; None where the twin is never asked.
    asked : event -> the buffer of a request that nothing has come of yet, and the sample at which it was sent.
    rejected : the last estimate was, so that the twin is asked again for as long as the novelty index is high.
    wall_s : that the loop has stood still for the twin. late : answers that came after they were due.
    """

    config: RunConfig
    changes: Ints
    seen: Floats
    roles: tuple[int, int]
    gap: Floats
    link: TwinLink[Answer]
    service: TwinService | None
    gap_hat: float
    asked: dict[int, tuple[FullBuffer, int]] = field(default_factory=dict)
    rejected: bool = False
    rows: list[EstimateRow] = field(default_factory=list)
    wall_s: float = 0.0
    watcher: Watcher | None = None
    late: list[LateAnswer] = field(default_factory=list)

    @classmethod
    def prepare(
        cls,
        config: RunConfig,
        belief: Belief,
        changes: Ints,
        seen: Floats,
        roles: tuple[int, int],
        gap: Floats,
        service: TwinService | None = None,
    ) -> "Estimation":
        """The twin before the first sample; raises UserError where the rig is none that it has a model of.

        service : who estimates; None: a twin in this process, that believes in ``belief``.
        """
        first = math.radians(config.controller.gap_hat_deg or 0.0)
        link: TwinLink[Answer] = TwinLink(config.twin.buffer, config.twin.delay_s, config.sample_time_s)
        if config.controller.reconfigure == "never":
            service = None
        elif service is None:
            service = LocalTwin(twin_of(config, belief))
        return cls(config, changes, seen, roles, gap, link, service, first)

    def warm_up(self) -> None:
        """Make ready what an estimate needs."""
        if self.service is not None:
            self.service.warm_up()

    @property
    def listening(self) -> bool:
        """Whether the novelty index may raise an alarm: not while a buffer fills or an answer is on its way."""
        idle = self.link.next_sample() is None and not self.asked
        return self.config.controller.reconfigure == "novelty" and idle

    def stops(self, k: int) -> list[int]:
        """The next samples after k at which the twin has something to do."""
        found = []
        if self.config.controller.reconfigure == "reference_change":
            later = self.changes[np.searchsorted(self.changes, k, side="right") :]
            found += [int(later[0])] if later.size else []
        found += [k + LOOK] if self.asked else []
        due = self.link.next_sample()
        return found if due is None else [*found, max(due, k + 1)]

    def before(self, k: int) -> None:
        """What is due before sample k: buffers to open or to send, answers to put in force."""
        self._exchange(k)
        for answer in self.link.arrived(k):
            self.gap_hat = answer.gap_rad
        if self.config.controller.reconfigure == "reference_change":
            at = np.searchsorted(self.changes, k)
            if at < self.changes.size and self.changes[at] == k:
                self.link.open(k)

    def alarm(self, k: int) -> None:
        """The novelty index has risen above its threshold before sample k.

        The buffer begins at the last change of the reference: memory still holds the motion that raised the alarm. A
        new attempt after a rejected one begins at its own event instead, since the same samples would say the same.
        """
        before = self.changes[self.changes < k]
        last_change = int(before[-1]) if before.size else 0
        self.link.open(k, None if self.rejected else last_change)

    def alarmed(self, k: int) -> None:
        """An index beside the novelty index has raised an alarm: it calls the twin where that one does."""
        if self.listening:
            self.alarm(k)

    def table(self) -> pd.DataFrame:
        """A row an attempt, in the order of the attempts; with the subsystem where indexes are watched."""
        columns = ESTIMATE_COLUMNS if self.watcher is None else [*ESTIMATE_COLUMNS, "subsystem"]
        return pd.DataFrame(self.rows, columns=columns)

    def _exchange(self, k: int) -> None:
        """Send the buffer that is full before sample k, and take what has come."""
        if self.service is None:
            return
        began = time.perf_counter()
        if (full := self.link.full_buffer(k)) is not None:
            theta_m, q3 = (self.seen[full.first : full.stop, role] for role in self.roles)
            self.asked[full.event] = full, k
            self.service.ask(Request(full.event, full.first, theta_m, q3, self.gap_hat, self.config.seed))
        if self.asked:
            for reply in self.service.replies():
                self._take(reply, k)
            self.wall_s += time.perf_counter() - began

    def _take(self, reply: Reply, k: int) -> None:
        """What has come of a request before sample k: rows of the table, and the gap on its way to the controller."""
        full, sent = self.asked.pop(reply.request.event)
        answer = reply.answer
        self.rejected = answer is None or not answer.accepted
        if answer is None:
            self.rows.append(self._unanswered(full, reply.reason))
            return
        applied = math.nan
        if answer.accepted:
            due = self.link.send(sent, answer)
            applied = max(due, k) * self.config.sample_time_s
            if due < k:
                late_s = (k - due) * self.config.sample_time_s
                self.late.append({"t_event_s": full.event * self.config.sample_time_s, "late_s": late_s})
        self.rows += [self._row(full, answer, attempt, applied) for attempt in answer.attempts]

    def _row(self, full: FullBuffer, answer: Answer, attempt: Attempt, applied_s: float) -> EstimateRow:
        e, counts = attempt.estimate, attempt is answer.chosen
        return self._framed(full, {
            "t_applied_s": applied_s if counts else math.nan,
            "gap_deg": math.degrees(e.gap_rad if answer.guarded else e.fit_gap_rad),
            "accepted": attempt.verdict.accepted,
            "reason": attempt.verdict.reason,
            "cost": e.cost_m2 * 1e6,
            "evaluations": e.evaluations,
            "wall_s": e.wall_s,
            "std_deg": math.degrees(e.std_rad),
            "applied_deg": math.degrees(answer.gap_rad) if counts else math.nan,
        })  # fmt: skip

    def _unanswered(self, full: FullBuffer, reason: str) -> EstimateRow:
        nothing = dict.fromkeys(("t_applied_s", "gap_deg", "cost", "wall_s", "std_deg", "applied_deg"), math.nan)
        return self._framed(full, {**nothing, "accepted": False, "reason": reason, "evaluations": 0})

    def _framed(self, full: FullBuffer, said: dict[str, Any]) -> EstimateRow:
        """A row: what was said of a buffer, with what is known of it here."""
        middle = min((full.first + full.stop) // 2, self.gap.size - 1)
        known = {
            "t_event_s": full.event * self.config.sample_time_s,
            "true_gap_deg": math.degrees(self.gap[middle]),
            "subsystem": self.watcher.subsystem(full.first, full.stop) if self.watcher else "",
        }
        row: EstimateRow = {**known, **said}  # type: ignore[typeddict-item]
        return row
