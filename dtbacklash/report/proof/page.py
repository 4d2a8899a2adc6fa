"""The files of a proof: score.json, the tables, the figures, the page, and the block of the docs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from PIL import Image

from dtbacklash.errors import UserError
from dtbacklash.files import read_json, write_json, write_text
from dtbacklash.prove import known
from dtbacklash.prove.rows import case_rows, confusion_rows
from dtbacklash.prove.rules import Case
from dtbacklash.prove.score import Score
from dtbacklash.report.kit import style
from dtbacklash.report.kit.citations import SHARES
from dtbacklash.report.kit.page import embedded, render
from dtbacklash.report.proof.confusion import confusion_figure
from dtbacklash.report.proof.figures import errors_figure, shares_figure, visibility_figure
from dtbacklash.report.proof.text import figure_row, markdown, quantity_row, reliability_rows, rig_rows, which_seeds

CAPTIONS = {
    "shares": "Every share of the score with its 95 % interval (Wilson), beside the range of its bar.",
    "visibility": "At which size the tool begins to see: effects found, against the change that they make to the "
    "signals, in units of the sensors' noise, with 95 % bands (Wilson). Top right: how often intervals hold the truth.",
    "confusion": "What was hidden (rows) against what was named (columns), over all recordings; links, masses and "
    "sensors of a kind are drawn together.",
    "errors": "Held-out errors of the diagnosed rig beside those of an oracle that knows the true structure.",
}
#: the block of the docs between these lines is made from score.json
BEGIN, END = "<!-- score: begin, made by dtb prove docs=docs -->", "<!-- score: end -->"
#: machine -> the docs' page of its score, without `.md`, and the folder of its data
DOCS = {"clean": "proof", "lifelike": "proof_lifelike"}
DOCS_IMAGES = "images"


def write(score: Score, cases: Sequence[Case], folder: Path) -> None:
    """Write all files of a proof into ``folder``; ``score.json`` comes last, when all others are whole."""
    rows = case_rows(cases)
    write_text(folder / "score.csv", rows.to_csv(index=False))
    write_text(folder / "confusion.csv", confusion_rows(score).to_csv(index=False))
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
    texts = ["hidden", "unknown", "wrong_parameters", "named", "also_fits", "error"]
    filled = rows.fillna(dict.fromkeys(texts, ""))  # what is empty in a file comes back as NaN
    wrong = filled[~filled["right"].astype(bool)].to_dict("records")
    return render(
        "proof.html.j2", score=score, seeds=which_seeds(score), command=score.notes.get("command", ""),
        met=met, barred=barred,
        shares=[figure_row(f) for f in score.figures], rigs=rig_rows(score),
        quantities=[quantity_row(q) for q in score.quantities], reliability=reliability_rows(score),
        figures=[(name, embedded(path), CAPTIONS[name]) for name, path in figures.items()], wrong=wrong,
        sources=SHARES,
    )  # fmt: skip


def docs_block(score: Score, machine: str) -> str:
    """What stands between ``BEGIN`` and ``END`` in the docs' page: the table and the figures, nothing typed by hand."""
    images = [
        f"![{name}]({DOCS_IMAGES}/{DOCS[machine]}_{name}.png)\n\n{caption}\n" for name, caption in CAPTIONS.items()
    ]  # fmt: skip
    return "\n".join([BEGIN, "", markdown(score), *images, END])


def write_docs(score: Score, cases: Sequence[Case], folder: Path, machine: str) -> None:
    """Bring a score into the docs: the block of the machine's page, the figures, and the data that they are made from.

    Raises
    ------
    UserError : the folder has no such page with the two lines between which the block stands.
    """
    check_docs(folder, machine)
    rows, data = case_rows(cases), folder / DOCS[machine]
    write_text(data / "score.csv", rows.to_csv(index=False))
    write_json(data / "score.json", score.to_json())
    known.save(cases, data / known.FILE)
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
