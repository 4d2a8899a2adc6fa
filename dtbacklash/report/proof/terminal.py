"""The score of a proof on the terminal."""

from __future__ import annotations

import pandas as pd
from rich.table import Table

from dtbacklash.prove.score import Score
from dtbacklash.report.kit.tables import blank, fill, notes, plain_cell
from dtbacklash.report.proof.text import figure_row, quantity_row


def table(score: Score) -> Table:
    """The shares with their bars, and the errors and times below."""
    names = ("figure", "share", "count", "interval", "bar", "met", "all")
    frame = pd.DataFrame([dict(zip(names, figure_row(f), strict=True)) for f in score.figures])
    table = fill(blank("Blind proof"), frame.replace("**miss**", "MISS"), [
        ("figure", "figure", plain_cell, False), ("share", "share", plain_cell, True),
        ("count", "count", plain_cell, True), ("interval", "95 % interval", plain_cell, True),
        ("bar", "bar", plain_cell, True), ("met", "", plain_cell, False), ("all", "all sizes", plain_cell, True),
    ])  # fmt: skip
    lines = []
    for q in score.quantities:
        what, median, ninety, unit, of, bar, met = quantity_row(q)
        judged = f"; {bar}: {met}".replace("**miss**", "MISS") if bar else ""
        lines.append(" ".join(f"{what}: median {median}, 90 % {ninety} {unit}".split()) + f" ({of} cases{judged})")
    table.caption = notes(lines)
    return table
