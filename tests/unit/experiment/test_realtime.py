"""In real time: the same trace, every sample at its instant, lateness told, and late answers put in force."""

import gc
import sys
import time
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest

from dtbacklash.config.compose import compose
from dtbacklash.control.belief import beliefs_of, settled
from dtbacklash.errors import UserError
from dtbacklash.experiment import run as running
from dtbacklash.experiment.estimation import answering
from dtbacklash.experiment.loop import NOVELTY, RAN
from dtbacklash.experiment.realtime import RealTime, undisturbed
from dtbacklash.experiment.run import run_scenario
from dtbacklash.report.run.text import pace_in_words
from dtbacklash.twin.link.service import LocalTwin

#: moves with a buffer that is full 0.3 s after each
SHORT = (
    "reference.period_s=1", "twin.buffer=300", "twin.settle=100", "profile=constant", "profile.start_deg=30",
)  # fmt: skip
NOVELTY_WORDS = ("controller=nimc_novelty", "twin.indexes=[frequency]", "twin.novelty_threshold_mm=0.02")


@pytest.mark.parametrize("words", [("controller=nimc_twin",), NOVELTY_WORDS], ids=["twin", "novelty"])
@pytest.mark.check
def test_the_trace_is_that_of_a_run_as_fast_as_it_goes_to_the_last_bit(words):
    free, real = (
        run_scenario(compose(*SHORT, *words, "duration_s=2.2", "twin.delay_s=1.2", f"pace={pace}"))
        for pace in ("free", "real")
    )
    pd.testing.assert_frame_equal(real.trace, free.trace, check_exact=True)
    drop = "wall_s"
    pd.testing.assert_frame_equal(
        real.estimates.drop(columns=drop), free.estimates.drop(columns=drop), check_exact=True
    )
    assert len(free.estimates) > 0
    assert free.summary["n_accepted"] > 0
    assert "pace" not in free.summary
    assert real.summary["pace"]["deadlines"] == 2201
    assert real.summary["pace"]["late_answers"] == []
    assert real.summary["wall_s"]["simulate"] > 2.1


def test_samples_come_at_their_instants_and_a_late_one_does_not_shift_those_after_it():
    clock = RealTime.of(50, 2e-3)
    began = []

    def advance(first, stop, before):
        began.append(time.perf_counter())
        if first == 10:
            time.sleep(0.015)
        return stop, RAN

    assert clock.run(advance, np.zeros(51), 0, 51, 0.0) == (51, RAN)
    after = np.array(began) - began[0]
    assert (after[1:10] >= 2e-3 * np.arange(1, 10) - 1e-4).all()
    told = clock.summary()
    assert told["deadlines"] == 51
    assert 6 <= told["missed"] < 51  # the one that slept, and those that were due meanwhile
    assert told["worst_ms"] >= 15.0
    assert told["met_share"] == 1.0 - told["missed"] / 51
    assert told["median_ms"] <= told["most_ms"] <= told["worst_ms"]


def test_it_ends_where_the_loop_ends_and_hands_on_the_novelty():
    clock, seen = RealTime.of(9, 1e-5), []
    novelty = np.arange(10.0)

    def advance(first, stop, before):
        seen.append((first, stop, before))
        return (stop, NOVELTY) if first == 3 else (stop, RAN)

    assert clock.run(advance, novelty, 1, 9, 0.5) == (4, NOVELTY)
    assert seen == [(1, 2, 0.5), (2, 3, 1.0), (3, 4, 2.0)]
    assert clock.summary()["deadlines"] == 3


def test_the_process_is_left_as_it_was():
    before = sys.getswitchinterval()
    with pytest.raises(KeyboardInterrupt), undisturbed():
        assert sys.getswitchinterval() < before
        assert not gc.isenabled()
        raise KeyboardInterrupt
    assert sys.getswitchinterval() == pytest.approx(before)
    assert gc.isenabled()


@dataclass
class Slow(LocalTwin):
    """A twin whose answers are there at the twentieth look after they were asked for; the loop looks every 10 ms."""

    looks: int = 0

    def ask(self, request):
        self.looks = 0
        super().ask(request)

    def replies(self):
        self.looks += 1
        return super().replies() if self.looks > 20 else []


def test_a_late_answer_counts_when_it_is_there_and_is_told():
    config = compose(*SHORT, "controller=nimc_twin", "twin.delay_s=0", "pace=real", "duration_s=1.3")
    beliefs = beliefs_of(config)
    result = run_scenario(config, service=Slow(answering(settled(config, beliefs), beliefs.twin)))
    row, unheard = result.estimates.to_dict("records")
    assert (unheard["reason"], unheard["accepted"]) == ("the run ended before an answer", False)
    (late,) = result.summary["pace"]["late_answers"]
    assert late["t_event_s"] == row["t_event_s"] == 0.5
    assert late["late_s"] == pytest.approx(0.2, abs=0.011)
    assert row["t_applied_s"] == pytest.approx(0.8 + late["late_s"])
    known = result.trace["gap_hat_deg"] > 0.0
    assert result.trace["t_s"][known].min() == pytest.approx(row["t_applied_s"])
    assert sum("s late" in line for line in pace_in_words(result.summary)) == 1


@pytest.mark.parametrize(("missed", "said"), [(5, False), (500, True)])
def test_a_run_that_misses_its_deadlines_ends_with_saying_so(missed, said):
    clock = RealTime.of(1000, 1e-3)
    clock.done_s[:] = np.where(np.arange(1001) < missed, 2e-3, 5e-4)
    *_, last = pace_in_words({"pace": clock.summary() | {"late_answers": []}})
    assert last.startswith(f"this was no real time: {100 * missed / 1001:.3g} % of the deadlines were missed") == said


def test_a_twin_that_is_called_by_hand_starts_no_process(monkeypatch):
    monkeypatch.setattr(running, "BackgroundTwin", None)
    assert run_scenario(compose("controller=imc", "duration_s=0.05", "pace=real")).summary["pace"]["deadlines"] == 51


def test_closing_the_loop_is_not_for_real_time():
    with pytest.raises(UserError, match=r"pace=real: closing the loop"):
        compose("experiment=close_the_loop", "pace=real")
    with pytest.raises(UserError, match=r"pace=fast: must be one of|pace=fast: choose one of"):
        compose("pace=fast")
