"""The page of a sweep: its figure, a row a job with a link to that job's own page, and why some failed."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

import pandas as pd

from dtbacklash.diagnosis.labels import listed
from dtbacklash.files import write_text
from dtbacklash.report.components.blocks import Block, Figure, Link, Table, Tiles
from dtbacklash.report.components.numbers import number
from dtbacklash.report.components.page import embedded, render
from dtbacklash.report.sweep.figure import PANELS, draw

#: columns of the table that are no result
KEPT_BACK = ("folder", "status", "error")
HEADINGS = {
    "overshoot_pct_max": "largest overshoot [%]",
    "settling_time_s_max": "longest settling time [s]",
    "peak_voltage_v": "peak voltage [V]",
    "n_estimations": "estimations",
    "n_accepted": "accepted",
}
#: the same for a terminal, without the accepted
SHORT = {
    "overshoot_pct_max": "over-\nshoot [%]", "settling_time_s_max": "settling\ntime [s]", "peak_voltage_v": "peak\n[V]",
    "n_estimations": "esti-\nmates",
}  # fmt: skip
#: of which less is better
MERIT = ("overshoot_pct_max", "settling_time_s_max", "peak_voltage_v")
#: jobs that are named where several are alike
MOST_WINNERS = 3
#: what a missing value of a job that is done means
MISSING = {"settling_time_s_max": "not settled"}
CAPTION = (
    "Every job: largest overshoot, longest settling time and number of estimations, over what was swept.",
    "A cross is a failed job, an arrow a job with a move that does not settle. Where the swept setting does not "
    "matter, the markers lie close together.",
)


def write(folder: Path, table: pd.DataFrame, axes: list[str]) -> None:
    """Write `report.html` into the folder of a sweep, at once.

    folder: where the jobs' folders are; its `sweep.png` is shown, or drawn if it is not there yet and the table has
        something to draw.
    table: one row a job. Columns: the swept keys, results (numbers, or words), `status` (see `figure.draw`),
        `error` (why it failed), and `folder`: the name of the job's folder within `folder`, to which the page
        links if there is a report.
    axes: names of the swept keys, in the order to be read; may be empty.
    """
    failed = table["status"] != "done"
    axes = [name for name in axes if name in table]
    results = [str(name) for name in table.columns if name not in (*axes, *KEPT_BACK)]
    numbers = {name: _is_number(table[name]) for name in results}
    heads = ["job#", "", *axes, *(HEADINGS.get(name, name) + ("#" if numbers[name] else "") for name in results)]
    jobs = [
        [
            str(k),
            _link(folder, row, bad),
            *(_cell(row[name], name, numbers.get(name, False), bad) for name in (*axes, *results)),
        ]
        for k, (row, bad) in enumerate(zip(table.to_dict("records"), failed, strict=True), 1)
    ]
    why = [
        [_choices(row, axes), str(row.get("error") or "it left no reason")] for row in table[failed].to_dict("records")
    ]
    page = render(
        f"Sweep over {listed(axes)}" if axes else "Sweep",
        f"{len(table)} jobs, one for each combination of what was swept.",
        [
            Block("The best of each figure of merit", [winners(table, axes)]),
            Tiles(_tiles(table, axes, failed)),
            Block("What failed", [Table(("job", "why"), why)]),
            Block("Overview", _figure(folder, table, axes)),
            Block("Jobs", [Table(heads, jobs)]),
            Block("Files", [
                "The table is also in `sweep.csv`, next to this page. Each job has a folder of its own with everything "
                "that one run writes.",
            ]),
        ],
    )  # fmt: skip
    write_text(folder / "report.html", page, "hydra.sweep.dir", folder)


def winners(table: pd.DataFrame, axes: list[str]) -> Table:
    """A row a figure of merit: which job has the least of it, and by how much; none where all jobs have the same."""
    done, rows = table[table["status"] == "done"], []
    for name in MERIT if len(done) > 1 else ():
        values = pd.to_numeric(done[name], errors="coerce").dropna() if name in done else pd.Series(dtype=float)
        ordered = values.sort_values(kind="stable")
        least = ordered.iloc[0] if len(ordered) else 0.0
        others = ordered[ordered > least]
        missed = len(done) - len(values)
        if not len(ordered) or not (len(others) or missed):
            continue
        best = "; ".join(_choices(table.loc[k].to_dict(), axes) for k in ordered.index[ordered == least][:MOST_WINNERS])
        more = int((ordered == least).sum()) - MOST_WINNERS
        best += f" and {more} more" if more > 0 else ""
        rows.append([HEADINGS[name], best, number(least, 4), _ahead(table, axes, least, others, missed)])
    return Table(("figure of merit", "least of it", "value#", "by how much"), rows, "Winners")


def _ahead(table: pd.DataFrame, axes: list[str], least: float, others: pd.Series, missed: int) -> str:
    """By how much the least value is below the next one."""
    if not len(others):
        return f"{missed} do not settle" if missed > 1 else "the other does not settle"
    value = others.iloc[0]
    share = f", {number(100.0 * (value - least) / abs(value), 2)} % less" if value else ""
    following = _choices(table.loc[others.index[0]].to_dict(), axes)
    return f"{number(value - least)} below {following} ({number(value, 4)}{share})"


def _is_number(column: pd.Series) -> bool:
    known = column.dropna()
    return bool(len(known)) and bool(pd.to_numeric(known, errors="coerce").notna().all()) and column.dtype != bool


def _link(folder: Path, row: dict[Any, Any], failed: bool) -> str | Link:
    """To the job's own page, where it has one."""
    name = row.get("folder")
    there = not failed and isinstance(name, str) and (folder / name / "report.html").is_file()
    return Link("", f"{quote(str(name))}/report.html", "report") if there else "failed" if failed else "done"


def _cell(value: Any, name: str, is_number: bool, failed: bool) -> str:
    return number(value, 4 if is_number else 6, "" if failed else MISSING.get(name, "-"))


def _tiles(table: pd.DataFrame, axes: list[str], failed: pd.Series) -> list[tuple[str, str]]:
    tiles = [(f"{len(table) - int(failed.sum())} of {len(table)}", "jobs done")]
    tiles += [(str(table[name].astype(str).nunique()), f"values of {name}") for name in axes[:3]]
    return tiles


def _choices(row: dict[Any, Any], axes: list[str]) -> str:
    return ", ".join(f"{name}={row[name]}" for name in axes) or str(row.get("folder", "the job"))


def _figure(folder: Path, table: pd.DataFrame, axes: list[str]) -> list[Figure]:
    """The sweep's figure; none where the table has none of its figures of merit."""
    if not any(name in table for name in PANELS):
        return []
    path = folder / "sweep.png"
    return [Figure(embedded(path if path.is_file() else draw(table, axes, path)), *CAPTION)]


def terminal(table: pd.DataFrame, axes: list[str]) -> Table:
    """The jobs of a sweep for a terminal: the swept keys ``axes``, then what came out."""
    results = {name: head for name, head in SHORT.items() if name in table}
    if not results:  # of another command than `dtb run`
        results = {str(n): str(n).replace("_", "\n") for n in table if n not in {*KEPT_BACK, *axes}}
    rows = [
        [*(number(row[name], 4, plain=True) for name in (*axes, *results)),
         "ok" if row["status"] == "done" else "FAILED"]
        for row in table.to_dict("records")
    ]  # fmt: skip
    return Table((*axes, *(f"{head}#" for head in results.values()), ""), rows, "Sweep")
