"""The help names what there is."""

from dtbacklash.commands import run_help
from dtbacklash.config.load import settings


def test_every_option_is_listed():
    text = run_help.text()
    for group in run_help.GROUPS:
        assert f"  {group}" in text
    for option in ("nimc_novelty", "s_curve", "multisine", "dual_annealing", "fig13"):
        assert option in text


def test_every_setting_in_the_help_exists():
    for word in run_help.KEYS.replace(";", " ").replace(",", " ").split():
        key, equals, _ = word.partition("=")
        if equals and key[0].islower() and "." in key and not key.startswith(("hydra.", "sensors.", "rig.")):
            assert key in settings(), key


def test_a_users_own_options_are_listed(tmp_path, monkeypatch):
    (tmp_path / "conf" / "rig").mkdir(parents=True)
    (tmp_path / "conf" / "rig" / "mine.yaml").write_text("name: mine\n")
    monkeypatch.chdir(tmp_path)
    assert {"lead_screw", "mine"} <= set(run_help.options("rig"))


def test_options_are_sorted_as_people_count():
    figures = [name for name in run_help.options("experiment") if name.startswith("fig")]
    assert figures == ["fig4", "fig6", "fig8", "fig10", "fig13", "fig14"]
