"""``dtb diagnose`` itself: its findings, alternatives, recalibrated parameters, and the prediction of its rig."""

from __future__ import annotations

from typing import Any

import numpy as np

import dtbacklash as dtb
from dtbacklash.diagnosis.result import Diagnosis
from dtbacklash.physics.catalogue import find
from dtbacklash.recording.model import Recording
from studies.baselines.case import Case, Found, simulated

#: confidence -> how often such a name was right in the scores of seed 83000 (docs/proof/score.json,
#: docs/proof_lifelike/score.json: 78 of 81, 11 of 12, 21 of 39); alternatives share the rest
CERTAINTY = {"sure": 0.96, "one_of": 0.92, "partial": 0.54}
#: the same of a place without a law (7 of 10), and of a parameter that had to move (8 of 11)
LOCATED, MOVED = 0.7, 0.73


def answer(case: Case) -> Found:
    """Diagnose the recording; of a pair, what changed."""
    recordings = [Recording.from_frame(table, rig=case.rig, units={n: s.unit for n, s in case.rig.sensors.items()
                                                                   if n in table}, trust_units=True)
                  for table in (t.drop(columns="r") for t in case.recordings)]  # fmt: skip
    changes = len(recordings) > 1
    compare: Any = "change" if changes else None
    found = dtb.diagnose(recordings if changes else recordings[0], case.rig, compare=compare).diagnosis
    rows = _changes(found, case) if changes else _findings(found, case)
    return Found(rows, simulated(found.extended, case.test, case.step_s))


def _findings(found: Diagnosis, case: Case) -> list[dict[str, Any]]:
    said = found.to_json()
    rows = []
    for finding in said["findings"]:
        place, effect = finding["location"], finding.get("effect")
        if not effect:
            continue
        certainty = CERTAINTY[finding["confidence"]]
        others = finding["also_fits"] if finding["confidence"] != "sure" else []
        if effect.endswith("_table"):
            rows.append({"place": place, "effect": "unlisted", "certainty": certainty})
            continue
        size = finding["parameters"].get(find(case.rig.kind_at(place), effect, place).size.name, {})
        low, high = size.get("ci95", (None, None))
        rows.append({"place": place, "effect": effect, "size": size.get("value"), "unit": size.get("unit"),
                     "low": low, "high": high, "certainty": certainty})  # fmt: skip
        rows += [{"place": o["location"], "effect": o["effect"], "certainty": (1.0 - certainty) / len(others)}
                 for o in others if o.get("effect") and not o["effect"].endswith("_table")]  # fmt: skip
    located = (said.get("located") or {}).get("location")
    if said["verdict"] == "unexplained" and located and not any(r["place"] == located for r in rows):
        rows.append({"place": located, "effect": "unlisted", "certainty": LOCATED})
    parameters = case.rig.config.parameters
    for name, one in said["recalibrated"].items():
        if name in parameters:
            (low, high), unit = one["ci95"], parameters[name].unit
            rows.append({"place": name, "effect": "wrong_parameter", "size": one["value"], "unit": unit,
                         "low": low, "high": high, "certainty": MOVED})  # fmt: skip
    return _once(rows)


def _changes(found: Diagnosis, case: Case) -> list[dict[str, Any]]:
    rows = []
    for change in found.changes or ():
        place, *rest = change.title.split(".")
        row: dict[str, Any] = {"place": place, "effect": rest[0] if rest else "wrong_parameter",
                               "certainty": CERTAINTY.get(change.confidence, 0.5)}  # fmt: skip
        if not rest or rest[1:] == [find(case.rig.kind_at(place), rest[0], place).size.name]:
            low, high = change.after.ci95
            row |= {"size": change.after.value, "unit": change.after.unit, "low": low, "high": high}
        rows.append(row)
    return _once(rows)


def _once(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each name once, the more certain one."""
    best: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        key = row["place"], row["effect"]
        if key not in best or row["certainty"] > best[key]["certainty"]:
            best[key] = {k: (None if isinstance(v, float) and not np.isfinite(v) else v) for k, v in row.items()}
    return list(best.values())
