"""The first screen of a diagnosis in the terminal: what ``print(found)`` shows as well."""

from __future__ import annotations

from rich.console import RenderableType
from rich.text import Text

from dtbacklash.diagnosis.engine.intervals import NORMAL95
from dtbacklash.diagnosis.findings import Calibration
from dtbacklash.diagnosis.records import COURSES
from dtbacklash.diagnosis.result import Diagnosis
from dtbacklash.report.components import tables
from dtbacklash.report.components.blocks import Table
from dtbacklash.report.components.intervals import interval, scaled
from dtbacklash.report.components.numbers import change, number, percent
from dtbacklash.report.diagnosis.blocks import in_each
from dtbacklash.report.diagnosis.words import causes, error_text, failing, heading, left, together

#: the same in a report of the fit, as lmfit does
REPORTED_CORRELATION = 0.1
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
    told += [Text(f"{failing(diagnosis)} {MEANS}")] if failing(diagnosis) else []
    if diagnosis.next_experiment:
        told += [_text(f"To record next: {diagnosis.next_experiment}")]
    return told


def fit_report(found: Calibration) -> list[RenderableType]:
    """Every fitted parameter with its value, standard error, bounds given; the correlations of their errors."""
    rows = []
    for name, row in found.parameters.items():
        error = (row.ci95[1] - row.ci95[0]) / (2.0 * NORMAL95)
        factor, unit = scaled(row.unit, row.nominal)
        share = percent(error / abs(row.value), 2, plain=True) if row.value else "-"
        values = [number(v / factor, 5, plain=True) for v in (row.value, error, row.nominal)]
        rows.append([f"{name} [{unit}]", *values[:2], share, values[2], change(row.value, row.nominal)])
    heads = ("parameter", "value#", "std. error#", "of it#", "nominal#", "change#")
    names = list(found.correlation)
    pairs = [(a, b, found.correlation[a][b]) for i, a in enumerate(names) for b in names[i + 1 :]]
    far = sorted((p for p in pairs if abs(p[2]) >= REPORTED_CORRELATION), key=lambda p: -abs(p[2]))
    told: list[RenderableType] = [tables.of(Table(heads, rows, "Fitted parameters"))]
    if far:
        title = f"Correlations of their errors, from {REPORTED_CORRELATION} on"
        told += [
            "",
            tables.of(Table(("parameter", "with", "correlation#"), [[a, b, f"{c:+.3f}"] for a, b, c in far], title)),
        ]
    return told + [_text(f"Not told beyond the tolerances: {one.sentence}") for one in found.blind]


def _text(words: str) -> Text:
    return Text(words.replace("`", ""))


def _calibrated(found: Calibration) -> list[RenderableType]:
    """The parameters where nothing was found, with their largest correlations; what the recording does not tell."""
    rows = []
    for name, row in found.parameters.items():
        others = [(abs(c), f"{c:+.2f} with {n}") for n, c in found.correlation[name].items() if n != name]
        most, said = max(others, default=(0.0, ""))
        value = interval(row.value, row.ci95, row.unit, plain=True, size=row.nominal)
        rows.append([name, value, change(row.value, row.nominal), said if most >= TOLD_CORRELATION else ""])
    told: list[RenderableType] = []
    if rows:
        told += ["", tables.of(Table(("parameter", "95 % interval", "change#", "correlation"), rows, "Parameters"))]
    blind = [one.sentence for one in found.blind]
    return told + ([_text(f"Not told beyond the tolerances: {' '.join(blind)}")] if blind else [])
