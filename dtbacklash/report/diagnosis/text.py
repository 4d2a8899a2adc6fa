"""A diagnosis in lines for the terminal."""

from __future__ import annotations

from rich.text import Text

from dtbacklash.diagnose.named import Calibration, Finding, Modelled, Recalibrated
from dtbacklash.diagnose.result import Diagnosis
from dtbacklash.diagnose.words import named_in_words, other_in_words
from dtbacklash.report.diagnosis.words import capital, checks_said, error_text, formula_rows, heading, partial
from dtbacklash.report.kit.intervals import interval

#: a correlation of a parameter with another is told from here on
TOLD_CORRELATION = 0.5


def lines(diagnosis: Diagnosis) -> list[Text]:
    """The verdict, what was found with intervals, what cannot be told apart, which checks fail, what to record next."""
    said = (
        heading(diagnosis)
        .removeprefix("Missing: ")
        .removeprefix("Unexplained: ")
        .removeprefix("Unexplained, but modelled: ")
    )
    stopped = "stopped early; so far " if diagnosis.stopped else ""
    told = [Text(f"{stopped}{diagnosis.verdict}: {said}", style="bold"), Text(diagnosis.summary.replace("`", ""))]
    for finding in diagnosis.findings:
        title = capital(named_in_words(finding.effect, finding.location))
        told += [Text(), Text(title + partial(finding))]
        for name, p in finding.parameters.items():
            told.append(Text(f"  {name} = {interval(p.value, p.ci95, p.unit, plain=True)}"))
        told += _alike(finding)
    if diagnosis.modelled:
        told += _formulas(diagnosis.modelled)
    if diagnosis.recalibrated:
        told += [Text(), Text("Recalibrated (95 % intervals):")]
    for name, row in diagnosis.recalibrated.items():
        nominal = interval(row.nominal, None, row.unit, plain=True, size=row.nominal)
        value = interval(row.value, row.ci95, row.unit, plain=True, size=row.nominal)
        told.append(Text(f"  {name} = {value} (nominal {nominal})"))
        told += _alike(row)
    if diagnosis.calibration:
        told += _calibrated(diagnosis.calibration, not diagnosis.findings)
    if diagnosis.recordings:
        told += [Text(), Text("Held-out error of each recording, nominal and in the end:")]
    for one in diagnosis.recordings:
        if one.held_out:
            ends = (error_text(e, diagnosis.fit.metric) for e in (one.held_out.nominal, one.held_out.extended))
            told.append(Text(f"  {one.name}: {', '.join(ends)}"))
    if diagnosis.checks:
        failed = [c.check for c in diagnosis.checks if not c.passed]
        told += [Text(), Text(checks_said(len(diagnosis.checks), failed))]
    if diagnosis.units:
        read = ", ".join(f"{channel} in {unit}" for channel, unit in diagnosis.units.items())
        told += [Text(), Text(f"Units: {read}.")]
    if diagnosis.next_experiment:
        told += [Text(), Text(f"To record next: {diagnosis.next_experiment}".replace("`", ""))]
    return told


def _formulas(modelled: Modelled) -> list[Text]:
    """The formulas that were tried in the place of a table."""
    told = [Text(), Text(f"Modelled as {modelled.effect}; formulas that were tried:")]
    for family, law, values, left, said in formula_rows(modelled, plain=True):
        told.append(Text(f"  {family}, {said}: {law}, {values}; leaves {left} times what the table leaves"))
    return told


def _calibrated(found: Calibration, rows: bool) -> list[Text]:
    """The parameters with their intervals and largest correlations (where nothing was found), the blind directions."""
    told = [Text(), Text("Parameters (95 % intervals):")] if rows and found.parameters else []
    for name, row in found.parameters.items() if rows else ():
        other, most = max(
            ((n, c) for n, c in found.correlation[name].items() if n != name), key=lambda one: abs(one[1]),
            default=("", 0.0),
        )  # fmt: skip
        value = interval(row.value, row.ci95, row.unit, plain=True, size=row.nominal)
        with_other = f", correlation {most:+.2f} with {other}" if abs(most) >= TOLD_CORRELATION else ""
        told.append(Text(f"  {name} = {value}{with_other}"))
    if found.blind:
        told += [Text(), Text("What this recording does not tell beyond the tolerances:")]
        told += [Text("  " + one.sentence.replace("`", "")) for one in found.blind]
    return told


def _alike(row: Finding | Recalibrated) -> list[Text]:
    """A line of what a finding or a parameter cannot be told from, if there is any."""
    others = "; ".join(other_in_words(a) for a in row.also_fits)
    return [Text("  this recording cannot tell it from " + others)] if others else []
