"""Read a tool's answers: named effects with sizes and certainty, and predictions.

A wrong row is left out, and gives one line of ``Answers.problems``.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.benchmark import vocabulary
from dtbacklash.errors import UserError
from dtbacklash.files import reason
from dtbacklash.scoring.truth import Key

FILE, CASES = "answers.csv", "cases.txt"
COLUMNS = ("case", "place", "effect", "size", "unit", "low", "high", "certainty")
#: columns that may be missing, or empty
OPTIONAL = COLUMNS[3:]
#: a message shows so many characters of a cell
MESSAGE_CHARACTERS = 40
#: (how people spell a part of a unit, how the table of units does)
SPELLINGS = (
    (r"[*·()]", " "), ("²", "^2"), ("³", "^3"), (r"(?<=[A-Za-z])(?=[2-9])", "^"), (r"\bN(m?)s\b", r"N \1 s"),
    (r" *(/| ) *", r"\1"),
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One name: place and effect in the vocabulary's words; size and interval in the unit of the answer."""

    case: str
    place: str
    effect: str
    size: float | None = None
    unit: str = ""
    low: float | None = None
    high: float | None = None
    certainty: float = 1.0

    @property
    def key(self) -> Key:
        """Place and effect."""
        return self.place, self.effect

    def size_in(self, unit: str) -> tuple[float | None, float | None, float | None]:
        """Size, low and high in a unit; None if the row has none, or in a unit of another kind."""
        factor = factor_between(self.unit, unit) if self.unit else 1.0
        if factor is None:
            return None, None, None
        size, low, high = (None if value is None else factor * value for value in (self.size, self.low, self.high))
        return size, low, high


def factor_between(written: str, unit: str) -> float | None:
    """The factor that converts a value from a unit, as people spell it, to another; None if their kinds differ.

    An angle is a number: ``N m s`` is ``N m s/rad``. A frequency in Hz is 2 pi of it in rad/s.
    """
    unit = unit or "1"
    for text in dict.fromkeys((written, _plain_unit(written))):
        if text == unit:
            return 1.0
        for own in filter(None, (units.composed(text), units.find(text))):
            wanted = units.composed(unit) or units.find(unit)
            dimension = units.dimension_of(own.si)
            if wanted is None or dimension is None or dimension != units.dimension_of(wanted.si):
                continue
            turns = [one.si == "rad/s" for one in (own, wanted)]
            if turns[0] == turns[1]:
                return own.factor / wanted.factor
            if "Hz" in (own.si, wanted.si):
                return own.factor / wanted.factor * (2.0 * math.pi) ** (turns[1] - turns[0])
    return None


def _plain_unit(unit: str) -> str:
    for sign, right in SPELLINGS:
        unit = re.sub(sign, right, unit)
    return " ".join(unit.split())


@dataclass
class Answers:
    """rows : case -> its names. cases : that the tool worked on. problems : a line for each wrong row or file."""

    rows: dict[str, list[Row]] = field(default_factory=dict)
    cases: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


class Foreign(ValueError):
    """A row about a case that the benchmark lacks, or about a place that another machine of it has."""


def read(folder: Path, cases: Mapping[str, str], places: Mapping[str, Mapping[str, str]]) -> Answers:
    """Read ``answers.csv``, and ``cases.txt`` with the cases that the tool worked on (default: all).

    cases : number -> machine. places : machine -> spelling -> place.

    Raises UserError: the file is missing, cannot be read, or lacks a column.
    """
    found = Answers(cases=list(cases))
    if (folder / CASES).is_file():
        words = _text(folder / CASES).split()
        found.cases = sorted({w.zfill(3) for w in words} & set(cases))
        found.problems += [f"{CASES}: no case {w[:MESSAGE_CHARACTERS]!r}" for w in words if w.zfill(3) not in cases]
    first, *lines = re.split(r"\r\n|\r|\n", _text(folder / FILE))
    delimiter = max(";\t,", key=first.count)
    names = [vocabulary.plain(name) for name in next(csv.reader([first], delimiter=delimiter), [])]
    if missing := [name for name in COLUMNS if name not in names and name not in OPTIONAL]:
        raise UserError("answers", folder / FILE, f"lacks the column {missing[0]}; it has {', '.join(COLUMNS)}")
    if double := [name for name in COLUMNS if names.count(name) > 1]:
        raise UserError("answers", folder / FILE, f"has two columns {double[0]}")
    rows = foreign = 0
    for number, line in enumerate(lines, 2):
        try:
            cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, strict=True), [])]
            if any(cells[len(names) :]):
                raise ValueError("more cells than columns; a decimal comma takes semicolons between columns")
            if any(cells):
                rows += 1
                row = dict(zip(names, cells, strict=False))  # a row may be short, or end in empty cells
                _add(found, _row(row, cases, places, delimiter == ";"))
        except (ValueError, csv.Error) as error:
            problem = " ".join(str(error).split())
            found.problems.append(f"{FILE}, line {number}: {problem}; the row is left out")
            foreign += isinstance(error, Foreign)
    if foreign > 1:  # one alone has its line
        what = f"{foreign} of {rows} rows are about cases that this benchmark lacks, or places of other machines"
        found.problems.insert(0, f"{FILE}: {what}; were they made for another benchmark?")
    return found


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8-sig", "replace").replace("\0", "")
    except OSError as error:
        raise UserError("answers", path, f"cannot be read: {reason(error)}") from error


def _add(found: Answers, row: Row) -> None:
    if row.case not in found.cases:
        raise ValueError(f"case {row.case} is not in {CASES}")
    there = found.rows.setdefault(row.case, [])
    if row.key in [other.key for other in there]:
        raise ValueError(f"{row.place} {row.effect} is named twice")
    there.append(row)


def _row(cells: dict[str, str], cases: Mapping[str, str], places: Mapping[str, Mapping[str, str]], comma: bool) -> Row:
    """One row; raises ValueError: what is wrong with it."""
    case = cells.get("case", "").removesuffix(".0").zfill(3)
    if case not in cases:
        raise Foreign(f"no case {cells.get('case', '')[:MESSAGE_CHARACTERS]!r}")
    machine, said = cases[case], vocabulary.plain(cells.get("place", ""))
    if said not in places[machine] and any(said in other for other in places.values()):
        raise Foreign(f"case {case} is of {machine}, which has no place {cells['place'][:MESSAGE_CHARACTERS]!r}")
    place = vocabulary.word_of(cells.get("place", ""), places[machine])
    effect = vocabulary.word_of(cells.get("effect", ""), vocabulary.effects())
    size, low, high, certainty = (_number(cells, name, comma) for name in ("size", "low", "high", "certainty"))
    if low is not None and high is not None and low > high:
        raise ValueError(f"low {low:g} is above high {high:g}")
    if certainty is not None and not 0.0 <= certainty <= 1.0:
        raise ValueError(f"certainty {certainty:g} is not from 0 to 1")
    if re.fullmatch(r"[\d.,]+", cells.get("unit", "")) and cells["unit"] != "1":
        raise ValueError(
            f"unit {cells['unit'][:MESSAGE_CHARACTERS]!r} is a number; a decimal comma takes semicolons between columns"
        )
    return Row(case, place, effect, size, cells.get("unit", ""), low, high, 1.0 if certainty is None else certainty)


def _number(cells: dict[str, str], name: str, comma: bool) -> float | None:
    text = cells.get(name, "")
    if not text:
        return None
    try:
        value = float(text.replace(",", ".") if comma else text)
    except ValueError:
        raise ValueError(f"{name} {text[:MESSAGE_CHARACTERS]!r} is no number") from None
    if not math.isfinite(value):
        raise ValueError(f"{name} {text[:MESSAGE_CHARACTERS]!r} is not finite")
    return value


def prediction(folder: Path, case: str, channels: Mapping[str, int]) -> tuple[dict[str, Floats] | None, str]:
    """Channel -> (N,) predicted readings of a case, or None; and what is wrong with its file, or nothing.

    channels : name -> number of samples.
    """
    path = folder / f"{case}.csv"
    if not path.is_file():
        return None, ""
    try:
        table = pd.read_csv(path, index_col=False)
    except (OSError, ValueError, pd.errors.ParserError) as error:
        return None, f"{path.name}: {str(error).splitlines()[0]}"
    found = {}
    for name, samples in channels.items():
        if name not in table:
            return None, f"{path.name}: lacks the column {name}"
        values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=np.float64)
        if len(values) != samples:
            return None, f"{path.name}: {len(values)} rows, and the test has {samples}"
        found[name] = values
    return found, ""
