"""Progress: a bar that comes by itself in a terminal, lines with -v, lines now and then elsewhere."""

import io
import logging
import time

import pytest
from rich.console import Console

from dtbacklash.api import progress as bar


@pytest.fixture
def terminal(monkeypatch):
    """A terminal on stderr; what was written to it."""
    seen = io.StringIO()
    monkeypatch.setattr(bar, "Console", lambda **_: Console(file=seen, force_terminal=True, width=100))
    monkeypatch.setattr(bar, "PATIENCE_S", 0.1)
    return seen


def test_the_bar_comes_by_itself_where_nothing_ticks(terminal):
    with bar.progress("reading") as tell:
        tell(0.25, "two million rows")
        time.sleep(0.6)
    shown = terminal.getvalue()
    assert "reading: two million rows" in shown
    assert "25 %" in shown


def test_what_is_quick_shows_nothing(terminal):
    with bar.progress("reading") as tell:
        tell(1.0)
    assert terminal.getvalue() == ""


def test_elsewhere_there_is_no_bar(capsys, monkeypatch):
    monkeypatch.setattr(bar, "PATIENCE_S", 0.05)
    with bar.progress("reading") as tell:
        time.sleep(0.2)
        tell(0.5)
    assert capsys.readouterr().err == ""


def test_elsewhere_a_line_now_and_then_says_what_is_done(capsys, monkeypatch):
    monkeypatch.setattr(bar, "LINE_EVERY_S", 0.05)
    with bar.progress("reading") as tell:
        tell(0.25, "two million rows")
        time.sleep(0.2)
    assert capsys.readouterr().err.startswith("dtb: reading: two million rows, 25 %")


def test_with_v_each_stage_is_a_line_once(terminal, caplog):
    with caplog.at_level(logging.INFO, "dtbacklash"), bar.progress("diagnosing") as tell:
        for share, text in ((0.0, "comparing"), (0.2, "comparing"), (0.5, "naming")):
            tell(share, text)
        time.sleep(0.3)
    assert [record.getMessage() for record in caplog.records] == ["  0 %  comparing", " 50 %  naming"]
    assert terminal.getvalue() == ""


def test_with_v_a_stage_without_words_is_a_line_a_tenth(terminal, caplog):
    with caplog.at_level(logging.INFO, "dtbacklash"), bar.progress("simulating") as tell:
        for k in range(101):
            tell(k / 100)
    assert len(caplog.records) == 11


def test_an_error_inside_ends_the_bar(terminal):
    with pytest.raises(ZeroDivisionError), bar.progress("reading"):
        time.sleep(0.3)
        raise ZeroDivisionError
    assert "reading" in terminal.getvalue()


def test_a_log_has_no_line_twice(capsys, monkeypatch):
    """What goes on and on is said again after a minute, not every ten seconds, and with the time that has passed."""
    monkeypatch.setattr(bar, "LINE_EVERY_S", 0.02)
    monkeypatch.setattr(bar, "SAME_EVERY_S", 0.3)
    monkeypatch.setattr(bar, "duration", lambda seconds: f"{seconds:.2f} s")
    with bar.progress("diagnosing") as tell:
        for share, step in ((0.2, "recalibrating"), (0.4, "ranking")):
            tell(share, step)
            time.sleep(0.5)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(set(lines))
    assert 2 <= sum("recalibrating" in line for line in lines) <= 3


def test_what_is_known_so_far_is_a_line_each_time_that_it_changes(capsys):
    with bar.progress("diagnosing") as tell:
        for share, text in ((0.1, "ranking; so far likeliest backlash"), (0.2, "fitting; so far likeliest backlash"),
                            (0.4, "ranking; so far backlash (half gap 2 mrad)"), (0.9, "drawing")):  # fmt: skip
            tell(share, text)
    assert capsys.readouterr().err.splitlines() == [
        "dtb: after 0 s: likeliest backlash", "dtb: after 0 s: backlash (half gap 2 mrad)",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("shares", "said"),
    [
        ([(0.0, 0.0), (30.0, 0.02)], ""),  # nobody knows yet
        ([(10.0, 0.1), (20.0, 0.2), (30.0, None)], "about 70 s left"),
        ([(10.0, 0.1), (20.0, 0.2), (121.0, None)], ""),  # it takes longer: nobody knows how long
        ([(2.0, 0.4), (30.0, 0.7)], ""),  # at two paces
        ([(30.0, 1.0), (40.0, None)], ""),  # and the last tenth goes on
    ],
)
def test_the_time_left_is_said_while_the_pace_is_even(monkeypatch, shares, said):
    now = [0.0]
    monkeypatch.setattr(bar.time, "monotonic", lambda: now[0])
    left = bar.Remaining()
    for at, share in shares:
        now[0] = at
        if share is not None:
            left.told(share)
    assert str(left) == said


def test_who_does_the_work_may_know_better(monkeypatch):
    left = bar.Remaining()
    left.told(0.5, lambda: 240.0)
    assert str(left) == "about 4 min left"
    left.told(0.9, lambda: None)
    assert str(left) == ""
