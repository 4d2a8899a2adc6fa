"""How reliable names are: of each confidence, how many are right, by the part of the rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scipy.stats import binomtest

from dtbacklash.physics.kinds import KINDS, PARTS
from dtbacklash.prove import rules
from dtbacklash.prove.rules import Case

SENSORS, ALL = "sensors", "all"
#: the parts of a rig by which the score sorts what was hidden, and what was named
FAMILIES = (*PARTS, SENSORS)
CONFIDENCES = ("sure", "partial")


def wilson(right: int, of: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share; 0 to 1 of nothing."""
    if not of:
        return 0.0, 1.0
    interval = binomtest(right, of).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def family(kind: str) -> str:
    """The part of the rig that a kind of place belongs to."""
    return SENSORS if kind == rules.SENSOR else KINDS[kind].part


@dataclass(frozen=True)
class Reliability:
    """How many of the names of one confidence, in one part of the rig or in ``all``, are right."""

    confidence: str
    family: str
    right: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share."""
        return wilson(self.right, self.of)


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
