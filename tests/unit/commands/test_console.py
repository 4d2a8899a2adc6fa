"""Progress: a bar that comes by itself in a terminal, lines with -v, nothing elsewhere."""

import io
import logging
import time

import pytest
from rich.console import Console

from dtbacklash.commands import console


@pytest.fixture
def terminal(monkeypatch):
    """A terminal on stderr; what was written to it."""
    seen = io.StringIO()
    monkeypatch.setattr(console, "Console", lambda **_: Console(file=seen, force_terminal=True, width=100))
    monkeypatch.setattr(console, "PATIENCE_S", 0.1)
    return seen


def test_the_bar_comes_by_itself_where_nothing_ticks(terminal):
    with console.progress("reading", compiles=False) as tell:
        tell(0.25, "two million rows")
        time.sleep(0.6)
    shown = terminal.getvalue()
    assert "reading: two million rows" in shown
    assert "25 %" in shown


def test_what_is_quick_shows_nothing(terminal):
    with console.progress("reading", compiles=False) as tell:
        tell(1.0)
    assert terminal.getvalue() == ""


def test_elsewhere_there_is_no_bar(capsys, monkeypatch):
    monkeypatch.setattr(console, "PATIENCE_S", 0.05)
    with console.progress("reading", compiles=False) as tell:
        time.sleep(0.2)
        tell(0.5)
    assert capsys.readouterr().err == ""


def test_elsewhere_a_line_now_and_then_says_what_is_done(capsys, monkeypatch):
    monkeypatch.setattr(console, "LINE_EVERY_S", 0.05)
    with console.progress("reading", compiles=False) as tell:
        tell(0.25, "two million rows")
        time.sleep(0.2)
    assert capsys.readouterr().err.startswith("dtb: reading: two million rows, 25 %")


def test_with_v_each_stage_is_a_line_once(terminal, caplog):
    with caplog.at_level(logging.INFO, "dtbacklash"), console.progress("diagnosing", compiles=False) as tell:
        for share, text in ((0.0, "comparing"), (0.2, "comparing"), (0.5, "naming")):
            tell(share, text)
        time.sleep(0.3)
    assert [record.getMessage() for record in caplog.records] == ["  0 %  comparing", " 50 %  naming"]
    assert terminal.getvalue() == ""


def test_with_v_a_stage_without_words_is_a_line_a_tenth(terminal, caplog):
    with caplog.at_level(logging.INFO, "dtbacklash"), console.progress("simulating", compiles=False) as tell:
        for k in range(101):
            tell(k / 100)
    assert len(caplog.records) == 11


def test_an_error_inside_ends_the_bar(terminal):
    with pytest.raises(ZeroDivisionError), console.progress("reading", compiles=False):
        time.sleep(0.3)
        raise ZeroDivisionError
    assert "reading" in terminal.getvalue()


def test_while_the_simulation_is_compiled_that_is_what_is_said(capsys, monkeypatch):
    monkeypatch.setattr(console, "LINE_EVERY_S", 0.05)
    monkeypatch.setattr(console, "announce_compilation", lambda: True)
    with console.progress("simulating") as tell:
        tell(0.0)
        time.sleep(0.2)
        assert "dtb: compiling, 0 %" in capsys.readouterr().err
        tell(0.25)
        time.sleep(0.2)
    told = capsys.readouterr().err
    assert "dtb: simulating, 25 %" in told
    assert "compiling" not in told.partition("simulating, 25 %")[2]


def test_what_is_known_so_far_is_a_line_each_time_that_it_changes(capsys):
    with console.progress("diagnosing", compiles=False) as tell:
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
        ([(30.0, 0.25), (40.0, None)], "about 80 s left"),
        ([(30.0, 0.25), (121.0, None)], "longer than the steps before it"),
        ([(30.0, 0.25), (60.0, 0.9), (61.0, None)], "about 6 s left"),
    ],
)
def test_the_time_left_follows_from_what_was_done_and_goes_on_falling(monkeypatch, shares, said):
    now = [0.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    left = console.TimeLeft()
    for at, share in shares:
        now[0] = at
        if share is not None:
            left.told(share)
    assert str(left) == said
