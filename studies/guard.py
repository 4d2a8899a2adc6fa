"""The campaign of the guarded twin as a table: how often each twin makes the loop worse."""

from __future__ import annotations

import pandas as pd

from studies.campaign import HARM_SCATTER, HARM_SHARE, harmful
from studies.measure import Row, verdict


def guard_rows(table: pd.DataFrame) -> list[Row]:
    """One row for the loop with the old estimate, the plain twin, the guarded twin, and the exact gap.

    ``worse``: cases beyond the tolerance; ``worse_by_1_pct``: cases whose distance to the exact loop grew by more than
    1 % of the moves, whatever the scatter; ``worst_harm_pct``: the largest such growth; ``rms_um``: the median
    distance to the exact loop; ``beyond_180_deg``: estimates that no gear can have; ``diverged``: |q3| above 1 m.
    """
    rows: list[Row] = []
    names = {"old": "old estimate kept", "plain": "plain BFGS", "guarded": "guarded twin", "exact": "exact gap"}
    for way, name in names.items():
        overshoot, distance = table[f"overshoot_{way}_pct"], table[f"rms_{way}_um"]
        row: Row = {
            "what": name, "cases": len(table), "worse": None, "worse_by_1_pct": None, "worst_harm_pct": None,
            "rms_median_um": distance.median(), "rms_p99_um": distance.quantile(0.99),
            "overshoot_above_20_pct": int((overshoot > 20.0).sum()), "worst_overshoot_pct": overshoot.max(),
            "beyond_180_deg": int((table[f"{way}_deg"] > 180.0).sum()) if way != "exact" else 0,
        }  # fmt: skip
        if way in ("plain", "guarded"):
            harm = table[f"harm_{way}"]
            row |= {
                "worse": int(harmful(table, way).sum()), "worse_by_1_pct": int((~(harm <= 0.01)).sum()),
                "worst_harm_pct": 100.0 * harm.max(),
            }  # fmt: skip
        if way == "guarded":
            row["pass"] = verdict(row["worse"], 0)
        rows.append(row)
    return rows


def guard_words(table: pd.DataFrame, seed: int) -> list[str]:
    """Sentences below the table."""
    informative = table[table["informative"]]
    lucky = int((table["tracking_exact_um"] > 1.02 * table["tracking_old_um"]).sum())
    reasons = table["reason"][~table["accepted"]].str.replace(r"[\d.]+", "#", regex=True).str.split(":").str[0]
    counted = "; ".join(f"{count} x {reason}" for reason, count in reasons.value_counts().items())
    return [
        f"seed {seed}; worse: farther from the loop with the exact gap than the old estimate by more than "
        f"{100 * HARM_SHARE:g} % of the moves and {HARM_SCATTER:g} times what other noise does to the exact loop.",
        f"accepted: {table['accepted'].mean():.1%} of all buffers, {informative['accepted'].mean():.1%} of the "
        f"{len(informative)} in which the screw moved 20 deg; {table['attempts'].mean():.2f} attempts a buffer.",
        f"rejected: {counted or 'none'}.",
        f"in {lucky} cases the old, wrong estimate tracks the reference better (2 %) than even the exact gap.",
    ]
