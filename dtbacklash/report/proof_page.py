"""The files of a proof: score.json, the tables, the figures, the page, and the block of the docs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from PIL import Image

from dtbacklash.errors import UserError
from dtbacklash.prove.rules import Case
from dtbacklash.prove.score import Score
from dtbacklash.prove.store import write_json, write_text
from dtbacklash.prove.table import (
    case_rows,
    confusion_rows,
    figure_row,
    markdown,
    quantity_row,
    which_seeds,
)  # fmt: skip
from dtbacklash.report import style
from dtbacklash.report.page import embedded, render
from dtbacklash.report.proof_confusion import confusion_figure
from dtbacklash.report.proof_figures import errors_figure, shares_figure, visibility_figure

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
DOCS_PAGE, DOCS_DATA, DOCS_IMAGES = "proof.md", "proof", "images"


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
    bars = [f.met for f in score.figures] + [q.met(v) for q in score.quantities for v in (q.median, q.ninety)]
    wrong = rows[~rows["right"].astype(bool)].to_dict("records")
    return render(
        "proof.html.j2", score=score, seeds=which_seeds(score), command=score.notes.get("command", ""),
        met=sum(met is True for met in bars), barred=sum(met is not None for met in bars),
        shares=[(figure_row(f), f.met) for f in score.figures],
        quantities=[quantity_row(q) for q in score.quantities],
        figures=[(CAPTIONS[name], embedded(path)) for name, path in figures.items()], wrong=wrong,
    )  # fmt: skip


def docs_block(score: Score) -> str:
    """What stands between ``BEGIN`` and ``END`` in the docs' page: the table and the figures, nothing typed by hand."""
    images = [
        f"![{name}]({DOCS_IMAGES}/proof_{name}.png)\n\n{caption}\n" for name, caption in CAPTIONS.items()
    ]  # fmt: skip
    return "\n".join([BEGIN, "", markdown(score), *images, END])


def write_docs(score: Score, cases: Sequence[Case], folder: Path) -> None:
    """Bring a score into the docs: the block of ``proof.md``, the figures, and the data that they are made from.

    Raises
    ------
    UserError : the folder has no ``proof.md`` with the two lines between which the block stands.
    """
    page_file = folder / DOCS_PAGE
    check_docs(folder)
    text = page_file.read_text(encoding="utf-8")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    rows = case_rows(cases)
    for image in draw(score, rows, folder / DOCS_IMAGES, "proof_").values():
        _lighten(image)
    write_text(folder / DOCS_DATA / "score.csv", rows.to_csv(index=False))
    write_json(folder / DOCS_DATA / "score.json", score.to_json())
    write_text(page_file, before + docs_block(score) + after)


def _lighten(path: Path) -> None:
    """Keep an image of flat colours small: 256 colours, the same picture to the eye."""
    with Image.open(path) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def check_docs(folder: Path) -> None:
    """Refuse a folder of docs that has no place for the score, before hours are spent; errors: ``write_docs``."""
    page_file = folder / DOCS_PAGE
    text = page_file.read_text(encoding="utf-8") if page_file.is_file() else ""
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise UserError("docs", folder, f"needs a {DOCS_PAGE} with the lines {BEGIN} and {END}")
