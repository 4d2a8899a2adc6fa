"""The page of `dtb paper`: every claim with its verdict, every figure with its caption."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd

from dtbacklash.report.page import embedded, render

CAPTIONS = {
    4: "Response to a 1 mm step without dynamical prefilter: top platform position and motor voltage.",
    6: "Response to a 1 mm step with the prefilter from the balanced reduced model.",
    7: "The play: lead screw angle for a growing sine of the motor angle, over time and in the state space.",
    8: "Linear IMC while the gap grows to 100°.",
    10: "NIMC with the gap estimate fixed at 50°.",
    13: "NIMC reconfigured by the digital twin after every change of the reference.",
    14: "NIMC reconfigured by the digital twin when the novelty index raises an event.",
}


def write(claims: pd.DataFrame, figures: dict[str, Path], folder: Path) -> None:
    """Write `report.html` into `folder`.

    Args:
        claims: columns `claim, section, paper, ours, tolerance, pass`, and `reason` (why this
            tolerance, or why the claim fails) if there is one.
        figures: name -> PNG in the order to be shown. A name that ends in the number of one of the paper's
            figures gets that caption, any other is its own caption.
        folder: an existing folder.
    """
    rows = claims.rename(columns={"pass": "passed"}).to_dict("records")
    for row in rows:
        row["reason"] = row.get("reason") if isinstance(row.get("reason"), str) else ""
    page = render(
        "paper.html.j2",
        claims=rows,
        failed=[row for row in rows if not row["passed"]],
        figures=[(*_caption(name), embedded(path)) for name, path in figures.items()],
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _caption(name: str) -> tuple[str, str]:
    """Heading and caption of a figure by its name."""
    found = re.search(r"(\d+)\D*$", name)
    number = int(found.group(1)) if found else 0
    if number not in CAPTIONS:
        return name, ""
    return f"Figure {number}", CAPTIONS[number]
