"""The page of a loop that was closed over a diagnosis: what was found, and what the loop makes of it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from dtbacklash.closing import COLUMNS, Closed
from dtbacklash.config.run import RunConfig
from dtbacklash.control.belief import beliefs_of, settled
from dtbacklash.diagnose.result import Diagnosis
from dtbacklash.report.closing.figure import beliefs_figure
from dtbacklash.report.kit.blocks import Block, Code, Figure, Link, Table
from dtbacklash.report.kit.numbers import number, quantity
from dtbacklash.report.kit.page import embedded, render
from dtbacklash.report.kit.style import save
from dtbacklash.report.run.words import as_yaml, describe, subjects

HEADINGS = {
    "belief": "belief",
    "overshoot_pct": "largest overshoot [%]",
    "settling_time_s": "longest settling time [s]",
    "estimations": "estimations",
    "accepted": "accepted estimates",
    "largest_gap_error_deg": "largest error of an accepted gap [deg]",
}
MEANINGS = {
    "nominal": "controller and twin believe in the nominal rig",
    "twin only": "the twin knows what was found, the controller does not",
    "design only": "the controller knows what was found, the twin does not",
    "both": "controller and twin know what was found",
    "truth": "controller and twin know the machine as it is",
}
CAPTION = (
    "The largest overshoot with each belief, and the output at the move that the nominal belief does worst.",
    "If what was found is right, the bar of “both” is as short as that of “truth” and its line lies on the dotted one.",
)


def write(closed: Closed, config: RunConfig, folder: Path, command: str) -> None:
    """Write ``report.html`` and, if wanted, ``figures/close_the_loop.png`` into an existing folder.

    config : of the loop, before anything was found.
    """
    figure = []
    if config.figures:
        (folder / "figures").mkdir(exist_ok=True)
        path = save(beliefs_figure(closed.table, closed.runs), folder / "figures" / "close_the_loop.png")
        figure = [Figure(embedded(path), *CAPTION)]
    heads = [HEADINGS[name] + ("#" if k else "") for k, name in enumerate(COLUMNS)]
    rows = [[*_cells(row), MEANINGS[str(row["belief"])]] for row in closed.table.to_dict("records")]
    said = f"The verdict is “{closed.diagnosis.verdict.replace('_', ' ')}”. "
    page = render(
        "From a recording to a controller",
        "The machine was recorded in its loop, the recording was diagnosed, and the loop was run with what was found.",
        [
            Block("What was found", [
                found_in_words(closed.diagnosis),
                Link(said, "found/report.html", "The page of the diagnosis", " has the details."),
            ]),
            Block("What the loop makes of it", [*figure, Table((*heads, "what it is"), rows)]),
            Block("What was run", [subjects(describe(settled(config, beliefs_of(config))))], folded=True),
            Block("Run it again, and all settings", [
                Code(command), Block("Configuration, resolved", [Code(as_yaml(config))], folded=True),
                "The table is also in `close_the_loop.csv`, and the rig that was found is in `found/rig.yaml`. To run "
                "the machine under a controller that knows what was found, give its own settings and "
                "`model=found/rig.yaml`.",
            ], folded=True),
        ],
    )  # fmt: skip
    (folder / "report.html").write_text(page, encoding="utf-8")


def _cells(row: dict[Any, Any]) -> list[str]:
    error = row["largest_gap_error_deg"]
    others = [number(row[name], 3, "-") for name in COLUMNS[1:-1]]
    return [str(row["belief"]), *others, "-" if math.isnan(error) else f"{error:.2f}"]


def found_in_words(diagnosis: Diagnosis) -> str:
    """What was found and what had to move, one sentence after the other."""
    moved = [
        f"{name} is {quantity(r.value, r.unit)} instead of {quantity(r.nominal, r.unit)}"
        for name, r in diagnosis.recalibrated.items()
    ]
    told = diagnosis.summary if diagnosis.findings or not moved else ""
    return f"{told} Recalibrated: {', '.join(moved)}.".strip() if moved else diagnosis.summary
