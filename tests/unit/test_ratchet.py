"""How heavy the tree is, and that nobody makes it heavier without a reason."""

import ratchet
import yaml

SOURCE = '''
"""3 in words."""
LIMIT, SHARES = 8, {"a": (0.25, 1.0)}
class Settings:
    near: float = 0.3
    word = "4"
def told(count=7, *, share=-0.1, on=True):
    return 12.0 * count
'''


def test_numbers_that_somebody_chose_are_counted():
    assert ratchet.chosen_numbers(SOURCE) == 5  # 8, 0.25, 0.3, 7, 0.1


def test_more_than_there_may_be_fails_and_less_is_taken_down(tmp_path, monkeypatch, capsys):
    for folder, text in {"dtbacklash": SOURCE, "hydra_plugins": "", "tests": "x = 1\n", "studies": ""}.items():
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.py").write_text(text)
    found = ratchet.weigh(tmp_path)
    assert found == {"package": 8, "files": 2, "tests": 1, "studies": 0, "chosen numbers": 5}
    monkeypatch.setattr(ratchet, "ROOT", tmp_path)
    monkeypatch.setattr(ratchet, "FILE", tmp_path / "ratchet.yaml")
    for spare, code in ((-1, 1), (3, 0)):
        most = {name: f"{{most: {value + spare}, why: because}}" for name, value in found.items()}
        ratchet.FILE.write_text("".join(f"{name}: {one}\n" for name, one in most.items()))
        assert ratchet.main(lower=False) == code
    assert "too heavy: package: 8, at most 7" in capsys.readouterr().out
    assert ratchet.main(lower=True) == 0
    assert {name: one["most"] for name, one in yaml.safe_load(ratchet.FILE.read_text()).items()} == found


def test_each_figure_says_what_it_is_or_why_it_was_raised():
    entries = yaml.safe_load(ratchet.FILE.read_text())
    assert entries.keys() == ratchet.weigh(ratchet.ROOT).keys()
    assert all(len(one["why"].split()) > 2 for one in entries.values())
