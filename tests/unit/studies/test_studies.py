"""The studies that claims and docs name are there, and take what is written behind them."""

import re
from pathlib import Path

import pytest

from studies.__main__ import PAGES, STUDIES, _options, main

ROOT = Path(__file__).resolve().parents[3]
CLAIMED = {
    command
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")]
    for command in re.findall(r"python -m studies ([a-z][^`\n#]*)", page.read_text(encoding="utf-8"))
    if "NAME" not in command
}


@pytest.mark.parametrize("command", sorted(CLAIMED))
def test_what_a_page_names_is_accepted(command):
    words = re.sub(r"(,.*|-->.*)", "", command).split()
    assert words[0] in PAGES or words[0] in _options(words).names


def test_each_study_backs_something():
    claimed = {word for command in CLAIMED for word in command.split()}
    assert set(STUDIES) <= claimed


@pytest.mark.parametrize("words", [["nope"], ["gallery", "docs", "nope"], ["real", "docs", "nope"]])
def test_a_name_that_is_unknown_is_refused(words, capsys):
    with pytest.raises(SystemExit) as end:
        main(words)
    assert "choose of " in f"{end.value} {capsys.readouterr().err}"
