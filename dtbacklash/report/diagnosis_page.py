"""The files of a diagnosis: diagnosis.json, rig.yaml, the figures and the page."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dtbacklash.physics.catalogue import name_in_words
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.physics.rig_file import rig_yaml
from dtbacklash.report.diagnosis_figures import Curve, Force, curve_figure, force_figure
from dtbacklash.report.intervals import degrees, interval
from dtbacklash.report.numbers import number
from dtbacklash.report.page import embedded, render
from dtbacklash.report.rig_drawing import SHARE_MIN, draw_rig
from dtbacklash.report.style import save
from dtbacklash.report.words import plain

SHOWN_CANDIDATES = 10
BADGES = {
    "consistent": ("consistent", "good"),
    "parameters": ("recalibrated", "fair"),
    "missing_physics": ("missing physics", "warm"),
    "unexplained": ("unexplained", "bad"),
}
MODELS = ("nominal", "recalibrated", "extended")
PARTS = {"train": "fitted to", "held_out": "held out"}


@dataclass(frozen=True)
class View:
    """All that the report shows; no logic is left for it.

    Attributes
    ----------
    diagnosis : the contents of diagnosis.json.
    rig, extended : the nominal rig, and the one with findings and recalibrated parameters.
    evidence : element or ``sensor_<name>`` -> share of the evidence that is located there, 0 to 1.
    curves : a channel each. forces : recovered forces, the most important first.
    notes : what the reader of the recording said. source : name of the recording.
    """

    diagnosis: dict[str, Any]
    rig: Rig
    extended: Rig
    evidence: dict[str, float]
    curves: list[Curve]
    forces: list[Force] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    source: str = "recording"


def write(view: View, folder: Path) -> None:
    """Write ``diagnosis.json``, ``rig.yaml``, ``figures/*.png`` and ``report.html`` into an existing folder."""
    diagnosis = finite(plain(view.diagnosis))
    text = json.dumps(diagnosis, indent=2, allow_nan=False, ensure_ascii=False)
    (folder / "diagnosis.json").write_text(text + "\n", encoding="utf-8")
    rig_text = rig_yaml(view.extended)
    (folder / "rig.yaml").write_text(rig_text, encoding="utf-8")
    figures = _draw(view, folder / "figures")
    page = render(
        "diagnosis.html.j2",
        title=heading(view),
        badge=BADGES[diagnosis["verdict"]],
        source=view.source,
        rig=view.rig.config,
        summary=diagnosis["summary"],
        tiles=_tiles(diagnosis),
        findings=[_finding(f) for f in diagnosis["findings"]],
        recalibrated=[_recalibrated(n, r, view.rig) for n, r in diagnosis["recalibrated"].items()],
        fit=_fit(diagnosis["fit"], better_model(diagnosis)),
        verdict=diagnosis["verdict"],
        rig_is="nominal" if diagnosis["verdict"] == "consistent" else better_model(diagnosis),
        located=any(share >= SHARE_MIN for share in view.evidence.values()),
        channels=diagnosis["fit"].get("channels", []),
        candidates=_candidates(diagnosis),
        shown=SHOWN_CANDIDATES,
        next_experiment=diagnosis.get("next_experiment") or "",
        figures=figures,
        notes=view.notes,
        command="dtb run rig=rig.yaml" + ("" if view.extended.only("gear") else " controller=open_loop"),
        json=text,
        rig_yaml=rig_text,
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def finite(value: Any) -> Any:
    """Nested plain data with null for what JSON has not: NaN and infinity."""
    if isinstance(value, dict):
        return {name: finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def place_in_words(location: str) -> str:
    """``sensor_q3`` is ``sensor q3`` (its name stays as it is), ``motor_bearing`` is ``motor bearing``."""
    if location.startswith(SENSOR_PREFIX):
        return "sensor " + location.removeprefix(SENSOR_PREFIX)
    return name_in_words(location)


def heading(view: View) -> str:
    """The verdict in one line."""
    diagnosis = view.diagnosis
    verdict, findings = diagnosis["verdict"], diagnosis["findings"]
    named = _by_place([(f["location"], f["effect"]) for f in findings if f.get("effect")])
    if verdict == "consistent":
        return "The model explains this recording"
    if verdict == "parameters":
        which = listed([str(name) for name in diagnosis["recalibrated"]])
        return f"No physics is missing; recalibrate {which}"
    if verdict == "missing_physics":
        return f"Missing: {listed(named)}"
    place = next((f["location"] for f in findings if not f.get("effect")), None)
    place = place or (diagnosis.get("located") or {}).get("location")
    if place is None and any(view.evidence.values()):
        place = max(view.evidence, key=lambda name: view.evidence[name])
    where = f" at the {place_in_words(place)}" if place else ""
    rest = f"beside {listed(named)}, " if named else ""
    return f"Unexplained: {rest}something acts{where} that the catalogue does not hold"


def _by_place(found: list[tuple[str, str]]) -> list[str]:
    """``Coulomb friction and constant force at the carriage``, ...: a text a place."""
    places = list(dict.fromkeys(location for location, _ in found))
    return [
        f"{listed([name_in_words(e) for there, e in found if there == place])} at the {place_in_words(place)}"
        for place in places
    ]


def better_model(diagnosis: dict[str, Any]) -> str:
    """What to call the model that is set against the nominal one: without a named effect it is recalibrated only."""
    return "extended" if any(f.get("effect") for f in diagnosis["findings"]) else "recalibrated"


def listed(names: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def error_text(value: float | None, metric: str) -> str:
    """An error of fit; a normalised one in percent."""
    if value is None:
        return "-"
    return f"{number(100 * value)} %" if metric == "nrmse" else number(value)


def _draw(view: View, folder: Path) -> dict[str, Any]:
    """The figures as data URIs by what they are."""
    model = better_model(view.diagnosis)
    drawn = draw_rig(view.rig, view.evidence, _labels(view.diagnosis))
    found: dict[str, Any] = {"rig": embedded(save(drawn, folder / "rig.png")), "curves": [], "forces": []}
    for curve in view.curves:
        path = save(curve_figure(curve, model), folder / f"curve_{curve.name}.png")
        found["curves"].append((curve.name, embedded(path)))
    for index, force in enumerate(view.forces):
        path = save(force_figure(force), folder / f"force_{index + 1}_{force.location}.png")
        name = name_in_words(force.effect) if force.effect else "something unexplained"
        found["forces"].append((f"{name} at the {place_in_words(force.location)}", force, embedded(path)))
    return found


def _labels(diagnosis: dict[str, Any]) -> list[tuple[str, str]]:
    """What stands below an element: effect and the size that it has."""
    labels = []
    for finding in diagnosis["findings"]:
        effect = name_in_words(finding["effect"]) if finding.get("effect") else "unexplained"
        sensor = finding["location"].startswith(SENSOR_PREFIX)  # its label stands below what it watches
        lines = [f"{place_in_words(finding['location'])}: {effect}" if sensor else effect]
        parameters = list(finding.get("parameters", {}).values())
        if parameters:
            first = parameters[0]
            lines.append(interval(first["value"], first.get("ci95"), first["unit"]))
        labels.append((finding["location"], "\n".join(lines)))
    return labels


def _tiles(diagnosis: dict[str, Any]) -> list[tuple[str, str]]:
    """The few numbers to be read first: (value, what it is)."""
    fit, metric = diagnosis["fit"], diagnosis["fit"].get("metric", "")
    held = fit["held_out"]
    best = better_model(diagnosis)
    tiles = [(error_text(held.get("nominal"), metric), "error of the nominal model on held-out data")]
    if diagnosis["verdict"] != "consistent" and held.get(best) is not None:
        tiles.append((error_text(held[best], metric), f"error of the {best} model on held-out data"))
    if fit.get("noise_floor") is not None:
        tiles.append((error_text(fit["noise_floor"], metric), "noise floor: no model can do better"))
    return tiles


def _finding(finding: dict[str, Any]) -> dict[str, Any]:
    parameters = [
        {
            "name": name_in_words(name),
            "text": interval(p["value"], p.get("ci95"), p["unit"]) + degrees(p["unit"], p["value"]),
        }
        for name, p in finding.get("parameters", {}).items()
    ]
    effect = name_in_words(finding["effect"]) if finding.get("effect") else "something unexplained"
    return {
        "title": f"{effect[:1].upper()}{effect[1:]} at the {place_in_words(finding['location'])}",
        "sentence": finding.get("sentence") or "",
        "when": finding.get("when") or "",
        "parameters": parameters,
        "also": [f"{name_in_words(a['effect'])} at the {place_in_words(a['location'])}" for a in finding["also_fits"]],
    }


def _recalibrated(name: str, row: dict[str, Any], rig: Rig) -> dict[str, Any]:
    known = rig.config.parameters.get(name)
    nominal = row["nominal"]
    return {
        "name": name,
        "about": known.description if known else "",
        "nominal": interval(nominal, None, row["unit"], size=nominal),
        "value": interval(row["value"], row.get("ci95"), row["unit"], size=nominal),
        "change": f"{100 * (row['value'] / nominal - 1):+.3g} %" if nominal else "-",
        "tolerance": f"± {number(100 * known.tolerance)} %" if known else "-",
    }


def _fit(fit: dict[str, Any], best: str) -> dict[str, Any]:
    """Rows of errors: fitted and held out; columns: the models that there are."""
    metric = fit.get("metric", "")
    models = MODELS if best == "extended" else MODELS[:2]
    columns = [c for c in models if any(fit.get(part, {}).get(c) is not None for part in PARTS)]
    rows = [(words, [error_text(fit[part].get(c), metric) for c in columns]) for part, words in PARTS.items()]
    return {"metric": metric, "columns": columns, "rows": rows, "floor": error_text(fit.get("noise_floor"), metric)}


def _candidates(diagnosis: dict[str, Any]) -> list[dict[str, Any]]:
    chosen = {(f["location"], f.get("effect")) for f in diagnosis["findings"]}
    alike = {(a["location"], a["effect"]) for f in diagnosis["findings"] for a in f["also_fits"]}
    rows = []
    for candidate in diagnosis["candidates"]:
        key = (candidate["location"], candidate["effect"])
        rows.append({
            "location": place_in_words(candidate["location"]),
            "effect": name_in_words(candidate["effect"]),
            "score": candidate.get("score"),
            "held_out": "-" if (left := candidate.get("held_out")) is None else number(left),
            "verdict": candidate.get("verdict") or "",
            "mark": "chosen" if key in chosen else "alike" if key in alike else "",
        })  # fmt: skip
    # what matters stays above the fold, whatever its score
    return sorted(rows, key=lambda row: ("chosen", "alike", "").index(row["mark"]))
