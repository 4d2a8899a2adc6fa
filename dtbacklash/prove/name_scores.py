"""How good names are: of each confidence how many are right, by the part of the rig; what was named for what."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from dtbacklash.physics.element_kinds import KINDS, PARTS
from dtbacklash.prove import rules
from dtbacklash.prove.rules import Case
from dtbacklash.scoring.shares import Count
from dtbacklash.scoring.truth import Key

SENSORS, ALL = "sensors", "all"
#: the parts of a rig by which the score sorts what was hidden, and what was named
FAMILIES = (*PARTS, SENSORS)
CONFIDENCES = ("sure", "one_of", "partial")
#: what stands for a place without an effect in the confusion matrix
NOTHING, PARAMETERS, UNEXPLAINED, EXTRA, FAILED = "nothing", "parameters", "unknown", "one too many", "failed"
#: the right effect at another place of the right kind
ELSEWHERE = "same effect elsewhere"


def family(kind: str) -> str:
    """The part of the rig that a kind of place belongs to."""
    return SENSORS if kind == rules.SENSOR else KINDS[kind].part


@dataclass(frozen=True)
class Reliability(Count):
    """How many of the names of one confidence, in one part of the rig or in ``all``, are right."""

    confidence: str
    family: str
    right: int
    of: int


def reliability(cases: Sequence[Case]) -> list[Reliability]:
    """Per confidence and part of the rig, how many names are right; parts without a name are left out."""
    names = [
        (f.get("confidence"), family(case.kind_of(f["location"])), j in rules.right_names(case))
        for case in cases for j, f in enumerate(case.findings)
    ]  # fmt: skip
    found = []
    for confidence in CONFIDENCES:
        for part in (ALL, *FAMILIES):
            right = [r for c, p, r in names if c == confidence and part in (ALL, p)]
            if right:
                found.append(Reliability(confidence, part, sum(right), len(right)))
    return found


@dataclass(frozen=True)
class Cell:
    """How often ``hidden`` was called ``named``.

    within : how often it was in the finding's stated ambiguity; for unknown physics, located rightly.
    hidden_kind, named_kind : the same with the kind of the place instead of its name.
    """

    hidden: str
    named: str
    count: int
    within: int
    hidden_kind: str
    named_kind: str


def confusion(cases: Sequence[Case]) -> list[Cell]:
    """All pairs of all cases, sorted: ``location effect``, or a word where there is no effect."""
    within: dict[tuple[str, str, str, str], list[bool]] = defaultdict(list)
    for case in cases:
        for hidden, named, agrees in _pairs(case):
            key = (_text(hidden), _text(named), _of_kind(case, hidden), _of_kind(case, named))
            within[key].append(agrees)
    return [Cell(key[0], key[1], len(each), sum(each), key[2], key[3]) for key, each in sorted(within.items())]


#: one side of a pair: (location, effect), or a word where there is neither
Side = Key | str


def _text(side: Side) -> str:
    return side if isinstance(side, str) else " ".join(side)


def _of_kind(case: Case, side: Side) -> str:
    return side if isinstance(side, str) else f"{case.kind_of(side[0])} {side[1]}"


def _pairs(case: Case) -> list[tuple[Side, Side, bool]]:
    """(hidden, named, whether within the stated ambiguity) of one case; each effect stands in one pair."""
    silent = {"consistent": NOTHING, "parameters": PARAMETERS, "unexplained": UNEXPLAINED, "failed": FAILED}
    without = silent.get(case.verdict, NOTHING)
    names = case.named
    if not case.hidden:
        hidden = {"nothing": NOTHING, "parameters": PARAMETERS}.get(case.kind, UNEXPLAINED)
        if not names:
            return [(hidden, without, case.kind == "unknown" and rules.unknown_admitted(case))]
        place = (case.secret.get("unknown") or {}).get("location")
        return [(hidden, name, name[0] == place) for name in names]
    paired = case.matching.pairs
    pairs: list[tuple[Side, Side, bool]] = [(case.hidden[i], names[j], True) for i, j in paired.items()]
    missed = [key for i, key in enumerate(case.hidden) if i not in paired]
    more = [name for j, name in enumerate(names) if j not in paired.values()]
    pairs += [(hidden, name, False) for hidden, name in zip(missed, more, strict=False)]
    pairs += [(hidden, without, False) for hidden in missed[len(more) :]]
    return pairs + [(EXTRA, name, False) for name in more[len(missed) :]]


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


def confusion_rows(cells: Sequence[Cell]) -> pd.DataFrame:
    """One row per pair of hidden and named."""
    return pd.DataFrame(
        [(c.hidden, c.named, c.count, c.within) for c in cells],
        columns=["hidden", "named", "count", "within_stated_ambiguity"],
    )


def error_ratio(rows: pd.DataFrame) -> pd.Series:
    """(cases,) held-out error of the diagnosed rig over the oracle's; infinite where there is none."""
    return rows["held_out_extended"].astype(float) / rows["held_out_oracle"].astype(float)
