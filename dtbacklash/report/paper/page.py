"""The page of `dtb paper`: every claim with its verdict, every figure with its caption."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd

from dtbacklash.report.kit.citations import PAPER
from dtbacklash.report.kit.numbers import number, powers
from dtbacklash.report.kit.page import Shown, embedded, render

#: number of the paper's figure -> what it shows, and what to see in it
CAPTIONS = {
    4: (
        "Response to a 1 mm step without dynamical prefilter: top platform position and motor voltage.",
        "The structure rings at its dominant mode, overshoots by almost 100 % and settles after about 3.5 s; the first "
        "voltage is 47 V.",
    ),
    6: (
        "Response to a 1 mm step with the prefilter from the balanced reduced model.",
        "There is no overshoot, the move settles after 0.8 s, and the voltage stays below 5 V.",
    ),
    7: (
        "The play: lead screw angle for a growing sine of the motor angle, over time and in the state space.",
        "The screw rests at each reversal until the motor has crossed twice the gap; the loops lie between the "
        "dashed lines.",
    ),
    8: (
        "Linear IMC while the gap grows to 100°.",
        "The moves are clean as long as the gap is small; then they overshoot and die out.",
    ),
    10: (
        "NIMC with the gap estimate fixed at 50°.",
        "The moves are clean where the gap passes the estimate, at 100 s, and overshoot where it is larger.",
    ),
    13: (
        "NIMC reconfigured by the digital twin after every change of the reference.",
        "Nine estimates lie on the gap as it was when they were made, and all moves look alike.",
    ),
    14: (
        "NIMC reconfigured by the digital twin when the novelty index raises an event.",
        "There are three events. The index crosses its threshold at these moves alone, and the response hardly differs "
        "from Figure 13.",
    ),
}
METHODS = (
    f"The claims and figures are those of {PAPER}. Every figure is one run of this program, with the settings of dtb "
    "run experiment=figN; a claim is measured on its trace, its tolerance is what the paper's own words allow: a "
    "figure with two digits is met by what rounds to it.",
    "Where the paper leaves a choice, it is read so: lengths in mm, the lead is 1/π mm/rad; the settling band is 1 "
    "%; the reduced model keeps the steady state (balanced residualisation), and its minimum-phase factor is "
    "inverted; the square wave goes from +1 to -1 mm; the gap's S-curve is 10x³ \N{MINUS SIGN} 15x⁴ + 6x⁵ from 25 to "
    "175 s; a buffer holds the samples after a change of the reference; the novelty filter is elliptic, of 3 dB ripple."
    " docs/theory.md has the reasons.",
)


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
        row |= {name: powers(number(row[name], 4)) for name in ("paper", "ours", "tolerance")}
        row["reason"] = row.get("reason") if isinstance(row.get("reason"), str) else ""
    page = render(
        "paper.html.j2",
        claims=rows,
        failed=[row for row in rows if not row["passed"]],
        figures=[_shown(name, path) for name, path in figures.items()],
        methods=METHODS,
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _shown(name: str, path: Path) -> Shown:
    """A figure with heading and caption by its name."""
    found = re.search(r"(\d+)\D*$", name)
    number = int(found.group(1)) if found else 0
    if number not in CAPTIONS:
        return Shown(embedded(path), "", title=name)
    return Shown(embedded(path), *CAPTIONS[number], title=f"Figure {number}")
