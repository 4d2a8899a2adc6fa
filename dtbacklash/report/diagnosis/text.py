"""A diagnosis in lines for the terminal."""

from __future__ import annotations

from rich.text import Text

from dtbacklash.diagnose.result import CONSISTENT, UNEXPLAINED, Diagnosis, Finding, Recalibrated
from dtbacklash.diagnose.words import other_in_words
from dtbacklash.report.diagnosis.words import heading, listed, partial
from dtbacklash.report.kit.intervals import interval


def lines(diagnosis: Diagnosis) -> list[Text]:
    """The verdict, what was found with intervals, what cannot be told apart, which checks fail, what to record next.

    Findings and recalibrated parameters say what the summary says; it stands here where there are none.
    """
    verdict = heading(diagnosis).removeprefix("Missing: ").removeprefix("Unexplained: ")
    told = [Text(f"{diagnosis.verdict}: {verdict}", style="bold")]
    if diagnosis.verdict in (CONSISTENT, UNEXPLAINED) and not diagnosis.findings:
        told.append(Text(diagnosis.summary))
    for finding in diagnosis.findings:
        told += [Text(), Text(finding.sentence + partial(finding))]
        for name, p in finding.parameters.items():
            told.append(Text(f"  {name} = {interval(p.value, p.ci95, p.unit, plain=True)}"))
        told += _alike(finding)
    if diagnosis.recalibrated:
        told += [Text(), Text("Recalibrated (95 % intervals):")]
    for name, row in diagnosis.recalibrated.items():
        nominal = interval(row.nominal, None, row.unit, plain=True, size=row.nominal)
        value = interval(row.value, row.ci95, row.unit, plain=True, size=row.nominal)
        told.append(Text(f"  {name} = {value} (nominal {nominal})"))
        told += _alike(row)
    if diagnosis.checks:
        failed = [c.check for c in diagnosis.checks if not c.passed]
        passed = len(diagnosis.checks) - len(failed)
        fails = f"; failed: {listed(failed)}" if failed else ""
        told += [Text(), Text(f"Checks: {passed} of {len(diagnosis.checks)} passed{fails}.")]
    if diagnosis.units:
        read = ", ".join(f"{channel} in {unit}" for channel, unit in diagnosis.units.items())
        told += [Text(), Text(f"Units: {read}.")]
    if diagnosis.next_experiment:
        told += [Text(), Text(f"To record next: {diagnosis.next_experiment}")]
    return told


def _alike(row: Finding | Recalibrated) -> list[Text]:
    """A line of what a finding or a parameter cannot be told from, if there is any."""
    others = "; ".join(other_in_words(a) for a in row.also_fits)
    return [Text("  this recording cannot tell it from " + others)] if others else []
