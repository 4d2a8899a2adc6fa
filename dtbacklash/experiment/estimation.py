"""The twin at work during a run: when it is asked, what it answers, and when its answer is in force."""

import math
import time
from dataclasses import dataclass, field
from typing import TypedDict

import numpy as np
import pandas as pd

from dtbacklash.arrays import Floats, Ints
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import Belief
from dtbacklash.experiment.sensors import roles as roles_of
from dtbacklash.experiment.watch import Watcher
from dtbacklash.kept import kept
from dtbacklash.twin.estimate import Problem, default_start, estimate_gap
from dtbacklash.twin.guard import Attempt, GuardSettings, Verdict, guarded_estimates, outcome, warm_up
from dtbacklash.twin.link import FullBuffer, TwinLink
from dtbacklash.twin.observer import TwinModel, twin_model
from dtbacklash.twin.simulated import SimulatedProblem, Structure, corrected


class EstimateRow(TypedDict):
    """One attempt of the twin: times s, gaps deg, cost mm^2; std_deg: standard error of gap_deg; applied_deg: what the
    controller gets; subsystem: what the
    indexes said of the buffer.
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


ESTIMATE_COLUMNS = [name for name in EstimateRow.__annotations__ if name != "subsystem"]


@dataclass
class Estimation:
    """The twin and its link to the controller, from the first sample to the last.

    changes : samples at which the reference changes. seen : (N+1, sensors) what the sensors show, filled by the loop;
    roles : which of them are theta_m and q3. gap : (N+1,) the true half-gap, rad, for the table only. gap_hat : the
    half-gap that the controller believes in, rad. model : None where the twin is never asked. structures : what
    it simulates, with and without the effects that bend it; None where it is linear. rejected : the last
    estimate was, so that the twin is asked again for as long as the novelty index is high. wall_s : spent estimating.
    """

    config: RunConfig
    changes: Ints
    seen: Floats
    roles: tuple[int, int]
    gap: Floats
    link: TwinLink[float]
    model: TwinModel | None
    gap_hat: float
    structures: tuple[Structure, Structure] | None = None
    rejected: bool = False
    rows: list[EstimateRow] = field(default_factory=list)
    wall_s: float = 0.0
    watcher: Watcher | None = None

    @classmethod
    def prepare(
        cls, config: RunConfig, belief: Belief, changes: Ints, seen: Floats, roles: tuple[int, int], gap: Floats
    ) -> "Estimation":
        """The twin before the first sample; raises UserError where the rig is none that it has a model of."""
        first = math.radians(config.controller.gap_hat_deg or 0.0)
        link: TwinLink[float] = TwinLink(config.twin.buffer, config.twin.delay_s, config.sample_time_s)
        model = None
        if config.controller.reconfigure != "never":
            model = kept(
                twin_model,
                belief.linear().structure, config.twin.observer_pole_rad_s, config.sample_time_s, config.twin.settle,
            )  # fmt: skip
        structures = None
        if model is not None and config.twin.method == "simulate":
            output = list(belief.rig.sensors.values())[roles_of(belief.rig, True)[1]]
            bent, linear = (Structure.of(belief.rig, output, config.sample_time_s, one) for one in (False, True))
            structures = bent, linear
        return cls(config, changes, seen, roles, gap, link, model, first, structures)

    def warm_up(self) -> None:
        """Load (the first time: compile) what an estimate needs."""
        if self.model is not None:
            warm_up(self.model, self.config.optimizer)

    @property
    def listening(self) -> bool:
        """Whether the novelty index may raise an alarm: not while a buffer fills or an answer is on its way."""
        return self.config.controller.reconfigure == "novelty" and self.link.next_sample() is None

    def stops(self, k: int) -> list[int]:
        """The next samples after k at which the twin has something to do."""
        found = []
        if self.config.controller.reconfigure == "reference_change":
            later = self.changes[np.searchsorted(self.changes, k, side="right") :]
            found += [int(later[0])] if later.size else []
        due = self.link.next_sample()
        return found if due is None else [*found, max(due, k + 1)]

    def before(self, k: int) -> None:
        """What is due before sample k: buffers to open or to send, answers to put in force."""
        if (full := self.link.full_buffer(k)) is not None:
            self._estimate(full, k)
        for gap in self.link.arrived(k):
            self.gap_hat = gap
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

    def _estimate(self, full: FullBuffer, k: int) -> None:
        """The twin at work on a full buffer; what passes the guard is sent back."""
        began = time.perf_counter()
        guarded = self.config.twin.guard
        attempts = self._attempts(full)
        chosen = outcome(attempts)
        self.rejected = not chosen.verdict.accepted
        applied = math.nan
        if chosen.verdict.accepted:
            gap = chosen.applied_rad if guarded else chosen.estimate.fit_gap_rad
            applied = self.link.send(k, gap) * self.config.sample_time_s
        middle = min((full.first + full.stop) // 2, self.gap.size - 1)
        for attempt in attempts:
            e = attempt.estimate
            self.rows.append({
                "t_event_s": full.event * self.config.sample_time_s,
                "t_applied_s": applied if attempt is chosen else math.nan,
                "gap_deg": math.degrees(e.gap_rad if guarded else e.fit_gap_rad),
                "true_gap_deg": math.degrees(self.gap[middle]),
                "accepted": attempt.verdict.accepted,
                "reason": attempt.verdict.reason,
                "cost": e.cost_m2 * 1e6,
                "evaluations": e.evaluations,
                "wall_s": e.wall_s,
                "std_deg": math.degrees(e.std_rad),
                "applied_deg": math.degrees(gap) if attempt.verdict.accepted and attempt is chosen else math.nan,
                "subsystem": self.watcher.subsystem(full.first, full.stop) if self.watcher else "",
            })  # fmt: skip
        self.wall_s += time.perf_counter() - began

    def _problem(self, theta_m: Floats, q3: Floats, gap_max_rad: float) -> Problem:
        assert self.model is not None
        if self.structures is None:
            return Problem(theta_m, q3, self.model, gap_max_rad)
        simulated = SimulatedProblem(theta_m, q3, self.model, *self.structures, gap_max_rad)
        return corrected(simulated, self.config.optimizer, self.gap_hat)

    def _attempts(self, full: FullBuffer) -> list[Attempt]:
        """All tries on one buffer, each with what the guard said."""
        assert self.model is not None
        gap_max_deg = self.config.twin.gap_max_deg
        theta_m, q3 = (self.seen[full.first : full.stop, role] for role in self.roles)
        problem = self._problem(theta_m, q3, math.radians(gap_max_deg))
        rng = np.random.default_rng([self.config.seed, full.event])
        if self.config.twin.guard:
            settings = GuardSettings(gap_max_deg=gap_max_deg)
            return guarded_estimates(problem, self.config.optimizer, self.gap_hat, settings, rng=rng)
        estimate = estimate_gap(problem, self.config.optimizer, default_start(problem, self.gap_hat), rng)
        return [Attempt(estimate, Verdict(True, "not guarded"))]
