"""A diagnosis in lines for the terminal."""

from __future__ import annotations

from rich.text import Text

from dtbacklash.physics.catalogue import name_in_words
from dtbacklash.report.diagnosis_page import View, heading, place_in_words
from dtbacklash.report.intervals import interval


def lines(view: View) -> list[Text]:
    """The verdict, what was found with intervals, what cannot be told apart, what to record next."""
    diagnosis = view.diagnosis
    told = [Text(f"{diagnosis['verdict']}: {heading(view)}", style="bold"), Text(diagnosis["summary"])]
    for finding in diagnosis["findings"]:
        told += [Text(), Text(finding.get("sentence") or _name(finding))]
        for name, p in finding.get("parameters", {}).items():
            told.append(Text(f"  {name} = {interval(p['value'], p.get('ci95'), p['unit'], plain=True)}"))
        if finding["also_fits"]:
            told.append(Text("  this recording cannot tell it from " + "; ".join(map(_name, finding["also_fits"]))))
    if diagnosis["recalibrated"]:
        told += [Text(), Text("Recalibrated (95 % intervals):")]
    for name, row in diagnosis["recalibrated"].items():
        nominal = interval(row["nominal"], None, row["unit"], plain=True, size=row["nominal"])
        value = interval(row["value"], row.get("ci95"), row["unit"], plain=True, size=row["nominal"])
        told.append(Text(f"  {name} = {value} (nominal {nominal})"))
    if diagnosis.get("next_experiment"):
        told += [Text(), Text(f"To record next: {diagnosis['next_experiment']}")]
    return told


def _name(finding: dict) -> str:
    effect = name_in_words(finding["effect"]) if finding.get("effect") else "something unexplained"
    return f"{effect} at the {place_in_words(finding['location'])}"
