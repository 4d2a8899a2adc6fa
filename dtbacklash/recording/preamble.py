"""What stands above the numbers of a text table: names and units of its columns, a sample time, times of each channel.

Instruments write keys in front of what they say (``Y_Unit_Label;V;rad``, ``Sample Interval;1e-6``), some of them once
for each channel (``Name;u;Name;theta``): what recurs in a row stands above the times of the channels that follow it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from dtbacklash import units
from dtbacklash.recording import heads
from dtbacklash.recording.refusal import Refused

_NAMES = re.compile(
    r"((signal|channel|kanal|trace)?[ _]*(name|label|variable)s?|signal|channel|kanal)\W*", re.IGNORECASE
)
_UNITS = re.compile(r"(.*[\W_]|[vy])?(units?|einheit(en)?)([\W_].*)?", re.IGNORECASE)
_STEP = re.compile(
    r"(delta[ _]?x|x?[ _]?increment|[hx]_?resolution|sampl(e|ing)[ _]?(time|interval|period)|abtastzeit|dt)\b.*",
    re.IGNORECASE,
)
_STEP_UNIT = re.compile(r"[hx][ _]?units?", re.IGNORECASE)
_RATE = re.compile(
    r"(?:sampl\w*[ _]?(?:rate|frequency)|abtastrate)\W+(\d+\.?\d*(?:e[+-]?\d+)?)\s*(k?)Hz", re.IGNORECASE
)
#: what people write where a unit is meant, beside the units that can be read
_LIKE_UNIT = re.compile(
    r"[\[({<].*[\])}>]|-|%|[°µ\w]{1,3}|counts?|digits?|inkremente?|increments?|ticks|sequence", re.IGNORECASE
)
#: how the values of a column are kept, in a line below its name
_TYPE = re.compile(r"f[48]|[iu][1248]|u?int\d*|l?real|float\d*|double|single|bool(ean)?|number|numeric", re.IGNORECASE)
_BRACKETS = "[](){}<> "
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")


@dataclass
class Preamble:
    """Names and units of the columns, empty where none is said, and the column of each one's times (-1: that of all).

    step_s : time between two samples where it is stated. spare : names that have no column.
    """

    names: list[str]
    units: list[str]
    clocks: list[int]
    step_s: float | None = None
    spare: list[str] = field(default_factory=list)


def understood(rows: list[list[str]], width: int, decimal: str) -> Preamble:
    """What the rows of fields above ``width`` columns of numbers say; the row next to the numbers comes last.

    Raises Refused where a row of numbers with more fields stands between the names and the others.
    """
    rate = next(filter(None, (_RATE.search(" ".join(row)) for row in rows)), None)
    found = Preamble([], [""] * width, [-1] * width)
    if rate and float(rate[1]) > 0.0:
        found.step_s = 1.0 / (float(rate[1]) * (1e3 if rate[2] else 1.0))
    rows = [
        row for row in rows if len(row) > 1 and not all(map(_TYPE.fullmatch, row)) and not _STEP_UNIT.fullmatch(row[0])
    ]
    named: list[str] = []
    numbers: list[str] = []
    keyed = False
    for row, above in zip(reversed(rows), [*reversed(rows[:-1]), []], strict=False):
        found.step_s = found.step_s or _step(row, above, decimal)
        if _UNITS.fullmatch(row[0]) or (not named and _are_units(row, above, decimal)):
            said = ["" if text == row[0] and _UNITS.fullmatch(text) else text.strip(_BRACKETS) for text in row]
            found.units = [one or new for one, new in zip(found.units, [*said, *[""] * width], strict=False)]
        elif len(row) < width - 1:
            continue
        elif _NAMES.fullmatch(row[0]) and not keyed and not (named and heads.is_time(named[0])):
            named, keyed = row, True
        elif not named and _are_names(row, decimal):
            named = row
        elif not named and len(row) > width and 2 * sum(map(bool, map(NUMBER.fullmatch, row))) > len(row):
            numbers = row
    if named and numbers:
        raise Refused(f"has a row of {len(numbers)} fields ({', '.join(numbers)[:40]}) above its {width} columns")
    if keyed and not _recurs(named):
        named = ["t", *named[1:]]
    found.spare = [name for name in named[width:] if name]
    found.names = [*named[:width], *[""] * (width - len(named))]
    found.units = [u if u.lower() != n.lower() else "" for u, n in zip(found.units, found.names, strict=True)]
    _name_clocks(found, rows)
    return found


def _are_units(row: list[str], above: list[str], decimal: str) -> bool:
    """Whether a row below another one holds units: most are known, or some are and the others look alike."""
    filled = [text for text in row if text and _number(text, decimal) is None]
    known = sum(units.find(text.strip(_BRACKETS)) is not None for text in filled)
    like = all(units.find(text) or _LIKE_UNIT.fullmatch(text) for text in filled)
    own = [text for k, text in enumerate(row) if text and [text.lower()] != [one.lower() for one in above[k : k + 1]]]
    named = any(text.lower() in ("t", "u", "time", "zeit") for text in own)
    return sum(map(bool, above)) > 1 and not named and known > 0 and (2 * known >= len(filled) or like)


def _are_names(row: list[str], decimal: str) -> bool:
    """Whether a row may hold names: some of its fields, and its first one, are no numbers."""
    numbers = [_number(text, decimal) is not None for text in row if text]
    return not _STEP.fullmatch(row[0]) and bool(numbers) and not numbers[0] and not all(numbers)


def _name_clocks(found: Preamble, rows: list[list[str]]) -> None:
    """Name the columns that hold the times of those behind them; the unit may stand in any row that recurs alike."""
    starts = _recurs(found.names)
    keys = [row[0] for row in rows if _recurs(row) == starts]
    unit = next((head.unit for key in keys for head in heads.readings(key) if units.find(head.unit)), "")
    for start, end in zip(starts, [*starts[1:], len(found.names)], strict=False):
        found.clocks[start + 1 : end] = [start] * (end - start - 1)
        found.names[start] = f"times of {next(name for name in found.names[start + 1 : end] if name)}"
        found.units[start] = found.units[start] or unit


def _recurs(row: list[str]) -> list[int]:
    """Where the first field of a row stands, if again and again, with something in between."""
    at = [k for k, text in enumerate(row) if text and text == row[0]]
    apart = len(at) > 1 and all(any(row[a + 1 : b]) for a, b in zip(at, [*at[1:], len(row)], strict=True))
    return at if apart else []


def _step(row: list[str], above: list[str], decimal: str) -> float | None:
    """A sample time that a row states behind a key, or below one, s."""
    below = [(key, row[k : k + 1]) for k, key in enumerate(above[: len(row)]) if k]
    for key, behind in [(row[0], row[1:]), *below]:
        value = next(filter(None, (_number(text, decimal) for text in behind)), None) if _STEP.fullmatch(key) else None
        if value:
            unit = next((units.find(head.unit) for head in heads.readings(key) if units.find(head.unit)), None)
            return value * (unit.factor if unit and unit.si == "s" else 1.0)
    return None


def _number(text: str, decimal: str) -> float | None:
    text = text.replace(decimal, ".")
    return float(re.sub("[dD]", "e", text)) if NUMBER.fullmatch(text) else None
