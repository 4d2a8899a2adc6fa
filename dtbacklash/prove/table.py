"""The score as text: a Markdown table, and the CSV files with a row a case and a row a confusion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pandas as pd

from dtbacklash.docs import table
from dtbacklash.prove import rules
from dtbacklash.prove.rules import Case
from dtbacklash.prove.run import SCORING_FROM
from dtbacklash.prove.score import Figure, Quantity, Score
from dtbacklash.report.numbers import number


def bar_text(bar: tuple[float, float] | None) -> str:
    """A bar in words."""
    if bar is None:
        return ""
    low, high = bar
    return f"at least {100 * low:.0f} %" if high >= 1.0 else f"{100 * low:.0f} to {100 * high:.0f} %"


def met_text(met: bool | None, bar: object) -> str:
    """Pass or miss; a dash where there was nothing to judge, nothing where there is no bar."""
    if bar is None:
        return ""
    return "-" if met is None else "pass" if met else "**miss**"


def percent(share: float) -> str:
    """A share in percent."""
    return "-" if math.isnan(share) else f"{100 * share:.1f} %"


def figure_row(figure: Figure) -> list[str]:
    """A share's row: what, value, count, interval, bar, verdict, and the same over all cases."""
    low, high = figure.interval
    every = "" if figure.every_of is None else f"{figure.every_right}/{figure.every_of}"
    interval = f"{100 * low:.1f} to {100 * high:.1f} %" if figure.of else "-"
    return [figure.what, percent(figure.share), f"{figure.right}/{figure.of}", interval, bar_text(figure.bar),
            met_text(figure.met, figure.bar), every]  # fmt: skip


def quantity_row(q: Quantity) -> list[str]:
    """A distribution's row: what, median, 90 % quantile, unit, cases, bar, verdicts of both."""
    bar = "" if q.at_most is None else f"at most {number(q.at_most)}"
    met = " / ".join(met_text(q.met(v), q.at_most) for v in (q.median, q.ninety)) if q.at_most is not None else ""
    return [q.what, number(q.median), number(q.ninety), "" if q.unit == "1" else q.unit, str(q.of), bar, met]


def which_seeds(score: Score) -> str:
    """One sentence: which seeds were scored, and whether the tool may have been tuned on them."""
    if score.seeds is None:
        return "No recording."
    low, high = score.seeds
    if low >= SCORING_FROM:
        return (
            f"Scoring seeds {low} to {high}; the tool is tuned on development seeds only, those below {SCORING_FROM}."
        )
    there = "development seeds" if high < SCORING_FROM else f"development seeds below {SCORING_FROM}"
    return f"Seeds {low} to {high}, with {there}: the tool may have been tuned on them."


def markdown(score: Score) -> str:
    """The score as Markdown: what was counted, the shares with their bars, the errors and times."""
    kinds = ", ".join(
        f"{score.kinds[k]} {words}" + (f" ({score.clear[k]} clear)" if k in ("single", "several", "unknown") else "")
        for k, words in KIND_WORDS.items()
    )
    failed = f" Diagnoses that failed, and count as wrong: {score.failed or 'none'}."
    if score.oracle_failed:
        failed += f" Cases that are not clear because the oracle itself failed: {score.oracle_failed}."
    command = score.notes.get("command")
    return "\n".join([
        *([f"```sh\n{command}\n```\n"] if command else []),
        f"{score.cases} recordings: {kinds}. {which_seeds(score)}{failed}\n",
        table(("figure", "share", "count", "95 % interval", "bar", "", "over all sizes"),
              map(figure_row, score.figures)),
        table(("figure", "median", "90 % quantile", "unit", "cases", "bar", ""), map(quantity_row, score.quantities)),
    ])  # fmt: skip


KIND_WORDS = {
    "nothing": "hide nothing", "parameters": "only wrong parameters", "single": "one effect",
    "several": "two or three effects", "unknown": "physics that the catalogue lacks",
}  # fmt: skip


def case_rows(cases: Sequence[Case]) -> pd.DataFrame:
    """A row a case, in order of the seeds."""
    return pd.DataFrame([_case_row(c) for c in sorted(cases, key=lambda c: (int(c.secret["seed"]), c.id))])


def _case_row(case: Case) -> dict[str, Any]:
    held = case.oracle.get("held_out", {})
    effects, nominal = rules.effect_intervals(case), rules.nominal_intervals(case)
    unknown = case.secret.get("unknown") or {}
    seen = [case.visibility(key) for key in case.hidden] or [case.unknown_visibility]
    return {
        "id": case.id, "seed": case.secret["seed"], "kind": case.kind,
        "hidden": "; ".join(map(" ".join, case.hidden)),
        "unknown": f"{unknown['location']} {unknown['name']}" if unknown else "",
        "wrong_parameters": "; ".join(case.secret["parameters"]),
        "instruments": case.secret.get("instruments", ""), "controller": case.secret.get("controller", ""),
        "verdict": case.verdict, "named": "; ".join(map(" ".join, case.named)),
        "also_fits": "; ".join(sorted({" ".join(a) for f in case.findings for a in rules.also(f)})),
        "located": ((case.diagnosis or {}).get("located") or {}).get("location", ""),
        "clear": rules.clear(case), "right": rules.right(case),
        "within_ambiguity": rules.within_ambiguity(case) if case.hidden else rules.right(case),
        "visibility_min": min(seen), "intervals": len(effects), "intervals_hold": sum(effects),
        "recalibrated": len(nominal), "recalibrated_hold": sum(nominal),
        **{f"held_out_{model}": held.get(model) for model in ("nominal", "recalibrated", "extended", "oracle")},
        "wall_s": case.wall_s, "error": case.error,
    }  # fmt: skip


def confusion_rows(score: Score) -> pd.DataFrame:
    """A row a pair of hidden and named."""
    return pd.DataFrame(
        [(c.hidden, c.named, c.count, c.within) for c in score.confusion],
        columns=["hidden", "named", "count", "within_stated_ambiguity"],
    )
