"""Score a folder of answers against a benchmark: every figure with its count and 95 % interval.

A name counts as a claim if its certainty is at least ``MIN_CERTAINTY``. All names count for the reliability of
certainty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.benchmark import answers, files
from dtbacklash.benchmark.answers import Row
from dtbacklash.errors import UserError
from dtbacklash.scoring.shares import Count, holds, median_interval, wilson
from dtbacklash.scoring.truth import Matching, Truth

#: a name with less certainty is an alternative
MIN_CERTAINTY = 0.5
#: relative error of a size that is right
SIZE_TOLERANCE = 0.1
#: ranges of certainty whose names are counted together
BINS = 5
#: an error of a prediction counts as at most so many of the oracle's
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
class Bin(Count):
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
class ScoredCase:
    """One case with a tool's names for it. ratio : see :func:`error_ratio`."""

    truth: Truth
    rows: Sequence[Row]
    ratio: float | None = None

    @property
    def claims(self) -> list[Row]:
        """The names that count as claims."""
        return [row for row in self.rows if row.certainty >= MIN_CERTAINTY]

    def matching(self, rows: Sequence[Row]) -> Matching:
        """Some of the names, matched with what is hidden."""
        return Matching([hidden.key for hidden in self.truth.hidden], [row.key for row in rows], self.truth.allowed)

    @property
    def groups(self) -> set[str]:
        """The groups whose figures count it."""
        made = "lifelike" if self.truth.lifelike else "real" if self.truth.kind == "real" else "clean"
        return {"all", self.truth.split, self.truth.kind, made, self.truth.machine}

    def wrong_units(self) -> list[str]:
        """A line for each size that is in a unit of another kind."""
        hidden = {h.key: h for h in self.truth.hidden if h.size is not None}
        rows = [(row, hidden[row.key]) for row in self.rows if row.key in hidden and row.size is not None]
        return [
            f"case {row.case}: {row.unit[: answers.MESSAGE_CHARACTERS]!r} is no unit for {row.place} {row.effect} "
            f"({h.unit or 1}); its size counts as wrong"
            for row, h in rows if row.size_in(h.unit)[0] is None
        ]  # fmt: skip

    def sizes(self) -> list[tuple[float, float | None, float | None, float | None]]:
        """Of what is named and has a size: the true size; size, low and high in its unit."""
        rows = {row.key: row for row in self.claims}
        return [
            (hidden.size, *rows[hidden.key].size_in(hidden.unit)) for hidden in self.truth.hidden
            if hidden.key in rows and hidden.size is not None
        ]  # fmt: skip


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


def figures_of(cases: Sequence[ScoredCase], group: str) -> list[Figure]:
    """The figures of some cases."""
    matchings = [case.matching(case.claims) for case in cases]
    named = [i in m.exact for m in matchings for i in range(len(m.hidden))]
    placed = [i in m.placed for m in matchings for i in range(len(m.hidden))]
    false = [j in m.false for m in matchings for j in sorted(m.right | m.false)]
    clean = [not m.false for m in matchings]
    nothing = [not m.false for m in matchings if not m.hidden]
    sizes = [s for case in cases for s in case.sizes()]
    within = [size is not None and abs(size - true) <= SIZE_TOLERANCE * abs(true) for true, size, _, _ in sizes]
    intervals = [holds((low, high), true) for true, _, low, high in sizes if None not in (low, high)]
    ratios = [case.ratio for case in cases if case.ratio is not None]
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


def reliability(cases: Sequence[ScoredCase]) -> list[Bin]:
    """Names by their certainty, in ``BINS`` equal ranges; a range without a name is left out.

    Names of small things that a machine has besides are neither right nor false, and left out.
    """
    bins: dict[int, list[tuple[float, bool]]] = {}
    for case in cases:
        matching = case.matching(case.rows)
        for j in sorted(matching.right | matching.false):
            certainty = case.rows[j].certainty
            bins.setdefault(min(int(certainty * BINS), BINS - 1), []).append((certainty, j in matching.right))
    return [
        Bin(float(np.mean([certainty for certainty, _ in names])), sum(right for _, right in names), len(names))
        for _, names in sorted(bins.items())
    ]  # fmt: skip


def score_folder(folder: Path, bench: Path, key_file: Path | None, split: str, tool: str) -> Score:
    """The score of the answers in a folder; split : ``all``, or that of the cases that count.

    A real recording of which the benchmark has no copy counts only where the tool names the case.

    Raises UserError: no benchmark, no answers, no key where one is needed, a file that was changed.
    """
    about = {case.name: files.case_of(case) for case in files.case_folders(bench)}
    given = answers.read(folder, {name: str(a["machine"]) for name, a in about.items()}, files.places_of(bench))
    listed = set(given.cases if (folder / answers.CASES).is_file() else given.rows)
    worked_on = [n for n in given.cases if n in listed or about[n]["split"] != "real" or "recordings" in about[n]]
    numbers = [n for n in worked_on if split in ("all", about[n]["split"])]
    if not numbers:
        splits = ", ".join(dict.fromkeys(about[n]["split"] for n in worked_on))
        raise UserError("split", split, f"has no case that the tool worked on; it has such of {splits or 'none'}")
    cases, problems = [], given.problems
    for number in numbers:
        truth = files.truth_of(bench / files.CASES / number, key_file)
        samples = {channel: len(values) for channel, values in truth.test.items()}
        predicted, problem = answers.prediction(folder, number, samples) if samples else (None, "")
        cases.append(ScoredCase(truth, given.rows.get(number, ()), error_ratio(truth, predicted)))
        problems += [f"{problem}; the prediction is left out"] if problem else []
        problems += cases[-1].wrong_units()
    splits_and_kinds = [*(c.truth.split for c in cases), *(c.truth.kind for c in cases)]
    machines = [c.truth.machine for c in cases if c.truth.kind != "real"]
    groups = dict.fromkeys(["all", *splits_and_kinds, "clean", "lifelike", *machines])
    figures = [f for group in groups for f in figures_of([c for c in cases if group in c.groups], group)]
    return Score(tool, len(cases), figures, reliability(cases), problems)
