"""Every example of the page on Python runs, in its order, as a reader would type them."""

import re
from pathlib import Path

import matplotlib as mpl
import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "python.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.mark.check
def test_the_examples_run(tmp_path, monkeypatch, capsys):
    assert len(BLOCKS) >= 7
    monkeypatch.chdir(tmp_path)
    before = dict(mpl.rcParams)
    names = {}
    for number, block in enumerate(BLOCKS):
        exec(compile(block, f"{PAGE.name}, example {number + 1}", "exec"), names)
    printed = capsys.readouterr().out
    assert dict(mpl.rcParams) == before
    assert "Moves of the reference" in printed
    assert "controller.internal_model=inner_loop takes it out." in printed
    assert "missing_physics" in printed
    assert names["found"].findings["effect"].tolist() == ["coulomb_friction"]
    assert names["found"].findings["value"][0] == pytest.approx(0.02, rel=0.02)
    written = {"summary.json", "metrics.csv", "estimates.csv", "trace.parquet", "report.html", "figures"}
    assert {path.name for path in (tmp_path / "my_run").iterdir()} == written
    assert {path.name for path in (tmp_path / "found").iterdir()} == {
        "diagnosis.json",
        "rig.yaml",
        "report.html",
        "figures",
    }
    assert not names["drifting"].summary["settles"]
    assert names["again"].summary["settles"]


@pytest.mark.parametrize("name", ["trace", "moves", "estimates"])
def test_the_page_lists_the_columns(name):
    import dtbacklash as dtb

    row = next(line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `result.{name}`"))
    named = {word for listed in re.findall(r"`([\w, ]+)`", row.split("|", 2)[2]) for word in listed.split(", ")}
    made = getattr(dtb.run("duration_s=2", "controller=imc"), name)
    assert set(made.columns) == named & set(made.columns)
    assert named - set(made.columns) <= {"cost"}
