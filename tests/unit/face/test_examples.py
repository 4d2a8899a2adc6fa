"""The page on Python lists the columns that there are; its examples run in test_diagnose."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "python.md"


@pytest.mark.parametrize("name", ["trace", "moves", "estimates"])
def test_the_page_lists_the_columns(name):
    import dtbacklash as dtb

    row = next(line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `result.{name}`"))
    named = {word for listed in re.findall(r"`([\w, ]+)`", row.split("|", 2)[2]) for word in listed.split(", ")}
    made = getattr(dtb.run("duration_s=2", "controller=imc"), name)
    assert set(made.columns) == named & set(made.columns)
    assert named - set(made.columns) <= {"cost"}
