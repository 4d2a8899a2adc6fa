"""The queue is fair, bounded, and says what it drops."""

from hypothesis import given
from hypothesis import strategies as st

from dtbacklash.remote.workers import FairQueue


def test_machines_take_turns_their_oldest_is_dropped_and_too_many_are_turned_away() -> None:
    queue: FairQueue[str] = FairQueue(3, 10)
    for item in ("a1", "a2", "a3", "b1", "c1", "c2"):
        assert queue.put(item[0], item) is None
    assert [queue.take(0.0) for _ in range(7)] == ["a1", "b1", "c1", "a2", "c2", "a3", None]
    queue = FairQueue(2, 2)
    assert [queue.put("a", item) for item in ("a1", "a2", "a3", "a4")] == [None, None, "a1", "a2"]
    assert [queue.put(item[0], item) for item in ("b1", "c1", "b2")] == [None, "c1", None]
    assert queue.lengths() == {"a": 2, "b": 2}


@given(st.lists(st.one_of(st.none(), st.integers(0, 5)), max_size=200), st.integers(1, 4))
def test_nothing_is_lost_untold_and_the_order_of_a_machine_is_kept(events: list[int | None], depth: int) -> None:
    """None: an item is taken; a number: this machine puts one in."""
    queue: FairQueue[tuple[int, int]] = FairQueue(depth, 4)
    put: list[tuple[int, int]] = []
    out: list[tuple[int, int]] = []
    for n, machine in enumerate(events):
        if machine is None:
            got = queue.take(0.0)
        else:
            put.append((machine, n))
            got = queue.put(str(machine), (machine, n))
        out += [got] if got is not None else []
        lengths = queue.lengths()
        assert len(lengths) <= 4
        assert all(0 < length <= depth for length in lengths.values())
    while (got := queue.take(0.0)) is not None:
        out.append(got)
    assert sorted(out) == sorted(put)
