"""One claim of the paper as a row: what it says, what we find, and a tolerance that could fail.

A tolerance is what the paper's own words allow: a figure given with two digits is met if ours rounds to it, "below"
and "almost" are taken at their word, and a comparison is made with the run that the paper compares with.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Claim:
    """One statement: ``reason`` says why the tolerance is what it is and, where it fails, why it fails."""

    claim: str
    section: str
    paper: str
    ours: float
    unit: str
    tolerance: str
    passed: bool
    reason: str

    def row(self) -> dict[str, object]:
        """The row of claims.csv."""
        ours = f"{self.ours:.4g} {self.unit}".strip()
        return {
            "claim": self.claim,
            "section": self.section,
            "paper": self.paper,
            "ours": ours,
            "tolerance": self.tolerance,
            "pass": bool(self.passed),
            "reason": self.reason,
        }


def between(
    claim: str, section: str, paper: str, ours: float, unit: str, low: float, high: float, why: str, failing: str = ""
) -> Claim:
    bounds = (f"{low:.4g} to {high:.4g} {unit}" if low < high else f"exactly {low:.4g} {unit}").strip()
    if low == -math.inf:
        bounds = f"at most {high:.4g} {unit}".strip()
    elif high == math.inf:
        bounds = f"at least {low:.4g} {unit}".strip()
    passed = bool(low <= ours <= high)
    reason = why if passed or not failing else f"{why}. It fails because {failing}"
    return Claim(claim, section, paper, float(ours), unit, bounds, passed, reason)
