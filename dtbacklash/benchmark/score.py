"""The score of a tool's answers: every figure with its count and 95 % interval.

A name counts as said if its certainty is at least ``SAID``. All names, also less certain ones, count for the
reliability of certainty. Nothing here knows how an answer came about; standard library and numpy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.benchmark.answers import Answers, Row
from dtbacklash.benchmark.truth import Hidden, Truth
from dtbacklash.scoring.shares import Counted, holds, median_interval, wilson

#: a name with less certainty is an alternative
SAID = 0.5
#: relative error of a size that is right
NEAR = 0.1
#: ranges of certainty whose names are counted together
BINS = 5
#: an error of a prediction beyond so many of the oracle's is one that has run away
RUNAWAY = 1e6


@dataclass(frozen=True)
class Figure:
    """One figure of the score.

    name, what : its short name, and what it counts. group : all, or a split, a kind of case, or a machine.
    value : a share, or a median. of : how many were counted. low, high : 95 % interval.
    right : of a share, how many were right.
    """

    name: str
    what: str
    group: str
    value: float
    of: int
    low: float
    high: float
    right: int | None = None


@dataclass(frozen=True)
class Bin(Counted):
    """Names of similar certainty: its mean, how many there are, and how many are right."""

    certainty: float
    right: int
    of: int


@dataclass(frozen=True)
class Score:
    """figures : those of all cases first. bins : of the reliability of certainty. problems : lines of wrong rows."""

    tool: str
    cases: int
    figures: list[Figure] = field(default_factory=list)
    bins: list[Bin] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def figure(self, name: str, group: str = "all") -> Figure:
        """A figure by its name."""
        return next(one for one in self.figures if (one.name, one.group) == (name, group))


@dataclass(frozen=True)
class Judged:
    """One case with what a tool said of it. ratio : see :func:`error_ratio`."""

    truth: Truth
    rows: Sequence[Row]
    ratio: float | None = None

    @property
    def said(self) -> list[Row]:
        """The names that count as said."""
        return [row for row in self.rows if row.certainty >= SAID]

    def named(self) -> Iterator[tuple[Hidden, Row | None]]:
        """What is hidden, each with the row that names it."""
        for hidden in self.truth.hidden:
            key = hidden.place, hidden.effect
            yield hidden, next((row for row in self.said if (row.place, row.effect) == key), None)

    def placed(self) -> list[bool]:
        """Of each thing that is hidden, whether a name stands at its place."""
        places = {row.place for row in self.said}
        return [hidden.place in places for hidden in self.truth.hidden]

    def is_right(self, row: Row) -> bool:
        """Whether a name is hidden."""
        return (row.place, row.effect) in [(one.place, one.effect) for one in self.truth.hidden]

    def is_false(self, row: Row) -> bool:
        """Whether a name is neither hidden nor one of the small things that the machine has besides."""
        return not self.is_right(row) and (row.place, row.effect) not in self.truth.allowed

    def sizes(self) -> list[tuple[Hidden, float | None, float | None, float | None]]:
        """Of what is named and has a size: the truth; size, low and high in its unit."""
        return [(h, *row.size_in(h.unit)) for h, row in self.named() if row is not None and h.size is not None]


def error_ratio(truth: Truth, predicted: Mapping[str, Floats] | None) -> float | None:
    """Rms over channels of a prediction's error, each in units of the oracle's; infinite without a prediction.

    None of a case that has no test.
    """
    if predicted is None or not truth.test:
        return math.inf if truth.test else None
    squares = []
    for name, values in truth.test.items():
        wrong = (np.asarray(values) - predicted[name]) / truth.oracle[name]
        squares.append(np.mean(np.nan_to_num(np.clip(wrong, -RUNAWAY, RUNAWAY), nan=RUNAWAY) ** 2))
    return float(np.sqrt(np.mean(squares)))


def score(tool: str, truths: Sequence[Truth], answers: Answers, ratios: Mapping[str, float | None]) -> Score:
    """Score the answers of one tool.

    truths : of the cases that it worked on. ratios : case -> :func:`error_ratio` of its prediction.
    """
    judged = [Judged(t, answers.rows.get(t.case, ()), ratios.get(t.case)) for t in truths]
    every = [*(t.split for t in truths), *(t.kind for t in truths)]
    groups = dict.fromkeys(["all", *every, "clean", "lifelike", *(t.machine for t in truths if t.kind != "real")])
    figures = [f for name in groups for f in figures_of([j for j in judged if name in _groups_of(j.truth)], name)]
    return Score(tool, len(truths), figures, reliability(judged), answers.problems)


def _groups_of(truth: Truth) -> set[str]:
    """The groups whose figures count a case."""
    made = "lifelike" if truth.lifelike else "real" if truth.kind == "real" else "clean"
    return {"all", truth.split, truth.kind, made, truth.machine}


def figures_of(judged: Sequence[Judged], group: str) -> list[Figure]:
    """The figures of some cases."""
    named = [row is not None for j in judged for _, row in j.named()]
    placed = [right for j in judged for right in j.placed()]
    false = [j.is_false(row) for j in judged for row in j.said if j.is_right(row) or j.is_false(row)]
    sizes = [s for j in judged for s in j.sizes()]
    within = [
        size is not None and abs(size - h.size) <= NEAR * abs(h.size) for h, size, _, _ in sizes if h.size is not None
    ]
    intervals = [
        holds((low, high), h.size) for h, _, low, high in sizes if None not in (low, high) and h.size is not None
    ]
    clean = [not any(j.is_false(row) for row in j.said) for j in judged]
    nothing = [right for j, right in zip(judged, clean, strict=True) if not j.truth.hidden]
    ratios = [j.ratio for j in judged if j.ratio is not None]
    shares = [
        ("named", "hidden things named, with their place", named),
        ("place", "hidden things with a name at their place, right or wrong", placed),
        ("nothing", "machines that lack nothing, of which nothing false was said", nothing),
        ("false_names", "names that are false", false),
        ("no_false_name", "cases without a false name", clean),
        ("size", "named things whose size is within 10 %", within),
        ("coverage", "intervals of sizes that hold the truth", intervals),
    ]  # fmt: skip
    found = [_share(name, what, group, right) for name, what, right in shares]
    median, low, high = median_interval(ratios)
    given = sum(map(math.isfinite, ratios))
    what = f"median error of predictions over the oracle's ({given} of {len(ratios)} cases predicted)"
    return [*found, Figure("prediction", what, group, median, len(ratios), low, high)]


def _share(name: str, what: str, group: str, right: Sequence[bool]) -> Figure:
    of, count = len(right), sum(right)
    return Figure(name, what, group, count / of if of else math.nan, of, *wilson(count, of), count)


def reliability(judged: Sequence[Judged]) -> list[Bin]:
    """Names by their certainty, in ``BINS`` equal ranges; a range without a name is left out.

    Names of small things that a machine has besides are neither right nor false, and left out.
    """
    names = [
        (row.certainty, j.is_right(row)) for j in judged for row in j.rows if j.is_right(row) or j.is_false(row)
    ]  # fmt: skip
    found = []
    for k in range(BINS):
        inside = [(c, right) for c, right in names if min(int(c * BINS), BINS - 1) == k]
        if inside:
            found.append(Bin(float(np.mean([c for c, _ in inside])), sum(right for _, right in inside), len(inside)))
    return found
