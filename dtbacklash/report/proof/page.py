"""The files of a proof: score.json, the tables, the figures, the page, and the block of the docs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from PIL import Image

from dtbacklash.errors import UserError
from dtbacklash.files import read_json, write_json, write_text
from dtbacklash.prove import run
from dtbacklash.prove.name_scores import case_rows, confusion_rows
from dtbacklash.prove.rules import Case
from dtbacklash.prove.score import Score
from dtbacklash.report.components import style
from dtbacklash.report.components.blocks import Block, Code, Table, Tiles
from dtbacklash.report.components.blocks import Figure as Shown
from dtbacklash.report.components.numbers import number
from dtbacklash.report.components.page import SHARES, embedded, render
from dtbacklash.report.proof.figures import confusion_figure, errors_figure, shares_figure, visibility_figure
from dtbacklash.report.proof.text import (
    HEADS,
    few,
    markdown,
    plain,
    quantity_row,
    reliability_rows,
    rig_rows,
    shares_table,
    which_seeds,
)

CAPTIONS = {
    "shares": "Every share of the score with its 95 % interval (Wilson), beside the range of its bar.",
    "visibility": "At which size the tool begins to see: effects found, against the change that they make to the "
    "signals, in units of the sensors' noise, with 95 % bands (Wilson). Top right: how often intervals hold the truth.",
    "confusion": "What was hidden (rows) against what was named (columns), over all recordings; links, masses and "
    "sensors of a kind are drawn together.",
    "errors": "Held-out errors of the diagnosed rig beside those of an oracle that knows the true structure.",
}
#: what to see in each of them
GOOD = {
    "shares": "A bar is met where the dot lies within its grey range; a miss is red. The longer the line about a dot, "
    "the less it says.",
    "visibility": "The curves should rise to 100 % before the change is ten times the noise, and the intervals should "
    "hold the truth in 95 % of cases whatever the size.",
    "confusion": "What is right lies on the framed diagonal, in blue. Sand is ambiguity that the tool has stated, "
    "orange is wrong.",
    "errors": "Left: diagnosed rigs on the line are as good as the oracle's; the nominal ones lie far above it. Right: "
    "the dots should lie below the dashed bar.",
}
SCORE = (
    "A bar counts clear cases: those in which an oracle that knows the true structure sees everything that was hidden. "
    "The last column counts all cases. Intervals are Wilson's, 95 %. A share above its bar's range misses the bar only "
    "if its interval lies above that range too: 17 of 17, for instance, does not show that the intervals are too wide."
)
RELIABLE = (
    "A name is right if its place and effect were hidden, or are one of the small things of a lifelike recording."
)
METHODS = [
    "Something was drawn from a seed and hidden in each recording: effects of the catalogue, wrong parameters, physics "
    "that the catalogue lacks, or nothing. Another integrator than the diagnosis has made the recordings (Runge-Kutta "
    "with fixed steps), with other formulations where a law is not smooth. The answers were sealed until every "
    "recording was diagnosed.",
    "A case is clear if an oracle, which fits the true structure from the true values, sees everything that was "
    "hidden: without it the excess of the held-out mean square over the noise floor at least doubles, by three "
    f"standard errors. Intervals of shares are Wilson's, 95 % ({SHARES}). Held-out errors are the rms of the residuals "
    "in units of the noise floor. docs/proof.md has the rules.",
]
#: the block of the docs between these lines is made from score.json
BEGIN, END = "<!-- score: begin, made by dtb prove docs=docs -->", "<!-- score: end -->"
#: machine -> the docs' page of its score, without `.md`, and the folder of its data
DOCS = {"clean": "proof", "lifelike": "proof_lifelike"}
DOCS_IMAGES = "images"


def write(score: Score, cases: Sequence[Case], folder: Path) -> None:
    """Write all files of a proof into ``folder``; ``score.json`` comes last, when all others are whole."""
    rows = case_rows(cases)
    write_text(folder / "score.csv", rows.to_csv(index=False))
    write_text(folder / "confusion.csv", confusion_rows(score.confusion).to_csv(index=False))
    write_text(folder / "table.md", markdown(score))
    figures = draw(score, rows, folder / "figures", "")
    write_text(folder / "report.html", page(score, rows, figures))
    write_json(folder / "score.json", score.to_json())


def draw(score: Score, rows: pd.DataFrame, folder: Path, prefix: str) -> dict[str, Path]:
    """Draw the figures as ``<prefix><name>.png`` into a folder; name -> file."""
    drawn: dict[str, Callable[[], Figure]] = {
        "shares": lambda: shares_figure(score),
        "visibility": lambda: visibility_figure(score),
        "confusion": lambda: confusion_figure(score),
        "errors": lambda: errors_figure(rows),
    }
    return {name: style.save(make(), folder / f"{prefix}{name}.png") for name, make in drawn.items()}


def page(score: Score, rows: pd.DataFrame, figures: dict[str, Path]) -> str:
    """The text of ``report.html``."""
    met, barred = score.bars
    drawn = [Shown(embedded(path), CAPTIONS[name], GOOD[name]) for name, path in figures.items()]
    counts = [
        (f"{met} of {barred}", "bars met") if few(score) == "" else ("-", few(score)),
        (str(score.cases), "recordings"),
        (str(score.failed), "diagnoses failed"),
    ]
    counts += [(str(score.oracle_failed), "oracles failed")] if score.oracle_failed else []
    said = f"Recordings in which something was hidden, diagnosed without the answer, then scored. {which_seeds(score)}"
    wrong = _wrong(score, rows)
    return render("The blind proof", said, [
        Tiles(counts),
        Code(str(score.notes.get("command", ""))),
        Block("Score", [SCORE, shares_table(score)]),
        Block("Rig by rig", [Table(("rig", *HEADS), [plain(row) for row in rig_rows(score)])], folded=True),
        Block("Reliability of names", [RELIABLE, Table(
            ("confidence", "part of the rig", "names that are right#", "count#", "95 % interval#"),
            reliability_rows(score),
        )] if score.reliability else []),
        Block("Errors and time", [Table(
            ("figure", "median#", "90 % quantile#", "unit", "cases#", "bar#", "median", "90 %"),
            [[*row[:-1], *(row[-1].split(" / ") if row[-1] else ("", ""))]
             for row in (plain(quantity_row(q)) for q in score.quantities)],
        )]),
        Block("Figures", drawn),
        Block("What went wrong", [
            "These are the recordings whose diagnosis is not right by the strict rule of its kind "
            f"({len(wrong.rows)} of {score.cases}).", wrong,
        ] if wrong.rows else ["Nothing."]),
        Block("Methods", METHODS, folded=True),
    ])  # fmt: skip


def _wrong(score: Score, rows: pd.DataFrame) -> Table:
    """What was hidden and what was said, of each recording whose diagnosis is not right."""
    texts = ["hidden", "unknown", "wrong_parameters", "named", "also_fits", "error"]
    filled = rows.fillna(dict.fromkeys(texts, ""))  # what is empty in a file comes back as NaN
    cells = [
        [*([r["rig"]] if score.rigs else []), str(r["seed"]), r["kind"],
         r["hidden"] or r["unknown"] or r["wrong_parameters"], number(r["verdict"], missing=""),
         r["error"] or r["named"], r["also_fits"], "yes" if r["clear"] else "no", number(r["visibility_min"])]
        for r in filled[~filled["right"].astype(bool)].to_dict("records")
    ]  # fmt: skip
    heads = ("seed", "kind", "hidden", "verdict", "named", "also fits", "clear", "smallest change / noise#")
    return Table((*(["rig"] if score.rigs else []), *heads), cells)


def docs_block(score: Score, machine: str) -> str:
    """What stands between ``BEGIN`` and ``END`` in the docs' page: the table and the figures, nothing typed by hand."""
    images = [
        f"![{name}]({DOCS_IMAGES}/{DOCS[machine]}_{name}.png)\n\n{caption}\n" for name, caption in CAPTIONS.items()
    ]  # fmt: skip
    return "\n".join([BEGIN, "", markdown(score), *images, END])


def write_docs(score: Score, cases: Sequence[Case], folder: Path, machine: str) -> None:
    """Bring a score into the docs: the block of the machine's page, the figures, and the data that they are made from.

    Raises UserError: the folder has no such page with the two lines between which the block stands.
    """
    check_docs(folder, machine)
    rows, data = case_rows(cases), folder / DOCS[machine]
    write_text(data / "score.csv", rows.to_csv(index=False))
    write_json(data / "score.json", score.to_json())
    run.save_known(cases, data / run.FILE)
    _fill_docs(score, rows, folder, machine)


def redraw_docs(folder: Path) -> None:
    """Make blocks and figures anew from the scores that a folder of docs holds, after a change of how they look.

    ``python -m dtbacklash.report.proof docs``
    """
    for machine, name in DOCS.items():
        if document := read_json(folder / name / "score.json"):
            check_docs(folder, machine)
            _fill_docs(Score.from_json(document), pd.read_csv(folder / name / "score.csv"), folder, machine)


def _fill_docs(score: Score, rows: pd.DataFrame, folder: Path, machine: str) -> None:
    for image in draw(score, rows, folder / DOCS_IMAGES, f"{DOCS[machine]}_").values():
        _lighten(image)
    page_file = folder / f"{DOCS[machine]}.md"
    text = page_file.read_text(encoding="utf-8")
    write_text(page_file, text.split(BEGIN)[0] + docs_block(score, machine) + text.split(END)[1])


def _lighten(path: Path) -> None:
    """Keep an image of flat colours small: 256 colours, the same picture to the eye."""
    with Image.open(path) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def check_docs(folder: Path, machine: str) -> None:
    """Refuse a folder of docs that has no place for the score, before hours are spent; errors: ``write_docs``."""
    page_file = folder / f"{DOCS[machine]}.md"
    text = page_file.read_text(encoding="utf-8") if page_file.is_file() else ""
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise UserError("docs", folder, f"needs a {page_file.name} with the lines {BEGIN} and {END}")
