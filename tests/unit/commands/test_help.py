"""The help of every command names what there is."""

import pytest

from dtbacklash.commands import help as helping
from dtbacklash.config import groups
from dtbacklash.config.grammar import GRAMMARS, RUN


@pytest.mark.parametrize("name", GRAMMARS)
def test_every_setting_group_and_example_is_there_and_no_line_is_long(name):
    grammar = GRAMMARS[name]
    text = helping.text(grammar)
    for one in grammar.settings.values():
        if not one.key.startswith("rig."):
            assert f"  {one.about.flag or one.word}" in text
    assert all(f"  {group} " in text for group in grammar.groups)
    assert "out=FOLDER" in text
    assert grammar.folder in " ".join(text.split())
    assert max(map(len, text.splitlines())) <= 120


def test_units_and_choices_stand_beside_their_setting():
    lines = [" ".join(line.split()) for line in helping.text(RUN).splitlines()]
    assert "twin.delay_s=4 from the full buffer to the new gap in force [s]" in lines
    assert "reference.interpolation=hold csv: between its rows (hold, linear)" in lines


def test_every_option_is_listed():
    text = helping.text(RUN)
    for option in ("nimc_novelty", "s_curve", "multisine", "dual_annealing", "fig13"):
        assert option in text


def test_a_users_own_options_are_listed(tmp_path, monkeypatch):
    (tmp_path / "conf" / "rig").mkdir(parents=True)
    (tmp_path / "conf" / "rig" / "mine.yaml").write_text("name: mine\n")
    monkeypatch.chdir(tmp_path)
    assert {"lead_screw", "mine"} <= set(groups.options("rig"))


def test_options_are_sorted_as_people_count():
    figures = [name for name in groups.options("experiment") if name.startswith("fig")]
    assert figures == ["fig4", "fig6", "fig8", "fig10", "fig13", "fig14"]
