"""What the controller asks of the twin, what the twin answers, and who answers.

A twin is a function: a :class:`Request` holds all that an answer hangs on but what the twin believes of the structure,
so that the same request has the same answer in the loop's own process, in another one, and at the end of a network.
The controller meets it through a :class:`TwinService`, which may answer at once or later, or not at all.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.run import OptimizerConfig, TwinConfig
from dtbacklash.control.belief import Belief
from dtbacklash.physics.rig import Sensor
from dtbacklash.result_cache import kept
from dtbacklash.twin.gap.estimate import Problem, default_start, estimate_gap
from dtbacklash.twin.gap.guard import Attempt, GuardSettings, Verdict, guarded_estimates, outcome, warm_up
from dtbacklash.twin.gap.observer import TwinModel, twin_model
from dtbacklash.twin.gap.simulated import SimulatedProblem, Structure, corrected


@dataclass(frozen=True)
class Request:
    """A buffer of measurements, and what is in force while it is sent.

    event : sample at which the twin was called. first : sample at which the buffer begins. theta_m : (N,) measured
    angle of the motor, rad. q3 : (N,) measured position, m. present_rad : half-gap in force. seed : of the run.
    u : (N,) command, V; None where the twin does not ask for it. moved : sample at which the reference changed last.
    believed : what is believed of the machine; None: what the twin has believed from the beginning.
    """

    event: int
    first: int
    theta_m: Floats
    q3: Floats
    present_rad: float
    seed: int
    u: Floats | None = None
    moved: int = 0
    believed: Belief | None = None

    @property
    def stop(self) -> int:
        """The sample after the buffer's last."""
        return self.first + self.theta_m.size


@dataclass(frozen=True)
class Answer:
    """What the twin says of a buffer.

    attempts : at least one. guarded : whether the guard has judged them. wall_s : time that the answer took.
    found : what has changed, in a few words, where the twin looks for that. belief : what to believe from now on; None:
    what was believed.
    """

    attempts: tuple[Attempt, ...]
    guarded: bool
    wall_s: float
    found: str = ""
    belief: Belief | None = None

    @property
    def chosen(self) -> Attempt:
        """The attempt that counts."""
        return outcome(list(self.attempts))

    @property
    def accepted(self) -> bool:
        """Whether there is a gap to put in force."""
        return self.chosen.verdict.accepted

    @property
    def gap_rad(self) -> float:
        """The half-gap to put in force; NaN where none is."""
        if not self.accepted:
            return math.nan
        return self.chosen.applied_rad if self.guarded else self.chosen.estimate.fit_gap_rad


@dataclass(frozen=True)
class Reply:
    """What has come of a request: an answer, or the reason why there is none."""

    request: Request
    answer: Answer | None
    reason: str = ""


#: what is said of a request that nothing had come of when the run ended
RUN_ENDED = "the run ended before an answer"


@dataclass(frozen=True)
class Dropped:
    """Answers that failed a check, and are no answers: how many, why, and the request that they came after, if any."""

    request: Request | None
    reason: str
    count: int


class TwinService(Protocol):
    """Someone who answers requests. None of its methods waits for longer than the loop may wait."""

    def warm_up(self) -> None:
        """Make ready what the first answer needs."""

    def ask(self, request: Request) -> None:
        """Take a request; what comes of it is among the :meth:`replies` some day."""

    def replies(self) -> list[Reply]:
        """What has come since the last call, in the order in which it came."""


@runtime_checkable
class Elsewhere(Protocol):
    """What a service whose twin is elsewhere has to say beside its replies."""

    def dropped(self) -> list[Dropped]:
        """What was dropped on the way."""


@dataclass(frozen=True)
class Twin:
    """The twin: what it believes of the structure, and how it works.

    structures : what it simulates, with and without the effects that bend it; None where it is linear.
    """

    model: TwinModel
    settings: TwinConfig
    optimizer: OptimizerConfig
    structures: tuple[Structure, Structure] | None = None

    @classmethod
    def of(
        cls, belief: Belief, output: Sensor, settings: TwinConfig, optimizer: OptimizerConfig, sample_time_s: float
    ) -> Twin:
        """From what is believed of the rig; ``output`` : the sensor of it that shows q3.

        ``settings.method`` is ``linear`` or ``simulate`` here, no longer ``auto``.

        Raises
        ------
        UserError : the rig is no screw-driven chain of masses.
        """
        model = kept(
            twin_model, belief.linear().structure, settings.observer_pole_rad_s, sample_time_s, settings.settle
        )  # fmt: skip
        if settings.method != "simulate":
            return cls(model, settings, optimizer)
        bent, linear = (Structure.of(belief.rig, output, sample_time_s, one) for one in (False, True))
        return cls(model, settings, optimizer, (bent, linear))

    def warm_up(self) -> None:
        """Load what an estimate needs."""
        warm_up(self.model, self.optimizer)

    def answer(self, request: Request) -> Answer:
        """All tries on one buffer, each with what the guard says."""
        began = time.perf_counter()
        problem = self._problem(request)
        rng = np.random.default_rng([request.seed, request.event])
        if self.settings.guard:
            ask = self.guard_settings()
            attempts = guarded_estimates(problem, self.optimizer, request.present_rad, ask, rng=rng)
        else:
            start = default_start(problem, request.present_rad)
            estimate = estimate_gap(problem, self.optimizer, start, rng)
            attempts = [Attempt(estimate, Verdict(True, "not guarded"))]
        return Answer(tuple(attempts), self.settings.guard, time.perf_counter() - began)

    def guard_settings(self) -> GuardSettings:
        """What the guard asks for."""
        shading = 1.0 if self.settings.shading is None else self.settings.shading
        return GuardSettings(gap_max_deg=self.settings.gap_max_deg, shading=shading)

    def _problem(self, request: Request) -> Problem:
        limit = math.radians(self.settings.gap_max_deg)
        if self.structures is None:
            return Problem(request.theta_m, request.q3, self.model, limit)
        simulated = SimulatedProblem(request.theta_m, request.q3, self.model, *self.structures, limit)
        return corrected(simulated, self.optimizer, request.present_rad)


class Answering(Protocol):
    """A twin of any kind."""

    def warm_up(self) -> None:
        """Make ready what the first answer needs."""

    def answer(self, request: Request) -> Answer:
        """What it says of a buffer."""


@dataclass
class LocalTwin:
    """A twin in the loop's own process: the loop stands still while it works, and simulated time with it."""

    twin: Answering
    _done: list[Reply] = field(default_factory=list)

    def warm_up(self) -> None:
        """See :class:`TwinService`."""
        self.twin.warm_up()

    def ask(self, request: Request) -> None:
        """See :class:`TwinService`."""
        self._done.append(Reply(request, self.twin.answer(request)))

    def replies(self) -> list[Reply]:
        """See :class:`TwinService`."""
        done, self._done = self._done, []
        return done
