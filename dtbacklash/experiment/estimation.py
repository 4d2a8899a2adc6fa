"""The twin at work during a run: when it is asked, what it answers, and when its answer is in force."""

import math
import time
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypedDict

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats, Ints
from dtbacklash.config.run import OptimizerConfig, RunConfig, TwinConfig
from dtbacklash.control.belief import Belief
from dtbacklash.errors import UserError
from dtbacklash.experiment.novelty_monitor import Watcher
from dtbacklash.experiment.sensors import roles as roles_of
from dtbacklash.experiment.settling import AT_REST, HalfGap, at_rest
from dtbacklash.twin.gap.guard import Attempt
from dtbacklash.twin.link.bank_twin import BankTwin
from dtbacklash.twin.link.link import FullBuffer, TwinLink
from dtbacklash.twin.link.service import (
    RUN_ENDED,
    Answer,
    Answering,
    Dropped,
    Elsewhere,
    LocalTwin,
    Reply,
    Request,
    Twin,
    TwinService,
)

#: samples between two looks for an answer that has not come
LOOK = 10


class EstimateRow(TypedDict):
    """One attempt of the twin, or a request that nobody answered: times s, gaps deg, cost mm^2.

    std_deg : standard error of gap_deg. applied_deg : what the controller gets. subsystem : what the indexes said of
    the buffer. found : what the bank said of it.
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
    found: str  # of runs whose twin asks the bank


class LateAnswer(TypedDict):
    """An answer that was not there when it should have come into force: to which event, and how late it came, s."""

    t_event_s: float
    late_s: float


ESTIMATE_COLUMNS = [name for name in EstimateRow.__annotations__ if name not in ("subsystem", "found")]


def answering(config: RunConfig, belief: Belief) -> Answering:
    """The twin that ``twin.on_alarm`` asks for; raises UserError as :meth:`.service.Twin.of`."""
    output = list(belief.rig.sensors)[roles_of(belief.rig, True)[1]]
    return twin_from(belief, output, config.twin, config.optimizer, config.sample_time_s)


def twin_from(
    belief: Belief, output: str, settings: TwinConfig, optimizer: OptimizerConfig, sample_time_s: float
) -> Answering:
    """The twin that ``settings.on_alarm`` asks for.

    belief : what it believes at first; ``settings.method`` is for that. output : name of the sensor that shows q3.
    """
    # no closure: the twin may go to another process
    estimating = partial(_estimating, output, settings, optimizer, sample_time_s)
    if settings.on_alarm == "bank":
        motor = list(belief.rig.sensors)[roles_of(belief.rig, True)[0]]
        return BankTwin(belief, (motor, output), estimating, sample_time_s)
    if settings.method == "auto":
        return estimating(belief)
    return Twin.of(belief, belief.rig.sensors[output], settings, optimizer, sample_time_s)


def _estimating(
    output: str, settings: TwinConfig, optimizer: OptimizerConfig, sample_time_s: float, believed: Belief
) -> Twin:
    """The twin that estimates the gap alone, of another belief than the settings were settled for."""
    settings = replace(settings, method="simulate" if believed.bends() else "linear")
    return Twin.of(believed, believed.rig.sensors[output], settings, optimizer, sample_time_s)


@dataclass
class Estimation:
    """The twin and its link to the controller, from the first sample to the last.

    changes : samples at which the reference changes. seen : (N+1, sensors) what the sensors show, filled by the loop;
    roles : which of them are theta_m and q3. gap : (N+1,) the true half-gap, rad, for the table only. in_force :
    the half-gap that the controller believes in. service : who estimates; None where the twin is
    never asked.
    asked : event -> the buffer of a request that nothing has come of yet, and the sample at which it was sent.
    rejected : the last estimate was, so that the twin is asked again for as long as the novelty index is high.
    wall_s : that the loop has stood still for the twin. late : answers that came after they were due. u : (N+1,) the
    command, filled by the loop; asked for by the bank. belief : what is believed now. waiting : an answer with another
    model, until the loop is at rest. last_move : sample of the last change of the reference of which the bank was asked
    by an alarm.
    """

    config: RunConfig
    changes: Ints
    seen: Floats
    roles: tuple[int, int]
    gap: Floats
    link: TwinLink[tuple[Answer, int]]
    service: TwinService | None
    in_force: HalfGap
    asked: dict[int, tuple[FullBuffer, int]] = field(default_factory=dict)
    rejected: bool = False
    rows: list[EstimateRow] = field(default_factory=list)
    wall_s: float = 0.0
    watcher: Watcher | None = None
    late: list[LateAnswer] = field(default_factory=list)
    u: Floats | None = None
    belief: Belief | None = None
    waiting: tuple[Answer, int] | None = None
    last_move: int = -1
    _came_s: float = math.nan

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
        t, first = config.twin, math.radians(config.controller.gap_hat_deg or 0.0)
        in_force = HalfGap(first, config.sample_time_s, t.growth_s or 0.0, math.radians(t.gap_max_deg))
        bank = config.twin.on_alarm == "bank"
        length = config.twin.bank_buffer if bank else config.twin.buffer
        link: TwinLink[tuple[Answer, int]] = TwinLink(length, config.twin.delay_s, config.sample_time_s)
        if config.controller.reconfigure == "never":
            service = None
        elif service is None:
            if config.twin.where != "local":
                raise UserError("twin.where", config.twin.where, "a twin elsewhere is for dtb run and dtbacklash.run")
            service = LocalTwin(answering(config, belief))
        return cls(config, changes, seen, roles, gap, link, service, in_force, belief=belief)

    def warm_up(self) -> None:
        """Make ready what an estimate needs."""
        if self.service is not None:
            self.service.warm_up()

    @property
    def listening(self) -> bool:
        """Whether the novelty index may raise an alarm: not while a buffer fills or an answer is on its way."""
        idle = self.link.next_sample() is None and not self.asked and self.waiting is None
        return self.config.controller.reconfigure == "novelty" and idle

    def stops(self, k: int) -> list[int]:
        """The next samples after k at which the twin has something to do."""
        found = []
        if self.config.controller.reconfigure == "reference_change":
            found += self._next_change(k)
        found += [k + LOOK] if self.asked else []
        if self.waiting is not None:
            found += [k + LOOK, *self._next_change(k)]
        due = self.link.next_sample()
        if (judged := self.in_force.judged_at(self._last_change(k + 1))) is not None:
            found.append(max(judged, k + 1))
        if (until := self.in_force.grows_until()) is not None and until > k:
            found.append(until)
        return found if due is None else [*found, max(due, k + 1)]

    def before(self, k: int) -> None:
        """Do what is due before sample k: open or send buffers, put answers in force."""
        self.in_force.end_growth(k)
        judged = self.in_force.judged_at(self._last_change(k))
        if judged is not None and k >= judged:
            self._judge(k)
        self._exchange(k)
        for answer, middle in self.link.arrived(k):
            if answer.belief is not None:
                self.waiting, self._came_s = (answer, middle), k * self.config.sample_time_s
            elif self.waiting is None:
                self._put_in_force(answer, middle, k)
        if self.config.controller.reconfigure == "reference_change":
            at = np.searchsorted(self.changes, k)
            if at < self.changes.size and self.changes[at] == k:
                self.link.open(k, self._begin(k))

    def _put_in_force(self, answer: Answer, middle: int, k: int) -> None:
        """The gap of an answer at sample k: that in the ``middle`` of its buffer, and what it has grown since."""
        if not self.in_force.put(answer, middle, k):
            row, condemned_deg = self._last_accepted(), math.degrees(self.in_force.condemned_rad)
            row["t_applied_s"] = row["applied_deg"] = math.nan
            row["reason"] += f"; not put in force: the loop went round in {condemned_deg:.1f} deg"

    def _judge(self, k: int) -> None:
        """Keep the gap in force as one that rests, or go back to the last such one if the loop goes round in it."""
        if self.in_force.take_back(k, self.seen[:, self.roles[0]]):
            self._last_accepted()["reason"] += (
                f"; taken back at {k * self.config.sample_time_s:.2f} s: the loop went round in that gap"
            )

    def _last_accepted(self) -> EstimateRow:
        return next(row for row in reversed(self.rows) if row["accepted"])

    def alarm(self, k: int) -> None:
        """The novelty index has risen above its threshold before sample k.

        The buffer begins at the last change of the reference: memory still holds the motion that raised the alarm. A
        new attempt after a rejected one begins at its own event instead, since the same samples would say the same.
        """
        last_change = self._last_change(k)
        if self.config.twin.on_alarm == "bank":
            if last_change != self.last_move:  # of the same move it has said all that it can
                self.last_move = last_change
                self.link.open(k, self._begin(last_change))
            return
        self.link.open(k, None if self.rejected else last_change)

    def _last_change(self, k: int) -> int:
        before = self.changes[self.changes < k]
        return int(before[-1]) if before.size else 0

    def _next_change(self, k: int) -> list[int]:
        later = self.changes[np.searchsorted(self.changes, k, side="right") :]
        return [int(later[0])] if later.size else []

    def _begin(self, moved: int) -> int:
        """Where a buffer begins whose reference changes at ``moved``: the bank wants some rest before."""
        return max(moved - self.config.twin.bank_rest, 0) if self.config.twin.on_alarm == "bank" else moved

    def taken_up(self, k: int) -> Answer | None:
        """An answer with another model, once: when the loop is at rest, or just before the reference changes again."""
        if self.waiting is None:
            return None
        answer, middle = self.waiting
        held = k in self.changes and self._last_change(k) <= k - 2 * AT_REST
        if not (held or at_rest(self.seen, self.roles, self.changes, k)):
            return None
        self.waiting = None
        if answer.accepted:
            self._put_in_force(answer, middle, k)
        self.belief = answer.belief
        for row in self.rows:
            if row.get("found") == answer.found and row["t_applied_s"] == self._came_s:
                row["t_applied_s"] = k * self.config.sample_time_s
        return answer

    def alarmed(self, k: int, index: str) -> None:
        """An index beside the novelty index has raised an alarm: it calls the twin where that one does.

        A motor that has changed says nothing of the gap: that alarm is one for the bank alone.
        """
        if self.listening and (index != "motor" or self.config.twin.on_alarm == "bank"):
            self.alarm(k)

    def table(self) -> pd.DataFrame:
        """A row an attempt, in the order of the attempts; with the subsystem where indexes are watched."""
        columns = [*ESTIMATE_COLUMNS, *["subsystem"] * (self.watcher is not None)]
        columns += ["found"] * (self.config.twin.on_alarm == "bank")
        rows = [*self.rows, *(self._unanswered(full, RUN_ENDED) for full, _ in self.asked.values())]
        if isinstance(self.service, Elsewhere):
            rows = sorted(
                [*rows, *map(self._lost, self.service.dropped())],
                key=lambda row: -1.0 if math.isnan(row["t_event_s"]) else row["t_event_s"],
            )
        return pd.DataFrame(rows, columns=columns)

    def _exchange(self, k: int) -> None:
        """Send the buffer that is full before sample k, and take the replies."""
        if self.service is None:
            return
        began = time.perf_counter()
        if (full := self.link.full_buffer(k)) is not None:
            theta_m, q3 = (self.seen[full.first : full.stop, role] for role in self.roles)
            self.asked[full.event] = full, k
            request = Request(full.event, full.first, theta_m, q3, self.in_force.at(k), self.config.seed)
            if self.u is not None and self.config.twin.on_alarm == "bank":
                moved = self._last_change(full.event + 1)
                request = replace(request, u=self.u[full.first : full.stop], moved=moved, believed=self.belief)
            self.service.ask(request)
        if self.asked:
            for reply in self.service.replies():
                self._take(reply, k)
            self.wall_s += time.perf_counter() - began

    def _take(self, reply: Reply, k: int) -> None:
        """Take a reply that has come before sample k: write its rows, and send its gap to the controller."""
        full, sent = self.asked.pop(reply.request.event)
        answer = reply.answer
        self.rejected = answer is None or not answer.accepted
        if answer is None:
            self.rows.append(self._unanswered(full, reply.reason))
            return
        applied = math.nan
        if answer.accepted or answer.belief is not None:
            due = self.link.send(sent, (answer, (full.first + full.stop) // 2))
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
            "found": answer.found if counts else "",
        })  # fmt: skip

    def _unanswered(self, full: FullBuffer, reason: str) -> EstimateRow:
        nothing = dict.fromkeys(("t_applied_s", "gap_deg", "cost", "wall_s", "std_deg", "applied_deg"), math.nan)
        return self._framed(full, {**nothing, "accepted": False, "reason": reason, "evaluations": 0, "found": ""})

    def _lost(self, dropped: Dropped) -> EstimateRow:
        """A row for answers that failed a check, at the event of the request before them."""
        request = dropped.request
        full = FullBuffer(0, 0, 0) if request is None else FullBuffer(request.event, request.first, request.stop)
        times = "" if dropped.count == 1 else f" {dropped.count} times"
        row = self._unanswered(full, f"dropped{times}: {dropped.reason}")
        if request is None:
            row["t_event_s"] = math.nan
        return row

    def _framed(self, full: FullBuffer, said: dict[str, Any]) -> EstimateRow:
        """A row: what a reply says about a buffer, and what is known about it here."""
        middle = min((full.first + full.stop) // 2, self.gap.size - 1)
        known = {
            "t_event_s": full.event * self.config.sample_time_s,
            "true_gap_deg": math.degrees(self.gap[middle]),
            "subsystem": self.watcher.subsystem(full.first, full.stop) if self.watcher else "",
        }
        row: EstimateRow = {**known, **said}  # type: ignore[typeddict-item]
        return row
