"""The page of a diagnosis, its figures, and beside them the files that the diagnosis itself is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from dtbacklash import units
from dtbacklash.diagnose.named import Finding, Modelled, Recalibrated
from dtbacklash.diagnose.result import CONSISTENT, MISSING, PARAMETERS, UNEXPLAINED, Diagnosis
from dtbacklash.diagnose.say.save import save
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.words import named_in_words, other_in_words, place_in_words
from dtbacklash.files import json_text
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.rig_file import rig_yaml
from dtbacklash.report.diagnosis.figures import curve_figure, law_figure
from dtbacklash.report.diagnosis.methods import methods
from dtbacklash.report.diagnosis.rig_drawing import draw_rig
from dtbacklash.report.diagnosis.words import (
    answers,
    better_model,
    capital,
    error_text,
    formula_rows,
    heading,
    labels,
    next_command,
    partial,
)
from dtbacklash.report.kit.intervals import degrees, interval
from dtbacklash.report.kit.numbers import number
from dtbacklash.report.kit.page import embedded, render
from dtbacklash.report.kit.style import save as save_figure

SHOWN_CANDIDATES = 10
BADGES = {
    CONSISTENT: ("consistent", "good"),
    PARAMETERS: ("recalibrated", "fair"),
    MISSING: ("missing physics", "warm"),
    UNEXPLAINED: ("unexplained", "bad"),
}
MODELS = ("nominal", "recalibrated", "extended", "modelled")
#: from this many times the signal on, an error is only said to be over it
BEYOND = 10.0


@dataclass(frozen=True)
class Figures:
    """The figures as data URIs: the rig; (name, image) of each channel; (title, whether a law explains it, what it is
    drawn against, image) of each law."""

    rig: str
    curves: list[tuple[str, str]]
    laws: list[tuple[str, bool, str, str]]


def write(diagnosis: Diagnosis, folder: Path) -> None:
    """Write ``diagnosis.json``, ``rig.yaml``, ``figures/*.png`` and ``report.html`` into an existing folder."""
    save(diagnosis, folder)
    figures = _draw(diagnosis, folder / "figures")
    text, works = methods(diagnosis)
    best = better_model(diagnosis)
    page = render(
        "diagnosis.html.j2",
        title=heading(diagnosis),
        badge=BADGES[diagnosis.verdict],
        stopped=diagnosis.stopped,
        source=diagnosis.source,
        rig=diagnosis.nominal.config,
        answers=answers(diagnosis),
        findings=[_finding(f) for f in diagnosis.findings],
        recalibrated=[_recalibrated(n, r, diagnosis.nominal) for n, r in diagnosis.recalibrated.items()],
        calibration=_calibration(diagnosis),
        fit=_fit(diagnosis, best),
        verdict=diagnosis.verdict,
        rig_is="nominal rig, fitted within its tolerances," if diagnosis.verdict == CONSISTENT else f"{best} rig",
        best=best,
        evidence=len(diagnosis.shown.evidence),
        channels=diagnosis.fit.channels,
        checks=_checks(diagnosis),
        limits=_limits(diagnosis),
        unseen=[named_in_words(x.effect, x.location) for x in diagnosis.limits if not x.visible],
        candidates=_candidates(diagnosis),
        shown=SHOWN_CANDIDATES,
        next_experiment=diagnosis.next_experiment,
        figures=figures,
        part=_explained(diagnosis),
        notes=diagnosis.notes,
        recordings=_recordings(diagnosis, best),
        methods=text,
        works=works,
        command=next_command(diagnosis, "rig.yaml"),
        settings=SETTINGS.to_json(),
        json=json_text(diagnosis.to_json()),
        rig_yaml=rig_yaml(diagnosis.rig),
        modelled=_modelled(diagnosis.modelled) if diagnosis.modelled else None,
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _draw(diagnosis: Diagnosis, folder: Path) -> Figures:
    """Draw and save all figures."""
    model = better_model(diagnosis)
    shown = diagnosis.shown
    rig = embedded(save_figure(rig_figure(diagnosis), folder / "rig.png"))
    curves = [
        (c.name, embedded(save_figure(curve_figure(c, model), folder / f"curve_{c.name}.png"))) for c in shown.curves
    ]
    laws = []
    for index, law in enumerate(shown.laws):
        path = save_figure(law_figure(law), folder / f"law_{index + 1}_{law.location}.png")
        laws.append((named_in_words(law.effect, law.location), bool(law.effect), law.state_label, embedded(path)))
    return Figures(rig, curves, laws)


def rig_figure(diagnosis: Diagnosis) -> Figure:
    """The rig, with the evidence at each element and what was found there."""
    return draw_rig(diagnosis.nominal, diagnosis.shown.evidence, labels(diagnosis.findings))


def _explained(diagnosis: Diagnosis) -> str:
    """How much of what no law explains the best free form of one state does."""
    rest = diagnosis.located.rest if diagnosis.located else None
    return f"{100 * max(rest.explained, 0.0):.0f} %" if rest else ""


def _finding(finding: Finding) -> dict[str, Any]:
    parameters = [
        {"name": name_in_words(name), "text": interval(p.value, p.ci95, p.unit) + degrees(p.unit, p.value)}
        for name, p in finding.parameters.items()
    ]
    return {
        "title": capital(named_in_words(finding.effect, finding.location)) + partial(finding),
        "sentence": finding.sentence,
        "when": finding.when[:1].upper() + finding.when[1:],
        "parameters": parameters,
        "also": [other_in_words(a) for a in finding.also_fits],
    }


def _recalibrated(name: str, row: Recalibrated, rig: Rig) -> dict[str, Any]:
    known = rig.config.parameters.get(name)
    cells = [
        name,
        known.description if known else "",
        interval(row.nominal, None, row.unit, size=row.nominal),
        interval(row.value, row.ci95, row.unit, size=row.nominal),
        f"{100 * (row.value / row.nominal - 1):+.3g} %" if row.nominal else "-",
        f"± {number(100 * known.tolerance)} %" if known else "-",
    ]
    return {"name": name, "cells": cells, "also": [other_in_words(a) for a in row.also_fits]}


def _calibration(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """All parameters, their correlations, and the blind directions in words."""
    found = diagnosis.calibration
    if found is None or not found.parameters:
        return None
    return {
        "rows": [_recalibrated(name, row, diagnosis.nominal)["cells"] for name, row in found.parameters.items()],
        "heads": ["correlation", *(f"{name}#" for name in found.correlation)],
        "correlation": [[name, *(f"{value:.2f}" for value in row.values())] for name, row in found.correlation.items()],
        "blind": [one.sentence for one in found.blind],
    }


def _fit(diagnosis: Diagnosis, best: str) -> dict[str, Any]:
    """Rows of errors, compared and running freely; columns: the models that there are."""
    fit, free = diagnosis.fit, diagnosis.free_running
    columns = _columns(diagnosis, best)
    floor = error_text(fit.noise_floor, fit.metric)
    rows = [
        [words, *(error_text(getattr(errors, c), fit.metric) for c in columns), floor]
        for words, errors in (("fitted to", fit.train), ("held out", fit.held_out))
    ]
    alone = (("fitted to, on its own", free.train), ("held out, on its own", free.held_out)) if free else ()
    rows += [[words, *(_free_text(getattr(errors, c)) for c in columns), ""] for words, errors in alone]
    floors = [
        [channel, *(number(getattr(errors, c)) for c in columns if c != "modelled")]
        for channel, errors in diagnosis.shown.floors.items()
    ]
    heads = [f"{c}#" for c in columns]
    in_floors = [head for head in heads if head != "modelled#"]
    return {"metric": fit.metric, "heads": heads, "rows": rows, "floors": floors, "in_floors": in_floors}


def _columns(diagnosis: Diagnosis, best: str) -> list[str]:
    """The models of which there are errors."""
    there = {"extended": best == "extended", "modelled": diagnosis.modelled is not None}
    return [model for model in MODELS if there.get(model, True)]


def _modelled(modelled: Modelled) -> dict[str, Any]:
    """What no name explains, as the rig has it: the formulas that were tried, and the table's values."""
    x_unit, y_unit = (units.in_signs(unit) for unit in (modelled.state_unit, modelled.unit))
    return {
        "sentence": modelled.sentence, "effect": modelled.effect, "formulas": formula_rows(modelled),
        "heads": [f"{modelled.state} [{x_unit}]#", f"value [{y_unit}]#", "standard error#"],
        "points": [[f"{value:.4g}" for value in row] for row in modelled.points],
    }  # fmt: skip


def _recordings(diagnosis: Diagnosis, best: str) -> dict[str, Any]:
    """A row of each of several recordings: samples, sample time, held-out errors of the models, zeros."""
    columns = MODELS[:3] if best == "extended" else MODELS[:2]
    rows = []
    for k, one in enumerate(diagnosis.recordings, 1):
        errors = [error_text(getattr(one.held_out, c), diagnosis.fit.metric) if one.held_out else "-" for c in columns]
        zeros = [f"{c} {interval(float(z['value']), None, str(z['unit']))}" for c, z in one.zeros.items()]
        step = interval(one.sample_time_s, None, "s")
        rows.append([str(k), one.name, str(one.samples), step, *errors, ", ".join(zeros) or "-"])
    return {
        "heads": ["no.", "recording", "samples#", "sample time#", *(f"{c}#" for c in columns), "zeros"],
        "rows": rows,
    }


def _free_text(value: float | None) -> str:
    """The error of a model that runs freely, which may be anything."""
    if value is None:
        return "runs away"
    return error_text(value, "nrmse") if value < BEYOND else f"over {100 * BEYOND:.0f} %"


def _checks(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """The rows, those that fail first."""
    names = {*diagnosis.nominal.sensors, "u"}
    return [
        {
            "check": capital(c.check, names),
            "statistic": "-" if c.statistic is None else number(c.statistic),
            "threshold": f"{c.operator} {number(c.threshold)}",
            "passed": c.passed,
            "comment": capital(c.comment, names),
            "source": c.source,
        }
        for c in sorted(diagnosis.checks, key=lambda c: c.passed)
    ]


def _limits(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Effect, place, and the bound on the size of each effect that is not there."""
    rows = []
    for limit in diagnosis.limits:
        if limit.visible:
            value = limit.upper95 if limit.upper95 is not None else limit.lower95
            sign = "<" if limit.upper95 is not None else ">"
            shown, factor = units.shown(limit.unit)
            text = (
                f"{limit.parameter.replace('_', ' ')} {sign} {number(factor * (value or 0.0))} {units.in_signs(shown)}"
            )
            rows.append((name_in_words(limit.effect), place_in_words(limit.location), text.strip()))
    return rows


def _candidates(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    chosen = {(f.location, f.effect) for f in diagnosis.findings}
    alike = {(a.location, a.effect) for f in diagnosis.findings for a in f.also_fits}
    rows = []
    for candidate in diagnosis.candidates:
        key = (candidate.location, candidate.effect)
        rows.append({
            "location": place_in_words(candidate.location),
            "effect": name_in_words(candidate.effect),
            "score": candidate.score,
            "held_out": "-" if candidate.held_out is None else number(candidate.held_out),
            "verdict": candidate.verdict,
            "mark": "chosen" if key in chosen else "alike" if key in alike else "",
        })  # fmt: skip
    # what matters stays above the fold, whatever its score
    return sorted(rows, key=lambda row: ("chosen", "alike", "").index(row["mark"]))
