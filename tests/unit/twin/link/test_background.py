"""A twin in a process of its own gives the answer that it gives here, and goes with the loop."""

import time
from dataclasses import replace

import numpy as np
import pytest

from dtbacklash import source_hash
from dtbacklash.config.compose import compose
from dtbacklash.control.belief import beliefs_of, settled
from dtbacklash.errors import Failure, UserError
from dtbacklash.experiment.estimation import answering
from dtbacklash.twin.link import background
from dtbacklash.twin.link.background import GONE, BackgroundTwin
from dtbacklash.twin.link.service import Request


@pytest.fixture(autouse=True)
def packaged(monkeypatch):
    """Laws that other tests of this process have declared are none of the twin's."""
    monkeypatch.setattr(source_hash, "_foreign", set())


def twin(*words):
    config = compose("controller=nimc_twin", "twin.buffer=300", "twin.settle=100", *words)
    beliefs = beliefs_of(config)
    return answering(settled(config, beliefs), beliefs.twin)


def request(event=7):
    t = 1e-3 * np.arange(300)
    both = np.column_stack([3.0 * np.sin(9.0 * t), 8e-4 * np.sin(9.0 * t - 0.2)])
    return Request(event, 7, both[:, 0], both[:, 1], 0.1, 0)  # columns, as the loop has them


def wait(service, seconds=240.0):  # a cold worker compiles first, beside what else a machine does
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if found := service.replies():
            return found
        time.sleep(0.01)
    raise AssertionError("no reply")


def without_times(answer):
    return [replace(one.estimate, wall_s=0.0) for one in answer.attempts], [one.verdict for one in answer.attempts]


@pytest.mark.parametrize("words", [(), ("twin.method=simulate",)], ids=["linear", "simulate"])
def test_the_answers_are_those_of_this_process_to_the_last_bit_and_in_order(words):
    made = twin(*words)
    with BackgroundTwin(made) as service:
        service.warm_up()
        service.ask(request(7))
        (first,) = wait(service)
        service.ask(request(9))
        service.ask(request(11))
        later = wait(service)
        later += [] if len(later) == 2 else wait(service)
    assert [one.request.event for one in (first, *later)] == [7, 9, 11]
    assert without_times(first.answer) == without_times(made.answer(request(7)))


def test_a_process_that_ends_is_told_and_goes_on_being_told():
    with BackgroundTwin(twin()) as service:
        service.warm_up()
        service._process.kill()
        for event in (7, 9):
            service.ask(request(event))
            (reply,) = wait(service)
            assert (reply.answer, reply.reason) == (None, GONE)


def test_the_process_goes_with_the_loop_whatever_ends_it():
    with pytest.raises(KeyboardInterrupt), BackgroundTwin(twin()) as service:
        service.warm_up()
        service.ask(request())
        raise KeyboardInterrupt
    assert service._process.poll() is not None
    assert not service._thread.is_alive()


def test_an_effect_that_only_this_process_knows_is_refused(monkeypatch):
    monkeypatch.setattr(source_hash, "_foreign", {"def law(): ..."})
    with BackgroundTwin(twin()) as service, pytest.raises(UserError, match="effects of the package"):
        service.warm_up()


def test_a_process_that_does_not_start_is_a_failure(monkeypatch):
    monkeypatch.setattr(background, "COMMAND", (*background.COMMAND[:1], "-c", "raise SystemExit"))
    with BackgroundTwin(twin()) as service, pytest.raises(Failure, match="cannot be started"):
        service.warm_up()
