"""The studies that claims and docs name are there, and take what is written behind them."""

import re
from pathlib import Path

import pandas as pd
import pytest

from studies import fleets
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


CASE = {
    "what": "oscillator: spring.hysteresis", "mode": "payloads", "seen": 50.0, "clear": True, "said": "-",
    "right": True, "sure": 1, "sure_false": 0, "there_only": None, "cpu_s": 2.0,
}  # fmt: skip


def test_fleets_that_are_done_are_counted_and_not_done_again(tmp_path):
    only = CASE | {"mode": "in 2 only", "seen": 10.0, "clear": False, "right": False, "there_only": True}
    pair = CASE | {"mode": "nothing", "seen": None, "clear": None}
    cases = [CASE, only, pair, pair]
    pd.DataFrame(cases).to_csv(tmp_path / "kept.csv", index=False)
    rows = fleets.fleet_rows(2, 91_000, tmp_path / "kept.csv")
    assert [row["mode"] for row in rows] == [case["mode"] for case in cases]
    of_fleets, of_pairs, seen = fleets.fleet_words(rows)
    assert of_fleets.startswith(
        "fleets: right 1 of 2, of those that show it 30 times the noise 1 of 1, where an oracle"
    )
    assert of_pairs.startswith("pairs: right 2 of 2, ")
    assert seen == "Seen in one recording only, and said so: 1 of 1."
    page = tmp_path / fleets.PAGE
    page.write_text(f"{fleets.BEGIN}\n{fleets.END}", encoding="utf-8")
    fleets.write_docs(rows, tmp_path)
    text = page.read_text(encoding="utf-8")
    assert "| payloads | 1 | 1 | 1 | 0 |\n| effect in one only | 1 | 0 | 1 | 0 |\n| nothing | 2 | 2 | 2 | 0 |\n" in text
    assert f"{of_fleets} {of_pairs} {seen}\n" in text


@pytest.mark.check
def test_a_fleet_of_specimens_names_what_all_of_them_hide():
    row = fleets._fleet(91_000, "oscillator", "payloads")
    assert row["what"] == "oscillator: mass.constant_force"
    assert (row["right"], row["clear"], row["sure_false"], row["there_only"]) == (True, True, 0, None)
    assert row["seen"] > fleets.CLEAR
