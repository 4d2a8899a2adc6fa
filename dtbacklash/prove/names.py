"""How good names are: of each confidence how many are right, by the part of the rig; and what was named for what."""

from __future__ import annotations

from collections import defaultdict
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
#: what stands for a place without an effect in the confusion matrix
NOTHING, PARAMETERS, UNEXPLAINED, EXTRA, FAILED = "nothing", "parameters", "unknown", "one too many", "failed"
#: the right effect at another place of the right kind
ELSEWHERE = "same effect elsewhere"


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
Side = rules.Key | str


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
    paired = rules.matches(case)
    pairs: list[tuple[Side, Side, bool]] = [(case.hidden[i], names[j], True) for i, j in paired.items()]
    missed = [key for i, key in enumerate(case.hidden) if i not in paired]
    more = [name for j, name in enumerate(names) if j not in paired.values()]
    pairs += [(hidden, name, False) for hidden, name in zip(missed, more, strict=False)]
    pairs += [(hidden, without, False) for hidden in missed[len(more) :]]
    return pairs + [(EXTRA, name, False) for name in more[len(missed) :]]
