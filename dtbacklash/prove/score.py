"""The score of a proof: each figure with numerator, denominator, 95 % interval and the bar that it has to meet."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from dtbacklash.config import commands
from dtbacklash.prove import rules
from dtbacklash.prove.name_scores import ELSEWHERE, FAMILIES, Cell, Reliability, confusion, family, reliability
from dtbacklash.prove.rules import Case
from dtbacklash.scoring.shares import Count

#: edges of the bins of visibility: half decades, in units of the sensors' noise
EDGES = tuple(float(f"{10 ** (k / 2):.3g}") for k in range(-2, 9))


@dataclass(frozen=True)
class Share(Count):
    """A share: ``right`` of ``of``, and the range ``bar`` that it should lie in.

    every_right, every_of : the same over all cases, where ``right`` and ``of`` count clear cases only.
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
    def met(self) -> bool | None:
        """Whether the share is within the bar; None without a bar or without a case.

        A share above the bar misses it only if its whole interval lies above it: 17 of 17 does not show that intervals
        are too wide.
        """
        if self.bar is None or not self.of:
            return None
        low, high = self.bar
        return low <= self.share and (self.share <= high or self.interval[0] <= high)


@dataclass(frozen=True)
class Quantity:
    """A distribution over ``of`` cases: median and 90 % quantile, each of which should be ``at_most`` the bar."""

    name: str
    what: str
    unit: str
    median: float
    ninety: float
    of: int
    at_most: float | None = None

    def met(self, value: float) -> bool | None:
        """Whether median or 90 % quantile is at most the bar; None without a bar or without a case."""
        return None if self.at_most is None or not self.of else value <= self.at_most


@dataclass(frozen=True)
class Bin:
    """Hidden effects of one family within a range of visibility.

    of : how many. exact, within : how many were named, exactly and within the stated ambiguity. intervals, hold :
    parameters of the exactly named ones with an interval, and how many of these hold the truth.
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
class Score:
    """The whole score; ``rigs`` : the figures of each rig alone, where there are several. ``lifelike`` : how many."""

    cases: int
    failed: int
    oracle_failed: int
    kinds: dict[str, int]
    clear: dict[str, int]
    seeds: tuple[int, int] | None
    figures: list[Share]
    quantities: list[Quantity]
    bins: list[Bin]
    confusion: list[Cell]
    notes: dict[str, Any] = field(default_factory=dict)
    rigs: dict[str, list[Share]] = field(default_factory=dict)
    lifelike: int = 0
    reliability: list[Reliability] = field(default_factory=list)

    def figure(self, name: str) -> Share:
        """A figure by its name."""
        return next(f for f in self.figures if f.name == name)

    @property
    def bars(self) -> tuple[int, int]:
        """How many bars are met, and how many are judged."""
        judged = [f.met for f in self.figures] + [q.met(v) for q in self.quantities for v in (q.median, q.ninety)]
        return sum(met is True for met in judged), sum(met is not None for met in judged)

    def bins_of(self, family: str | None = None) -> list[Bin]:
        """The bins of one family; without one, those of all effects of the catalogue together."""
        if family is not None:
            return [b for b in self.bins if b.family == family]
        found: dict[tuple[float, float], list[tuple[int, ...]]] = {}
        for b in self.bins:
            if b.family != UNKNOWN:
                found.setdefault((b.low, b.high), []).append((b.of, b.exact, b.within, b.intervals, b.hold))
        return [Bin("all", *edges, *map(sum, zip(*counts, strict=True))) for edges, counts in sorted(found.items())]

    def by_kind(self) -> dict[tuple[str, str], tuple[int, int]]:
        """(hidden, named) -> (count, of those within the stated ambiguity), all places of a kind together.

        The right effect at another place of the right kind is called ``ELSEWHERE``.
        """
        found: dict[tuple[str, str], tuple[int, int]] = {}
        for cell in self.confusion:
            elsewhere = cell.hidden_kind == cell.named_kind and cell.hidden != cell.named
            key = cell.hidden_kind, ELSEWHERE if elsewhere else cell.named_kind
            count, within = found.get(key, (0, 0))
            found[key] = count + cell.count, within + cell.within
        return found

    def to_json(self) -> dict[str, Any]:
        """Content of ``score.json``."""
        document = asdict(self)
        document["figures"] = _figure_rows(self.figures)
        document["rigs"] = {rig: _figure_rows(figures) for rig, figures in self.rigs.items()}
        for row, q in zip(document["quantities"], self.quantities, strict=True):
            row |= {"met": [q.met(q.median), q.met(q.ninety)]}
        return document

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Score:
        """The score of a ``score.json``."""
        quantities = []
        for row in document["quantities"]:
            values = {k: _number(row[k]) if row["of"] else math.nan for k in ("median", "ninety")}
            quantities.append(Quantity(**{k: v for k, v in row.items() if k != "met"} | values))
        return cls(**{
            **document, "figures": _figures(document["figures"]), "quantities": quantities,
            "rigs": {rig: _figures(rows) for rig, rows in document.get("rigs", {}).items()},
            "seeds": tuple(document["seeds"]) if document["seeds"] else None,
            "bins": [Bin(**{**b, "high": _number(b["high"])}) for b in document["bins"]],
            "confusion": [Cell(**c) for c in document["confusion"]],
            "reliability": [Reliability(**r) for r in document.get("reliability", [])],
        })  # fmt: skip


def _figure_rows(figures: list[Share]) -> list[dict[str, Any]]:
    return [asdict(f) | {"share": f.share, "ci95": list(f.interval), "met": f.met} for f in figures]


def _figures(rows: list[dict[str, Any]]) -> list[Share]:
    stored = [{k: v for k, v in row.items() if k not in ("share", "ci95", "met")} for row in rows]
    return [Share(**{**row, "bar": tuple(row["bar"]) if row["bar"] else None}) for row in stored]


def _number(value: float | None) -> float:
    return math.inf if value is None else float(value)


@dataclass(frozen=True)
class _Figure:
    """One figure: the kinds of case that it counts, its rule and bar, and which cases count (None: all of them)."""

    name: str
    what: str
    kinds: tuple[str, ...]
    rule: Callable[[Case], bool]
    bar: tuple[float, float] | None
    clear: Callable[[Case], bool] | None = rules.clear


#: the figures that count cases, with the bar of each
BY_CASE = (
    _Figure("strict", "exactly the hidden effects, at their places", ("single", "several"), rules.strict, (0.93, 1)),
    _Figure("strict_single", "the same where one effect is hidden", ("single",), rules.strict, None),
    _Figure("strict_several", "the same where two or three are hidden", ("several",), rules.strict, (0.88, 1)),
    _Figure("within_ambiguity", "each hidden effect named, or in the stated ambiguity; none too many",
              ("single", "several"), rules.within_ambiguity, (0.97, 1)),
    _Figure("said_with_certainty", "of the exactly right ones, said with certainty: missing, and sure or one of few",
              ("single", "several"), rules.said_with_certainty, (0.95, 1),
              lambda case: case.diagnosis is None or rules.strict(case)),
    _Figure("nothing_found", "nothing found where nothing is", ("nothing",), rules.no_physics, (0.95, 1), None),
    _Figure("called_consistent", "of these, called consistent", ("nothing",),
              lambda case: case.verdict == "consistent", None, None),
    _Figure("parameters_told", "wrong parameters not taken for physics", ("parameters",), rules.no_physics,
              (0.95, 1), None),
    _Figure("unknown_admitted", "unknown physics called unexplained, or located rightly", ("unknown",),
              rules.unknown_admitted, (0.80, 1)),
    _Figure("unknown_unnamed", "unknown physics whose true law clearly beats the catalogue's best, given no name",
              ("unknown",), rules.unknown_unnamed, (0.97, 1), rules.beaten),
    _Figure("no_false_name", "recordings of all kinds and sizes without a false name that is said with certainty",
              commands.KINDS, rules.no_false_name, None, None),
)  # fmt: skip
#: the same of lifelike recordings
LIFELIKE = (
    _Figure("main_named", "beside small things: each main effect named, or in the stated ambiguity",
              ("single", "several"), rules.main_named, (0.90, 1)),
    _Figure("main_sure", "of these, said with certainty (sure, or one of few)", ("single", "several"),
              rules.main_sure, (0.85, 1), rules.main_named),
    _Figure("nothing_sure", "small things only, or with wrong parameters: no false name said with certainty",
              ("nothing", "parameters"), rules.no_false_name, (0.98, 1), None),
    _Figure("lifelike_no_false_name", "lifelike recordings of all kinds without a false name said with certainty",
              commands.KINDS, rules.no_false_name, None, None),
)  # fmt: skip
#: sure names that are right
SURE_RIGHT = (0.98, 1.0)
#: 95 % intervals hold the truth this often, and so beside small things
COVERAGE, COVERAGE_LIFELIKE = (0.92, 0.98), (0.90, 0.98)
#: held-out error over the oracle's
RATIO_MAX = 1.1


def score(cases: Sequence[Case], notes: dict[str, Any] | None = None) -> Score:
    """Score the cases of a proof by the rules of :mod:`.rules`; ``notes`` are printed beside the table."""
    seeds = [int(c.secret["seed"]) for c in cases]
    rigs = list(dict.fromkeys(c.rig for c in cases))
    return Score(
        cases=len(cases),
        failed=sum(c.diagnosis is None for c in cases),
        oracle_failed=sum("held_out" not in c.oracle for c in cases),
        kinds={k: sum(c.kind == k for c in cases) for k in commands.KINDS},
        clear={k: sum(c.kind == k and rules.clear(c) for c in cases) for k in commands.KINDS},
        seeds=(min(seeds), max(seeds)) if seeds else None,
        figures=_all_figures(cases),
        quantities=_quantities(cases),
        bins=bins(cases),
        confusion=confusion(cases),
        notes=notes or {},
        rigs={rig: _all_figures([c for c in cases if c.rig == rig]) for rig in rigs} if len(rigs) > 1 else {},
        lifelike=sum(c.lifelike for c in cases),
        reliability=reliability(cases),
    )


def _all_figures(cases: Sequence[Case]) -> list[Share]:
    """The figures of clean recordings, and those of lifelike ones where there are some."""
    lifelike = [c for c in cases if c.lifelike]
    clean = [c for c in cases if not c.lifelike]
    found = [*(_by_case(d, clean) for d in BY_CASE), *_by_parameter(clean)] if clean or not lifelike else []
    return [*found, *(_by_case(d, lifelike) for d in LIFELIKE), *_by_name(lifelike)] if lifelike else found


def _by_name(cases: Sequence[Case]) -> list[Share]:
    """The figures that count names, or parameters, of lifelike recordings."""
    right = [j in rules.right_names(c) for c in cases for j in rules.sure(c)]
    held = [held for c in cases for held in rules.effect_intervals(c)]
    return [
        _share("sure_right", "sure names that are right: a main effect, or a small thing of the catalogue", right,
               SURE_RIGHT),
        _share("lifelike_coverage", "beside small things: 95 % intervals of main effects that hold the truth", held,
               COVERAGE_LIFELIKE),
    ]  # fmt: skip


def _share(name: str, what: str, right: Sequence[bool], bar: tuple[float, float] | None = None) -> Share:
    return Share(name, what, sum(right), len(right), bar)


def _by_case(declared: _Figure, cases: Sequence[Case]) -> Share:
    every = [c for c in cases if c.kind in declared.kinds]
    counted = [c for c in every if declared.clear is None or declared.clear(c)]
    right, every_right = (sum(map(declared.rule, chosen)) for chosen in (counted, every))
    both = () if declared.clear is None else (every_right, len(every))
    return Share(declared.name, declared.what, right, len(counted), declared.bar, *both)


def _by_parameter(cases: Sequence[Case]) -> list[Share]:
    """The figures that count parameters."""
    moved = [right for c in cases for right in rules.right_parameters(c)]
    effects = [held for c in cases for held in rules.effect_intervals(c)]
    nominal = [held for c in cases for held in rules.nominal_intervals(c)]
    return [
        _share("right_parameter", "a clear wrong parameter recalibrated, its interval holding the truth", moved),
        _share("coverage_effects", "95 % intervals of rightly named effects that hold the truth", effects, COVERAGE),
        _share("coverage_parameters", "95 % intervals of recalibrated parameters that hold the truth", nominal,
               COVERAGE),
    ]  # fmt: skip


def _quantities(cases: Sequence[Case]) -> list[Quantity]:
    hidden = [c for c in cases if c.kind in ("single", "several")]
    judged = [c for c in hidden if rules.clear(c) and not c.lifelike]
    beside = [c for c in hidden if c.lifelike and "held_out" in c.oracle]
    times = [c.cpu_s for c in cases if c.cpu_s is not None]
    found = [_quantity("ratio", "held-out error, diagnosed over oracle's", "1",
                       [rules.error_ratio(c) for c in judged], RATIO_MAX)]  # fmt: skip
    words = {"nominal": "of the nominal rig", "recalibrated": "of the recalibrated rig",
             "extended": "of the diagnosed rig", "oracle": "of the oracle's rig"}  # fmt: skip
    for model, which in words.items():
        losses = [_number(c.oracle["held_out"].get(model)) for c in judged if "held_out" in c.oracle]
        found.append(_quantity(f"loss_{model}", f"held-out error {which}", "noise floors", losses))
    rivals = [float(len(rules.also(f))) for c in judged for f in c.findings]
    found.append(_quantity("rivals", "alternatives in a finding's stated ambiguity", "1", rivals))
    for model, whose in {"extended": "the diagnosed rig", "oracle": "an oracle of the main effect"}.items():
        left = [1.0 - rules.explained(c, model) for c in beside]
        what = f"beside small things: held-out mean square of {whose} over that of the recalibrated one"
        found += [_quantity(f"left_{model}", what, "1", left)] if beside else []
    return [*found, _quantity("time", "processor time of a diagnosis", "s", [float(t) for t in times])]


def _quantity(name: str, what: str, unit: str, values: list[float], at_most: float | None = None) -> Quantity:
    if not values:
        return Quantity(name, what, unit, math.nan, math.nan, 0, at_most)
    # no interpolation, as values may be infinite
    median, ninety = np.quantile(values, (0.5, 0.9), method="higher")
    return Quantity(name, what, unit, float(median), float(ninety), len(values), at_most)


UNKNOWN = "unknown"


def bins(cases: Sequence[Case]) -> list[Bin]:
    """Per family and range of visibility, how many hidden effects were named; empty ranges are left out."""
    seen: list[tuple[str, float, bool, bool, list[bool]]] = []
    for case in cases:
        exact, paired = case.matching.exact, case.matching.pairs
        for i, key in enumerate(case.hidden):
            part = family(case.kind_of(key[0]))
            seen.append((part, case.visibility(key), i in exact, i in paired, rules.intervals_of(case, i)))
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
