"""How long diagnoses took, and when that says something of the next."""

import json

import pytest

from dtbacklash.api import durations
from dtbacklash.api.durations import Durations


@pytest.fixture
def took(tmp_path, monkeypatch):
    """Make a diagnosis of a kind end after some stages: kind, size, seconds a stage."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def end(kind, size, *stages):
        now = [100.0]
        one = Durations(kind, size, lambda: now[0])
        for k, seconds in enumerate(stages):
            one.reached(k / len(stages))
            now[0] += seconds
        one.keep()

    return end


def at(kind, size, share, since=0.0):
    """What is said to be left so many seconds after a stage began."""
    now = [0.0]
    one = Durations(kind, size, lambda: now[0])
    assert one.left() is None
    one.reached(share)
    now[0] = since
    return one.left()


def test_nothing_is_said_before_two_of_a_kind_agree(took):
    took("a", 1000.0, 1.0, 10.0, 5.0, 4.0)
    assert at("a", 1000.0, 0.25) is None
    took("a", 1000.0, 1.0, 12.0, 5.0, 4.0)
    assert at("a", 1000.0, 0.25) == pytest.approx(20.0, abs=0.1)
    assert at("a", 2000.0, 0.25) == pytest.approx(40.0, abs=0.2)  # twice the samples
    assert at("a", 1000.0, 0.75) == pytest.approx(4.0)
    assert at("a", 1000.0, 0.5, since=6.0) == pytest.approx(3.0)
    assert at("a", 1000.0, 0.75, since=5.0) is None  # longer than any before
    assert at("a", 1000.0, 0.6) is None  # a stage that none had
    assert at("b", 1000.0, 0.25) is None


def test_nothing_is_said_where_the_earlier_ones_are_more_than_a_factor_apart(took):
    took("a", 1000.0, 1.0, 9.0)
    took("a", 1000.0, 1.0, 30.0)
    assert at("a", 1000.0, 0.5) == pytest.approx((9.0 * 30.0) ** 0.5)
    assert at("a", 1000.0, 0.5, since=6.0) is None  # 3 and 24 s
    took("a", 1000.0, 1.0, 40.0)
    assert at("a", 1000.0, 0.5) is None


def test_the_last_ones_are_kept_and_a_file_that_cannot_be_read_is_none(took):
    for seconds in range(20):
        took("a", 1000.0, float(seconds))
    assert [one["all"] for one in json.loads(durations.file().read_text())["a"]] == [float(s) for s in range(12, 20)]
    durations.file().write_text("{not json")
    assert at("a", 1000.0, 0.0) is None
    durations.file().write_text('{"a": [3]}')
    assert at("a", 1000.0, 0.0) is None
    took("a", 1000.0, 1.0)
    assert list(json.loads(durations.file().read_text())) == ["a"]
