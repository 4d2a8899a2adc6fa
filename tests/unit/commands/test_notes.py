"""What the reader took for granted reaches the terminal before the answer, in five lines at most."""

import logging

from dtbacklash.commands.diagnose import NOTES_SAID, say_notes

UNITS = "Units: u in V (taken as SI, since nothing is said)."


def test_units_come_first_and_what_is_more_stands_in_the_report(capsys):
    say_notes([f"Note {k}." for k in range(6)] + [UNITS], True)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == NOTES_SAID
    assert lines[0] == f"dtb: {UNITS}"
    assert lines[1:] == [*(f"dtb: Note {k}." for k in range(3)), "dtb: 3 more notes on the recording: in the report."]


def test_a_few_are_said_whole_and_a_job_of_a_sweep_says_none(capsys, caplog, monkeypatch):
    monkeypatch.setattr(logging.getLogger(), "handlers", [caplog.handler])  # none of a command that has ended
    monkeypatch.setattr(logging.getLogger("dtbacklash"), "handlers", [])
    say_notes(["One.", UNITS], True)
    assert capsys.readouterr().err == f"dtb: {UNITS}\ndtb: One.\n"
    say_notes(["One."], False)
    with caplog.at_level(logging.INFO, "dtbacklash.diagnose"):
        say_notes(["Two."], True)  # with -v each is a line of the log
    assert capsys.readouterr().err == ""
    assert "Two." in caplog.text
