"""The tables of a proof: one row per case, and one row per pair of hidden and named."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from dtbacklash.prove import rules
from dtbacklash.prove.rules import Case
from dtbacklash.prove.score import Score


def case_rows(cases: Sequence[Case]) -> pd.DataFrame:
    """One row per case, sorted by rig and seed."""
    order = list(dict.fromkeys(c.rig for c in cases))
    return pd.DataFrame(
        [_case_row(c) for c in sorted(cases, key=lambda c: (order.index(c.rig), int(c.secret["seed"]), c.id))]
    )


def _case_row(case: Case) -> dict[str, Any]:
    held = case.oracle.get("held_out", {})
    effects, nominal = rules.effect_intervals(case), rules.nominal_intervals(case)
    unknown = case.secret.get("unknown") or {}
    said = (*case.findings, *case.recalibrated.values())
    seen = [case.visibility(key) for key in case.hidden] or [case.unknown_visibility]
    return {
        "id": case.id, "rig": case.rig, "seed": case.secret["seed"], "kind": case.kind,
        "hidden": "; ".join(map(" ".join, case.hidden)),
        "unknown": f"{unknown['location']} {unknown['name']}" if unknown else "",
        "wrong_parameters": "; ".join(case.secret["parameters"]),
        "instruments": case.secret.get("instruments", ""), "controller": case.secret.get("controller", ""),
        "verdict": case.verdict, "named": "; ".join(map(" ".join, case.named)),
        "also_fits": "; ".join(sorted({" ".join(a) for row in said for a in rules.also(row)})),
        "located": ((case.diagnosis or {}).get("located") or {}).get("location", ""),
        "sure": "; ".join(" ".join(case.named[j]) for j in sorted(rules.sure(case))),
        "clear": rules.clear(case), "right": rules.right(case), "no_false_name": rules.no_false_name(case),
        "within_ambiguity": rules.within_ambiguity(case) if case.hidden else rules.right(case),
        "visibility_min": min(seen), "intervals": len(effects), "intervals_hold": sum(effects),
        "recalibrated": len(nominal), "recalibrated_hold": sum(nominal),
        **{f"held_out_{model}": held.get(model) for model in ("nominal", "recalibrated", "extended", "oracle")},
        **({"beside": len(case.secret["beside"]), "beside_visibility": case.secret["beside_visibility"],
            "explained": rules.explained(case, "extended"), "explained_oracle": rules.explained(case, "oracle")}
           if case.lifelike else {}),
        "wall_s": case.wall_s, "cpu_s": case.cpu_s, "error": case.error,
    }  # fmt: skip


def confusion_rows(score: Score) -> pd.DataFrame:
    """One row per pair of hidden and named."""
    return pd.DataFrame(
        [(c.hidden, c.named, c.count, c.within) for c in score.confusion],
        columns=["hidden", "named", "count", "within_stated_ambiguity"],
    )


def error_ratio(rows: pd.DataFrame) -> pd.Series:
    """(cases,) held-out error of the diagnosed rig over the oracle's; infinite where there is none."""
    return rows["held_out_extended"].astype(float) / rows["held_out_oracle"].astype(float)
