"""The page of `dtb paper`: every claim with its verdict, every figure with its caption."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd

from dtbacklash.report.kit.citations import PAPER
from dtbacklash.report.kit.numbers import number, powers
from dtbacklash.report.kit.page import embedded, render


def write(claims: pd.DataFrame, figures: dict[str, Path], folder: Path) -> None:
    """Write `report.html` into `folder`.

    Args:
        claims: columns `claim, section, paper, ours, tolerance, pass` and `reason` (why this tolerance, or why the
            claim fails).
        figures: name -> PNG in the order to be shown. A name that ends in the number of one of the paper's
            figures gets that caption, any other is its own caption.
        folder: an existing folder.
    """
    rows = claims.rename(columns={"pass": "passed"}).to_dict("records")
    for row in rows:
        row |= {name: powers(number(row[name], 4)) for name in ("paper", "ours", "tolerance")}
    page = render(
        "paper.html.j2",
        claims=rows,
        failed=[row for row in rows if not row["passed"]],
        figures=[(name, _number(name), embedded(path)) for name, path in figures.items()],
        paper=PAPER,
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _number(name: str) -> int:
    """The number with which a name ends; 0 without one."""
    found = re.search(r"(\d+)\D*$", name)
    return int(found.group(1)) if found else 0
