"""The figures, the page and the docs of a proof."""

import json
import re
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import proved
import pytest
from drawn import overlapping
from nominal import nominal_rig
from proved import COULOMB, CUBIC, case, diagnosis, finding, oracle, perfect, secret
from told import refused

from dtbacklash.files import read_json
from dtbacklash.prove.name_scores import Cell, case_rows
from dtbacklash.prove.score import Score, score
from dtbacklash.report.proof import page as proof_page
from dtbacklash.report.proof.figures import (
    RIGHT,
    STATED,
    WRONG,
    confusion_figure,
    errors_figure,
    shares_figure,
    visibility_figure,
)
from dtbacklash.report.proof.text import rig_counts, terminal

DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.fixture(scope="module")
def cases():
    return proved.campaign(120)


@pytest.fixture(scope="module")
def found(cases):
    return score(cases, {"command": "dtb prove n=120"})


def test_every_share_has_its_row_and_its_count(found):
    figure = shares_figure(found)
    (ax,) = figure.axes
    assert [t.get_text() for t in ax.texts] == [f"{f.right}/{f.of}" for f in reversed(found.figures)]
    assert overlapping(figure) == []


def test_the_confusion_is_coloured_by_what_the_tool_stated():
    cells = [
        Cell("gear backlash", "gear backlash", 5, 5, "gear backlash", "gear backlash"),
        Cell("gear backlash", "screw compliance", 2, 2, "gear backlash", "screw compliance"),
        Cell("gear backlash", "link_1 bumper", 2, 1, "gear backlash", "link bumper"),
        Cell("link_1 bumper", "link_2 bumper", 1, 0, "link bumper", "link bumper"),
        Cell("nothing", "parameters", 3, 0, "nothing", "parameters"),
        Cell("nothing", "link_1 bumper", 1, 0, "nothing", "link bumper"),
    ]
    made = Score(14, 0, 0, {}, {}, None, [], [], [], cells)
    figure = confusion_figure(made)
    (ax,) = figure.axes
    faces = [matplotlib.colors.to_hex(p.get_facecolor()) for p in ax.patches if p.get_facecolor()[3] > 0]
    assert faces == [RIGHT, STATED, WRONG, WRONG, RIGHT, WRONG]
    assert [t.get_text() for t in ax.texts] == ["5", "2", "2", "1", "3", "1"]


def test_the_labels_of_the_whole_catalogue_do_not_touch():
    from dtbacklash.prove.draw import entries

    names = [" ".join(key) for key in entries(nominal_rig("lead_screw"))]
    cells = [Cell(name, name, 1, 1, name, name) for name in names]
    figure = confusion_figure(Score(1, 0, 0, {}, {}, None, [], [], [], cells))
    assert overlapping(figure, rotated=False) == []


def test_the_first_panels_show_all_families_together(found):
    together = found.bins_of()
    figure = visibility_figure(found)
    assert [ax.get_title(loc="left") for ax in figure.axes][:2] == [
        "all effects of the catalogue", "95 % intervals of what was named exactly",
    ]  # fmt: skip
    line = figure.axes[0].lines[-1 - len(together)]
    assert np.allclose(line.get_ydata(), [100 * b.exact / b.of for b in together])


def test_figures_of_next_to_nothing():
    for few in ([perfect("nothing")], [case("a", secret("single", COULOMB), None, {"error": "no fit"}, None, "died")]):
        small = score(few)
        for draw in (shares_figure, visibility_figure, confusion_figure):
            draw(small).canvas.draw()
        errors_figure(case_rows(few)).canvas.draw()


@pytest.mark.parametrize("spread", [1.0, 3.0, 30.0, 1e3, 1e6])
def test_the_labels_of_the_errors_do_not_touch(cases, spread):
    rows = case_rows(cases)
    share = np.linspace(0.0, 1.0, len(rows))
    for name in ("nominal", "recalibrated", "extended", "oracle"):
        rows[f"held_out_{name}"] = rows[f"held_out_{name}"].astype(float) * spread**share
    assert overlapping(errors_figure(rows)) == []


def test_all_files_are_written_and_the_page_stands_alone(found, cases, tmp_path):
    proof_page.write(found, cases, tmp_path)
    assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()) == [
        "confusion.csv", "figures/confusion.png", "figures/errors.png", "figures/shares.png",
        "figures/visibility.png", "report.html", "score.csv", "score.json", "table.md",
    ]  # fmt: skip
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 4
    assert "http://" not in page
    assert "https://" not in page
    document = json.loads((tmp_path / "score.json").read_text(encoding="utf-8"))
    strict = document["figures"][0]
    assert strict["share"] == pytest.approx(strict["right"] / strict["of"])


@pytest.mark.parametrize("rigs", [("lead_screw",), ("lead_screw", "pendulum")])
def test_every_bar_of_the_page_is_coloured_by_whether_it_is_met(cases, tmp_path, undrawn, rigs):
    found = score([
        replace(c, rig=rigs[k % len(rigs)], diagnosis=None if k < 60 else c.diagnosis) for k, c in enumerate(cases)
    ])  # fmt: skip
    proof_page.write(found, cases, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    rows = [*found.figures, *(f for figures in found.rigs.values() for f in figures)]
    met = [f.met for f in rows] + [q.met(v) for q in found.quantities for v in (q.median, q.ninety)]
    assert {True, False} <= set(met)
    assert page.count('<span class="good">pass</span>') == met.count(True)
    assert page.count('<span class="bad">miss</span>') == met.count(False)
    assert "**" not in page
    of_rigs = [f for figures in found.rigs.values() for f in figures if f.of]
    counts = [cell for _, *row in rig_counts(found) for cell in row if cell]
    assert sorted(cell.strip("*") for cell in counts) == sorted(f"{f.right}/{f.of}" for f in of_rigs)
    assert sum(cell.startswith("**") for cell in counts) == sum(f.met is False for f in of_rigs)


def test_the_page_lists_what_went_wrong(tmp_path, undrawn):
    wrong = case("a", secret("single", CUBIC, seed=10_007), diagnosis(finding(COULOMB)), oracle(CUBIC), 3.0)
    few = [perfect("nothing"), wrong]
    proof_page.write(score(few), few, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "(1 of 2)" in page
    assert "2 recordings are too few to judge a bar" in page
    assert "bars met" not in page
    assert "2 recordings are too few to judge a bar" in terminal(score(few))[0]
    assert "<span>link_1 cubic_stiffness</span>" in page
    assert "<span>motor_bearing coulomb_friction</span>" in page


@pytest.mark.check
@pytest.mark.parametrize("machine", proof_page.DOCS)
def test_the_score_comes_into_the_docs_which_are_redrawn_from_it_alone(found, cases, tmp_path, machine):
    name = proof_page.DOCS[machine]
    (tmp_path / f"{name}.md").write_text(f"before\n\n{proof_page.BEGIN}\n{proof_page.END}\n\nafter\n", encoding="utf-8")
    proof_page.write_docs(found, cases, tmp_path, machine)
    text = (tmp_path / f"{name}.md").read_text(encoding="utf-8")
    assert text == f"before\n\n{proof_page.docs_block(found, machine)}\n\nafter\n"
    images = [tmp_path / "images" / f"{name}_{figure}.png" for figure in proof_page.CAPTIONS]
    assert max(image.stat().st_size for image in images) < 200_000
    assert Score.from_json(read_json(tmp_path / name / "score.json")).figures == found.figures
    made = {path: path.read_bytes() for path in tmp_path.rglob("*.*") if path.is_file()}
    for image in images:
        image.unlink()
    proof_page.redraw_docs(tmp_path)
    assert {path: path.read_bytes() for path in made} == made


@pytest.mark.parametrize("machine", proof_page.DOCS)
def test_no_figure_of_the_docs_is_typed_by_hand(machine, tmp_path):
    """What stands between the marks is what the committed score.json says, or nothing where there is none."""
    proof_page.check_docs(DOCS, machine)
    with refused("needs a proof", key="docs"):
        proof_page.check_docs(tmp_path, machine)
    text = (DOCS / f"{proof_page.DOCS[machine]}.md").read_text(encoding="utf-8")
    block = proof_page.BEGIN + text.split(proof_page.BEGIN)[1].split(proof_page.END)[0] + proof_page.END
    document = read_json(DOCS / proof_page.DOCS[machine] / "score.json")
    none = f"{proof_page.BEGIN}\n{proof_page.END}"
    assert block == (proof_page.docs_block(Score.from_json(document), machine) if document else none)


def test_no_figure_of_the_comparison_is_typed_by_hand(tmp_path):
    alternatives = pytest.importorskip("studies.alternatives")
    text = (DOCS / "proof.md").read_text(encoding="utf-8")
    begin, end = alternatives.BEGIN, alternatives.END
    document = read_json(DOCS / "proof" / "alternatives.json")
    block = begin + text.split(begin)[1].split(end)[0] + end
    assert block == (alternatives.docs_block(document) if document else f"{begin}\n{end}")
    row = {"what": "7 gear.backlash: NARX", "theta_m_floors": float("inf"), "q3_floors": 2.0, "time_s": 0.5,
           "terms": 0, "hidden_is_among": "no", "named": ""}  # fmt: skip
    (tmp_path / "proof.md").write_text(f"before\n{begin}\n{end}\nafter\n", encoding="utf-8")
    for _ in range(2):
        alternatives.write_docs([row], 1, 7, tmp_path)
    made = (tmp_path / "proof.md").read_text(encoding="utf-8")
    assert "- NARX: median held-out error theta_m inf, q3 2 noise floors; 0.5 s; names 0 things" in made
    assert read_json(tmp_path / "proof" / "alternatives.json")["rows"] == [row | {"theta_m_floors": "inf"}]
    assert "--n 1 --seed 7" in made
    assert made.startswith("before\n")
    assert made.endswith("\nafter\n")


def test_lifelike_recordings_have_a_page_of_their_own(tmp_path, undrawn):
    keys = [COULOMB, CUBIC]
    many = [proved.lifelike(perfect("single", key, seed=j), finding(key)) for j, key in enumerate(keys)]
    made = score([*many, proved.lifelike(perfect("nothing", seed=2), finding(CUBIC) | {"confidence": "partial"})])
    proof_page.write(made, many, tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Reliability of names" in text
    assert re.search(r">partial</span></td>\s*<td[^>]*><span>structure<", text)
    assert "exactly the hidden effects" not in text
    assert overlapping(shares_figure(made)) == []
