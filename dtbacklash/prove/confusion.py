"""The confusion matrix: pairs of what was hidden and what was named."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from dtbacklash.prove import rules
from dtbacklash.prove.rules import Case

#: what stands for a place without an effect in the confusion matrix
NOTHING, PARAMETERS, UNEXPLAINED, EXTRA, FAILED = "nothing", "parameters", "unknown", "one too many", "failed"
#: the right effect at another place of the right kind
ELSEWHERE = "same effect elsewhere"


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
