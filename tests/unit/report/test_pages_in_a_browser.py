"""Every page in a real browser: nothing wider than the page, no text on another, the answer on the first screen."""

import pytest
import synthetic
from browser import HEIGHT, WIDTHS, look
from diagnosed import EACH, with_parts

from dtbacklash.config.compose import compose
from dtbacklash.experiment.metrics import move_table
from dtbacklash.experiment.run import run_scenario
from dtbacklash.report.diagnosis import page as diagnosis_page
from dtbacklash.report.paper import page as paper_page
from dtbacklash.report.run import page as run_page
from dtbacklash.report.sweep import page as sweep_page

pytestmark = pytest.mark.check


def run(folder):
    result = synthetic.run_result()
    run_page.write(result, move_table(result.trace), folder)


def margins(folder):
    result = run_scenario(compose("controller=nimc_twin", "duration_s=3"))
    run_page.write(result, move_table(result.trace), folder)


def sweep(folder):
    axes = {"controller": ["imc", "nimc_twin"], "twin.delay_s": [0, 4]}
    sweep_page.write(folder, synthetic.sweep_table(axes), list(axes))


PAGES = {
    **{name: lambda folder, make=make: diagnosis_page.write(make(), folder) for name, make in EACH.items()},
    "long": lambda folder: diagnosis_page.write(with_parts(), folder),
    "run": run, "margins": margins, "sweep": sweep,
    "paper": lambda folder: paper_page.write(synthetic.claims_table(), {}, folder),
}  # fmt: skip


@pytest.mark.parametrize("name", PAGES)
def test_pages_fit(name, tmp_path):
    PAGES[name](tmp_path)
    seen = look((tmp_path / "report.html").read_text(encoding="utf-8"), tmp_path)
    assert sorted(seen) == sorted(WIDTHS)
    for width, row in seen.items():
        for state in ("folded", "open"):
            assert row[state]["scroll"] <= width, (width, state)
            assert row[state]["wider"] == [], (width, state)
            assert row[state]["overlaps"] == [], (width, state)
    if name in EACH:  # causes, figure, what is left and the command stand on one screen
        assert 0 < seen[1280]["folds_at"] <= HEIGHT
        assert "dtb run rig=" in seen[1280]["text"]
        assert "diagnosis.json" not in seen[1280]["text"]


def test_a_page_that_does_not_fit_is_seen(tmp_path):
    bad = '<p style="width:1000px">wide</p><p style="position:absolute;top:0;left:8px;height:1em">over</p>'
    seen = look(f"<!DOCTYPE html><body>{bad}</body>", tmp_path)
    assert [bool(seen[width]["folded"]["wider"]) for width in WIDTHS] == [True, False, False]
    assert all(len(row["folded"]["overlaps"]) == 1 for row in seen.values())
