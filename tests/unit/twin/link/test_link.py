"""The link's timing: paper's case, fast events, memory, no delay."""

import pytest

from dtbacklash.errors import UserError
from dtbacklash.twin.link.link import FullBuffer, TwinLink


def paper_link(delay_s: float = 4.0) -> TwinLink[float]:
    return TwinLink(buffer=1000, delay_s=delay_s, sample_time_s=1e-3)


def test_the_papers_timing() -> None:
    """Change at 20 s, buffer full at 21 s, the new gap in force at 25 s."""
    link = paper_link()
    assert link.next_sample() is None
    assert link.open(20_000)
    assert link.next_sample() == 21_000
    assert link.full_buffer(20_999) is None
    assert link.full_buffer(21_000) == FullBuffer(20_000, 20_000, 21_000)
    assert link.full_buffer(21_000) is None
    assert link.next_sample() is None  # nothing is on its way until the twin answers
    assert link.send(21_000, 0.7) == 25_000
    assert link.next_sample() == 25_000
    assert link.arrived(24_999) == []
    assert link.arrived(25_000) == [0.7]
    assert link.arrived(25_000) == []
    assert link.next_sample() is None


def test_an_event_while_filling_is_ignored() -> None:
    link = paper_link()
    assert link.open(100)
    assert link.filling
    assert not link.open(600)
    assert link.full_buffer(1100) == FullBuffer(100, 100, 1100)
    assert not link.filling


def test_answers_keep_their_order_while_the_next_buffer_fills() -> None:
    link = paper_link(2.5)
    link.open(0)
    link.full_buffer(1000)
    link.send(1000, 1.0)
    assert link.open(1200)
    assert link.next_sample() == 2200
    link.full_buffer(2200)
    link.send(2200, 2.0)
    assert link.next_sample() == 3500
    assert link.arrived(3500) == [1.0]
    assert link.next_sample() == 4700
    assert link.arrived(9999) == [2.0]


def test_memory_before_the_event_can_be_sent() -> None:
    link = paper_link()
    assert link.open(5000, first=4600)
    assert link.next_sample() == 5600
    assert link.full_buffer(5600) == FullBuffer(5000, 4600, 5600)
    assert link.open(9000, first=8000)
    assert link.next_sample() == 9000
    assert link.full_buffer(9000) == FullBuffer(9000, 8000, 9000)
    assert link.open(20_000, first=10_000)  # full long ago: available at the event, not before it
    assert link.full_buffer(19_999) is None
    assert link.full_buffer(20_000) == FullBuffer(20_000, 10_000, 11_000)


def test_a_delay_is_rounded_to_samples_and_none_is_none() -> None:
    assert TwinLink(buffer=1, delay_s=0.0123, sample_time_s=0.005).delay == 2
    assert TwinLink(buffer=1, delay_s=0.3, sample_time_s=0.1).delay == 3
    link = paper_link(0.0)
    assert link.send(1000, 1.0) == 1000
    assert link.arrived(1000) == [1.0]


def test_wrong_values_are_refused() -> None:
    for buffer, delay_s, key in ((0, 1.0, "buffer=0"), (10, -1.0, "delay_s=-1"), (10, float("nan"), "delay_s=nan")):
        with pytest.raises(UserError, match=key):
            TwinLink(buffer=buffer, delay_s=delay_s, sample_time_s=1e-3)
    with pytest.raises(ValueError, match=r"0\.\.50"):
        paper_link().open(50, first=51)


def test_answers_that_are_sent_late_all_arrive_in_their_order():
    """More at once than there was room for at first."""
    link: TwinLink[int] = TwinLink(10, 0.002, 0.001)
    due = [link.send(k, i) for i, k in enumerate([10 + i for i in range(40)])]
    assert due == [12 + i for i in range(40)]
    assert link.arrived(11) == []
    assert link.arrived(20) == list(range(9))
    assert link.arrived(100) == list(range(9, 40))


def test_an_answer_may_be_under_way_for_longer_than_any_run():
    link: TwinLink[int] = TwinLink(10, 1e9, 0.001)
    assert link.send(5, 1) == 5 + 10**12
