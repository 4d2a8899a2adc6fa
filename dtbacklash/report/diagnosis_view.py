"""From a diagnosis to what its page shows: curves of every channel, the rig before and after, where the evidence is."""

import numpy as np

from dtbacklash.diagnose import Diagnosis
from dtbacklash.diagnose.compare import predict
from dtbacklash.diagnose.recover import Recovered
from dtbacklash.report.diagnosis_figures import Curve, Force
from dtbacklash.report.diagnosis_page import View


def view_of(diagnosis: Diagnosis, source: str, notes: list[str]) -> View:
    """What the page of a diagnosis shows. source : name of the recording; notes : what its reader said."""
    document = diagnosis.to_json()
    document = {**document, "notes": [*notes, *document["notes"]]}
    scores: dict[str, float] = {}
    for row in document["candidates"]:
        score = row["score"]
        if score is not None and np.isfinite(score):
            scores[row["location"]] = max(scores.get(row["location"], 0.0), abs(float(score)))
    top = max(scores.values(), default=0.0)
    evidence = {place: score / top for place, score in scores.items()} if top > 0 else {}
    return View(
        diagnosis=document,
        rig=diagnosis.nominal,
        extended=diagnosis.extended,
        evidence=evidence,
        curves=_curves(diagnosis),
        # where a block is driven by what is imposed on it, a force may show nowhere: there is nothing to draw then
        forces=[_force(effect, found) for effect, found in diagnosis.recovered if np.any(found.effort)],
        notes=notes,
        source=source,
    )


def _force(effect: str, found: Recovered) -> Force:
    label = "time" if found.state == "time" else f"{found.state} of {found.place.replace('_', ' ')}"
    return Force(
        found.place, effect, label, found.state_unit, found.effort_unit, found.knots, found.effort, found.error,
        found.law,
    )  # fmt: skip


def _curves(diagnosis: Diagnosis) -> list[Curve]:
    """Measured, nominal and extended, a channel and a recording each, at the scale of the comparison."""
    curves = []
    evidence = diagnosis.evidence
    for number, record in enumerate(evidence.records):
        t_s = np.arange(record.samples, dtype=np.float64) * record.sample_time_s
        held = np.flatnonzero(record.held)
        for block in evidence.blocks:
            nominal = predict(diagnosis.nominal, block, record)
            extended = predict(diagnosis.extended, block, record)
            for j, channel in enumerate(block.channels):
                name = channel if number == 0 else f"{channel} (recording {number + 1})"
                curves.append(
                    Curve(
                        name=name,
                        unit=diagnosis.nominal.sensors[channel].unit,
                        t_s=t_s,
                        measured=record.y[channel],
                        nominal=nominal[:, j],
                        extended=extended[:, j],
                        held_out_from_s=float(t_s[held[0]]) if held.size else None,
                        noise_floor=float(evidence.floor[block.name][j]),
                    )
                )
    return curves
