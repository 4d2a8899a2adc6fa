"""The twin as a service: the same request has the same answer, and what does not answer leaves the loop as it is."""

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import beliefs_of, settled
from dtbacklash.experiment.estimation import answering
from dtbacklash.experiment.run import run_scenario
from dtbacklash.twin.link.service import LocalTwin, Reply, Request


@pytest.fixture
def config() -> RunConfig:
    """Two moves with a gap of 40 degrees, of which the controller knows nothing at first."""
    overrides = ("controller=nimc_twin", "profile=constant", "profile.start_deg=40", "duration_s=36",
                 "reference.period_s=20", "twin.delay_s=2")  # fmt: skip
    return compose(*overrides)


@dataclass
class _Slow(LocalTwin):
    """A local twin whose replies come ``late`` calls late; None: never, a reason instead."""

    late: int | None = 0
    requests: list[Request] = field(default_factory=list)
    _calls: int = 0
    _held: list[tuple[int, Reply]] = field(default_factory=list)

    def ask(self, request: Request) -> None:
        self.requests.append(request)
        super().ask(request)

    def replies(self) -> list[Reply]:
        self._calls += 1
        for reply in super().replies():
            unanswered = Reply(reply.request, None, "no answer")
            self._held.append((self._calls + (self.late or 0), unanswered if self.late is None else reply))
        due = [reply for when, reply in self._held if when <= self._calls]
        self._held = [one for one in self._held if one[0] > self._calls]
        return due


def _run(config: RunConfig, late: int | None) -> tuple[pd.DataFrame, pd.DataFrame, list[Request]]:
    beliefs = beliefs_of(config)
    service = _Slow(answering(settled(config, beliefs), beliefs.twin), late=late)
    result = run_scenario(config, service=service)
    return result.trace, result.estimates.drop(columns="wall_s"), service.requests


def test_a_request_has_the_same_answer_twice_and_the_runs_own_twin_gives_it(config: RunConfig) -> None:
    trace, estimates, requests = _run(config, 0)
    beliefs = beliefs_of(config)
    twin = answering(settled(config, beliefs), beliefs.twin)
    one, two = twin.answer(requests[0]), twin.answer(requests[0])
    assert replace(one.chosen.estimate, wall_s=0.0) == replace(two.chosen.estimate, wall_s=0.0)
    assert one.accepted
    assert np.degrees(one.gap_rad) == estimates["applied_deg"].iloc[0]
    assert requests[0].stop - requests[0].first == config.twin.buffer
    plain = run_scenario(config)
    pd.testing.assert_frame_equal(plain.trace, trace, check_exact=True)


def test_no_answer_keeps_the_old_gap_and_says_why(config: RunConfig) -> None:
    trace, estimates, requests = _run(config, None)
    assert (trace["gap_hat_deg"] == 0.0).all()
    assert len(estimates) == len(requests) > 1
    assert set(estimates["reason"]) == {"no answer"}
    assert not estimates["accepted"].any()
    assert estimates["gap_deg"].isna().all()
    assert (estimates["true_gap_deg"] == 40.0).all()


def test_a_late_answer_comes_into_force_when_it_is_there(config: RunConfig) -> None:
    """The loop looks for what has not come every 10 ms."""
    on_time, late = _run(config, 0)[0], _run(config, 301)[0]
    applied = [float(t["t_s"][t["gap_hat_deg"] > 0.0].min()) for t in (on_time, late)]
    assert applied[0] == pytest.approx(13.0)
    assert applied[1] == pytest.approx(14.0, abs=0.011)  # full at 11 s, answered 3 s later instead of 2 s
