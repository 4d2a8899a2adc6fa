"""The score of a proof: every figure with numerator, denominator, 95 % interval and the bar that it is held against."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from scipy.stats import binomtest

from dtbacklash.prove import rules
from dtbacklash.prove.rules import Case

#: edges of the bins of visibility: half decades, in units of the sensors' noise
EDGES = tuple(float(f"{10 ** (k / 2):.3g}") for k in range(-2, 9))


@dataclass(frozen=True)
class Figure:
    """A share: ``right`` of ``of``, with Wilson's interval, and whether it meets its bar.

    ``every_right`` of ``every_of`` : the same over all cases, clear or not, where that differs.
    """

    name: str
    what: str
    right: int
    of: int
    bar: tuple[float, float] | None
    every_right: int | None = None
    every_of: int | None = None

    @property
    def share(self) -> float:
        """The share, or NaN of nothing."""
        return self.right / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share."""
        return wilson(self.right, self.of)

    @property
    def met(self) -> bool | None:
        """Whether the share is within the bar; None without a bar or without a case."""
        if self.bar is None or not self.of:
            return None
        return self.bar[0] <= self.share <= self.bar[1]


@dataclass(frozen=True)
class Quantity:
    """A distribution over cases: median, 90 % quantile and how many, with a bar on each."""

    name: str
    what: str
    unit: str
    median: float
    ninety: float
    of: int
    at_most: float | None = None

    def met(self, value: float) -> bool | None:
        """Whether one of its two figures is below the bar; None without a bar or without a case."""
        if self.at_most is None or not self.of:
            return None
        return value <= self.at_most


@dataclass(frozen=True)
class Bin:
    """Hidden effects of one family within a range of visibility.

    ``of`` : how many; ``exact``, ``within`` : how many of them were named, exactly and within the stated ambiguity;
    ``intervals``, ``hold`` : of the exactly named ones, parameters with an interval, and how many hold the truth.
    """

    family: str
    low: float
    high: float
    of: int
    exact: int
    within: int
    intervals: int
    hold: int


@dataclass(frozen=True)
class Cell:
    """How often ``hidden`` was called ``named``.

    ``within`` : how often of that it stood in the finding's stated ambiguity; for unknown physics, was located rightly.
    """

    hidden: str
    named: str
    count: int
    within: int


@dataclass(frozen=True)
class Score:
    """Everything that is said about a proof."""

    cases: int
    failed: int
    oracle_failed: int
    kinds: dict[str, int]
    clear: dict[str, int]
    seeds: tuple[int, int] | None
    figures: list[Figure]
    quantities: list[Quantity]
    bins: list[Bin]
    confusion: list[Cell]
    notes: dict[str, Any] = field(default_factory=dict)

    def figure(self, name: str) -> Figure:
        """A figure by its name."""
        return next(f for f in self.figures if f.name == name)

    def to_json(self) -> dict[str, Any]:
        """Content of ``score.json``."""
        document = asdict(self)
        for row, figure in zip(document["figures"], self.figures, strict=True):
            row |= {"share": figure.share, "ci95": list(figure.interval), "met": figure.met}
        for row, q in zip(document["quantities"], self.quantities, strict=True):
            row |= {"met": [q.met(q.median), q.met(q.ninety)]}
        return document

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Score:
        """The score of a ``score.json``."""
        derived = ("share", "ci95", "met")
        figures = [Figure(**{k: v for k, v in f.items() if k not in derived}) for f in document["figures"]]
        figures = [Figure(**{**asdict(f), "bar": tuple(f.bar) if f.bar else None}) for f in figures]
        quantities = [
            Quantity(
                **{
                    **{k: v for k, v in q.items() if k != "met"},
                    "median": _number(q["median"]),
                    "ninety": _number(q["ninety"]),
                }
            )
            for q in document["quantities"]
        ]
        return cls(**{
            **document, "figures": figures, "quantities": quantities,
            "seeds": tuple(document["seeds"]) if document["seeds"] else None,
            "bins": [Bin(**{**b, "high": _number(b["high"])}) for b in document["bins"]],
            "confusion": [Cell(**c) for c in document["confusion"]],
        })  # fmt: skip


def _number(value: float | None) -> float:
    return math.inf if value is None else float(value)


def wilson(right: int, of: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share; 0 to 1 of nothing."""
    if not of:
        return 0.0, 1.0
    interval = binomtest(right, of).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class _Declared:
    """One figure: which kinds of case it counts, by which rule, and its bar."""

    name: str
    what: str
    kinds: tuple[str, ...]
    rule: Callable[[Case], bool]
    bar: tuple[float, float] | None
    by_clarity: bool = True


#: the figures that count cases, with the bar of each
BY_CASE = (
    _Declared("strict", "exactly the hidden effects, at their places", ("single", "several"), rules.strict, (0.90, 1)),
    _Declared("strict_single", "the same where one effect is hidden", ("single",), rules.strict, None),
    _Declared("strict_several", "the same where two or three are hidden", ("several",), rules.strict, None),
    _Declared("within_ambiguity", "each hidden effect named, or in the stated ambiguity; none too many",
              ("single", "several"), rules.within_ambiguity, (0.97, 1)),
    _Declared("nothing_found", "nothing found where nothing is", ("nothing",), rules.no_physics, (0.95, 1), False),
    _Declared("called_consistent", "of these, called consistent", ("nothing",), rules.called_consistent,
              None, False),
    _Declared("parameters_told", "wrong parameters not taken for physics", ("parameters",), rules.no_physics,
              (0.90, 1), False),
    _Declared("unknown_admitted", "unknown physics called unexplained, or located rightly", ("unknown",),
              rules.unknown_admitted, (0.80, 1)),
)  # fmt: skip
#: 95 % intervals hold the truth this often
COVERAGE = (0.90, 0.99)
#: held-out error over the oracle's
RATIO_MAX = 1.2


def score(cases: Sequence[Case], notes: dict[str, Any] | None = None) -> Score:
    """Score the cases of a proof by the rules of :mod:`.rules`; ``notes`` is what the table says beside it."""
    seeds = [int(c.secret["seed"]) for c in cases]
    return Score(
        cases=len(cases),
        failed=sum(c.diagnosis is None for c in cases),
        oracle_failed=sum("held_out" not in c.oracle for c in cases),
        kinds={k: sum(c.kind == k for c in cases) for k in rules.KINDS},
        clear={k: sum(c.kind == k and rules.clear(c) for c in cases) for k in rules.KINDS},
        seeds=(min(seeds), max(seeds)) if seeds else None,
        figures=[*(_by_case(d, cases) for d in BY_CASE), *_by_parameter(cases)],
        quantities=_quantities(cases),
        bins=bins(cases),
        confusion=confusion(cases),
        notes=notes or {},
    )


def _by_case(declared: _Declared, cases: Sequence[Case]) -> Figure:
    every = [c for c in cases if c.kind in declared.kinds]
    counted = [c for c in every if rules.clear(c)] if declared.by_clarity else every
    right, every_right = (sum(map(declared.rule, chosen)) for chosen in (counted, every))
    if not declared.by_clarity:
        return Figure(declared.name, declared.what, right, len(counted), declared.bar)
    return Figure(declared.name, declared.what, right, len(counted), declared.bar, every_right, len(every))


def _by_parameter(cases: Sequence[Case]) -> list[Figure]:
    """The figures that count parameters."""
    clear = sum(len(rules.clear_parameters(c)) for c in cases)
    moved = sum(rules.right_parameters(c) for c in cases)
    effects = [held for c in cases for held in rules.effect_intervals(c)]
    nominal = [held for c in cases for held in rules.nominal_intervals(c)]
    return [
        Figure("right_parameter", "a clear wrong parameter recalibrated, its interval holding the truth", moved, clear,
               None),
        Figure("coverage_effects", "95 % intervals of rightly named effects that hold the truth", sum(effects),
               len(effects), COVERAGE),
        Figure("coverage_parameters", "95 % intervals of recalibrated parameters that hold the truth", sum(nominal),
               len(nominal), COVERAGE),
    ]  # fmt: skip


def _quantities(cases: Sequence[Case]) -> list[Quantity]:
    judged = [c for c in cases if c.kind in ("single", "several") and rules.clear(c)]
    times = [c.wall_s for c in cases if c.wall_s is not None]
    found = [_quantity("ratio", "held-out error, diagnosed over oracle's", "1",
                       [rules.error_ratio(c) for c in judged], RATIO_MAX)]  # fmt: skip
    words = {"nominal": "of the nominal rig", "recalibrated": "of the recalibrated rig",
             "extended": "of the diagnosed rig", "oracle": "of the oracle's rig"}  # fmt: skip
    for model, which in words.items():
        losses = [_number(c.oracle["held_out"].get(model)) for c in judged if "held_out" in c.oracle]
        found.append(_quantity(f"loss_{model}", f"held-out error {which}", "noise floors", losses))
    rivals = [float(len(rules.also(f))) for c in judged for f in c.findings]
    found.append(_quantity("rivals", "alternatives in a finding's stated ambiguity", "1", rivals))
    return [*found, _quantity("time", "time of a diagnosis", "s", [float(t) for t in times])]


def _quantity(name: str, what: str, unit: str, values: list[float], at_most: float | None = None) -> Quantity:
    if not values:
        return Quantity(name, what, unit, math.nan, math.nan, 0, at_most)
    # by rank: between a finite and an infinite value nothing can be interpolated
    median, ninety = np.quantile(values, (0.5, 0.9), method="higher")
    return Quantity(name, what, unit, float(median), float(ninety), len(values), at_most)


FAMILIES = {
    "drive": ("amplifier", "motor_circuit", "motor_bearing", "actuator"),
    "transmission": ("gear", "screw"),
    "structure": ("link", "mass", "carriage"),
    "sensors": ("sensor",),
}
UNKNOWN = "unknown"


def family(location: str) -> str:
    """The part of the rig that a location belongs to."""
    for name, starts in FAMILIES.items():
        if location.startswith(starts):
            return name
    return "structure"


def bins(cases: Sequence[Case]) -> list[Bin]:
    """Per family and range of visibility, how many hidden effects were found; empty ranges are left out."""
    seen: list[tuple[str, float, bool, bool, list[bool]]] = []
    for case in cases:
        there, paired = rules.exact(case), rules.matches(case)
        for i, key in enumerate(case.hidden):
            seen.append((family(key[0]), case.visibility(key), i in there, i in paired, rules.intervals_of(case, i)))
        if case.kind == "unknown":
            admitted = rules.unknown_admitted(case)
            seen.append((UNKNOWN, case.unknown_visibility, admitted, admitted, []))
    edges = (0.0, *EDGES, math.inf)
    found = []
    for name in [*FAMILIES, UNKNOWN]:
        for low, high in itertools.pairwise(edges):
            inside = [s for s in seen if s[0] == name and low <= s[1] < high]
            if inside:
                held = [h for s in inside for h in s[4]]
                counts = sum(s[2] for s in inside), sum(s[3] for s in inside), len(held), sum(held)
                found.append(Bin(name, low, high, len(inside), *counts))
    return found


#: what stands for a place without an effect in the confusion matrix
NOTHING, PARAMETERS, UNEXPLAINED, EXTRA, FAILED = "nothing", "parameters", "unknown", "one too many", "failed"


def confusion(cases: Sequence[Case]) -> list[Cell]:
    """What was hidden against what was named, over all cases, with ``location effect`` or a word for neither."""
    counts: dict[tuple[str, str], list[int]] = {}
    for case in cases:
        for hidden, named, within in _pairs(case):
            cell = counts.setdefault((hidden, named), [0, 0])
            cell[0] += 1
            cell[1] += within
    return [Cell(hidden, named, *cell) for (hidden, named), cell in sorted(counts.items())]


def _pairs(case: Case) -> list[tuple[str, str, bool]]:
    """(hidden, named, whether within the stated ambiguity) of one case; each thing stands in one pair."""
    silent = {"consistent": NOTHING, "parameters": PARAMETERS, "unexplained": UNEXPLAINED, "failed": FAILED}
    without = silent.get(case.verdict, NOTHING)
    names = [" ".join(key) for key in case.named]
    if not case.hidden:
        hidden = {"nothing": NOTHING, "parameters": PARAMETERS}.get(case.kind, UNEXPLAINED)
        if not names:
            return [(hidden, without, case.kind == "unknown" and rules.unknown_admitted(case))]
        place = (case.secret.get("unknown") or {}).get("location")
        return [(hidden, name, key[0] == place) for name, key in zip(names, case.named, strict=True)]
    paired = rules.matches(case)
    pairs = [(" ".join(case.hidden[i]), names[j], True) for i, j in paired.items()]
    missed = [" ".join(key) for i, key in enumerate(case.hidden) if i not in paired]
    more = [name for j, name in enumerate(names) if j not in paired.values()]
    pairs += [(hidden, name, False) for hidden, name in zip(missed, more, strict=False)]
    pairs += [(hidden, without, False) for hidden in missed[len(more) :]]
    return pairs + [(EXTRA, name, False) for name in more[len(missed) :]]
