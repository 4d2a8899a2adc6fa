"""The page of `dtb paper`: every claim with its verdict, every figure with its caption."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd

from dtbacklash.report.components.blocks import Block, Figure, Items, Table, Tiles
from dtbacklash.report.components.numbers import number, powers
from dtbacklash.report.components.page import PAPER, embedded, render

#: number of the paper's figure: what it shows, and what to see in it
CAPTIONS = {
    4: ("Response to a 1 mm step without dynamical prefilter: top platform position and motor voltage.",
        "The structure rings at its dominant mode, overshoots by almost 100 % and settles after about 3.5 s; the first "
        "voltage is 47 V."),
    6: ("Response to a 1 mm step with the prefilter from the balanced reduced model.",
        "There is no overshoot, the move settles after 0.8 s, and the voltage stays below 5 V."),
    7: ("The play: lead screw angle for a growing sine of the motor angle, over time and in the state space.",
        "The screw rests at each reversal until the motor has crossed twice the gap; the loops lie between the dashed "
        "lines."),
    8: ("Linear IMC while the gap grows to 100°.",
        "The moves are clean as long as the gap is small; then they overshoot and die out."),
    10: ("NIMC with the gap estimate fixed at 50°.",
         "The moves are clean where the gap passes the estimate, at 100 s, and overshoot where it is larger."),
    13: ("NIMC reconfigured by the digital twin after every change of the reference.",
         "Nine estimates lie on the gap as it was when they were made, and all moves look alike."),
    14: ("NIMC reconfigured by the digital twin when the novelty index raises an event.",
         "There are three events. The index crosses its threshold at these moves alone, and the response hardly "
         "differs from Figure 13."),
}  # fmt: skip
HEADS = ("verdict", "section", "claim, and why this tolerance", "paper", "ours", "tolerance")
MEASURED = HEADS[3:]
CLAIMS = (
    "These are the statements of the paper that can be checked, and what this program finds. A tolerance is what the "
    "paper's own words allow; the reason stands below each claim."
)
METHODS = [
    f"The claims and figures are those of {PAPER}. Every figure is one run of this program, with the settings of "
    "`dtb run experiment=figN`; a claim is measured on its trace, its tolerance is what the paper's own words allow: a "
    "figure with two digits is met by what rounds to it.",
    "Where the paper leaves a choice, it is read so: lengths in mm, the lead is 1/π mm/rad; the settling band is 1 %; "
    "the reduced model keeps the steady state (balanced residualisation), and its minimum-phase factor is inverted; "
    "the square wave goes from +1 to -1 mm; the gap's S-curve is 10x³ \N{MINUS SIGN} 15x⁴ + 6x⁵ from 25 to 175 s; a "
    "buffer holds the samples after a change of the reference; the novelty filter is elliptic, of 3 dB ripple. "
    "docs/theory.md has the reasons.",
]


def write(claims: pd.DataFrame, figures: dict[str, Path], folder: Path) -> None:
    """Write `report.html` into `folder`.

    claims: columns `claim, section, paper, ours, tolerance, pass` and `reason` (why this tolerance, or why the
        claim fails).
    figures: name -> PNG in the order to be shown. A name that ends in the number of one of the paper's
        figures gets that caption, any other is its own caption.
    folder: an existing folder.
    """
    failed = failures(claims)
    done = f"{len(claims) - len(failed)} of {len(claims)}"
    page = render(
        "The paper, reproduced",
        "The use of a digital twin to reconfigure a nonlinear internal model controller: its claims and figures.",
        [
            Tiles([(done, "claims reproduced"), (str(len(failed)), "not reproduced"), (str(len(figures)), "figures")]),
            Block("Not reproduced", [Items(failed)]),
            Block("Claims", [CLAIMS, claims_table(claims)]),
            Block("Figures", [_figure(name, path) for name, path in figures.items()]),
            Block("Methods", METHODS, folded=True),
        ],
    )  # fmt: skip
    (folder / "report.html").write_text(page, encoding="utf-8")


def claims_table(claims: pd.DataFrame, reasons: bool = True) -> Table:
    """A row a claim, on demand with the reason of its tolerance below it."""
    rows = [
        ["pass" if c["pass"] else "fail", c["section"],
         f"{c['claim']}\n{c['reason']}".strip() if reasons else c["claim"],
         *(powers(number(c[name], 4)) for name in MEASURED)]
        for c in claims.to_dict("records")
    ]  # fmt: skip
    return Table(HEADS if reasons else (*HEADS[:2], "claim", *HEADS[3:]), rows, "Claims of the paper")


def failures(claims: pd.DataFrame) -> list[str]:
    """Of each claim that fails what it says, what it is here, and why."""
    found = []
    for claim in claims[~claims["pass"].astype(bool)].to_dict("records"):
        why, _, cause = claim["reason"].partition(". It fails because ")
        paper, ours, tolerance = (powers(number(claim[name], 4)) for name in MEASURED)
        said = f"{claim['claim']}: the paper says “{paper}”. It is {ours} here; the tolerance is {tolerance}"
        found.append(said + (f" ({why})." if why else ".") + (f" It fails because {cause}." if cause else ""))
    return found


def _figure(name: str, path: Path) -> Figure:
    """A figure with the caption of the paper's of that number."""
    found = re.search(r"(\d+)\D*$", name)
    number = int(found[1]) if found else 0
    caption, good = CAPTIONS.get(number, ("", ""))
    return Figure(embedded(path), caption, good, f"Figure {number}" if caption else name)
