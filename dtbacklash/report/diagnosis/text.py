"""The first screen of a diagnosis in the terminal: what ``print(found)`` shows as well."""

from __future__ import annotations

from rich.console import RenderableType
from rich.text import Text

from dtbacklash.diagnose.named import Calibration
from dtbacklash.diagnose.records import COURSES
from dtbacklash.diagnose.result import Diagnosis
from dtbacklash.report.diagnosis.blocks import in_each
from dtbacklash.report.diagnosis.words import causes, checks_said, error_text, heading, left, together
from dtbacklash.report.kit import tables
from dtbacklash.report.kit.blocks import Table
from dtbacklash.report.kit.intervals import interval

#: a correlation of a parameter with another is told from here on
TOLD_CORRELATION = 0.5
MEANS = "What that means stands beside it in the report."


def lines(diagnosis: Diagnosis) -> list[RenderableType]:
    """The verdict in one sentence, a row a cause, what is left, which checks fail, what to record next."""
    said = heading(diagnosis)
    for known in ("Missing: ", "Unexplained: ", "Unexplained, but modelled: "):
        said = said.removeprefix(known)
    stopped = "stopped early; so far " if diagnosis.stopped else ""
    told: list[RenderableType] = [Text(f"{stopped}{diagnosis.verdict}: {said}", style="bold")]
    found, rest = causes(diagnosis, plain=True), left(diagnosis, plain=True)
    summed = not found.rows or bool(diagnosis.stopped or diagnosis.fault)
    if diagnosis.first and not summed:
        told.insert(0, _text(diagnosis.first))
    told += ["", tables.of(found)] if found.rows else []
    if summed:
        told.append(_text(diagnosis.summary))
    if diagnosis.calibration and not diagnosis.findings:
        told += _calibrated(diagnosis.calibration)
    told += ["", tables.of(rest)] if rest.rows else []
    told += [_text(said) for said in (diagnosis.zeros, *(n for n in diagnosis.notes if n in COURSES)) if said]
    ends = [
        [one.name, *(error_text(e, diagnosis.fit.metric) for e in (one.held_out.nominal, one.held_out.extended))]
        for one in diagnosis.recordings if one.held_out
    ]  # fmt: skip
    told += (
        ["", tables.of(Table(("recording", "before#", "now#"), ends, "Error of each where it judges"))] if ends else []
    )
    told += ["", tables.of(each)] if (each := in_each(diagnosis, plain=True)).rows else []
    told += [Text(), Text(together(diagnosis))] if together(diagnosis) else [Text()]
    failed = [c.check for c in diagnosis.checks if not c.passed]
    told += [Text(f"{checks_said(len(diagnosis.checks), failed)} {MEANS}")] if failed else []
    if diagnosis.next_experiment:
        told += [_text(f"To record next: {diagnosis.next_experiment}")]
    return told


def _text(words: str) -> Text:
    return Text(words.replace("`", ""))


def _calibrated(found: Calibration) -> list[RenderableType]:
    """The parameters where nothing was found, with their largest correlations; what the recording does not tell."""
    rows = []
    for name, row in found.parameters.items():
        others = [(abs(c), f"{c:+.2f} with {n}") for n, c in found.correlation[name].items() if n != name]
        most, said = max(others, default=(0.0, ""))
        value = interval(row.value, row.ci95, row.unit, plain=True, size=row.nominal)
        change = f"{100 * (row.value / row.nominal - 1):+.3g} %" if row.nominal else "-"
        rows.append([name, value, change, said if most >= TOLD_CORRELATION else ""])
    told: list[RenderableType] = []
    if rows:
        told += ["", tables.of(Table(("parameter", "95 % interval", "change#", "correlation"), rows, "Parameters"))]
    blind = [one.sentence for one in found.blind]
    return told + ([_text(f"Not told beyond the tolerances: {' '.join(blind)}")] if blind else [])
