"""Numbers as people write them. All texts of a table decide together which sign is the decimal one.

A point or a comma in a number is the decimal sign, or it groups thousands. Most numbers prove which: ``0,5`` and
``1,2345`` have decimal commas, as a group has three digits; ``1,234.5`` and ``1,234,567`` group by commas. ``1,234``
proves nothing and is read as the others say. A number that contradicts them makes its column unusable, with its row.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from dtbacklash import units
from dtbacklash.arrays import Floats

#: (N,) texts of a column, null where a value is missing: a pa.ChunkedArray, which declares no types
Texts: TypeAlias = Any
Mask = np.ndarray[Any, np.dtype[np.bool_]]
POINT, COMMA = ".", ","
#: what groups thousands, and does nothing else
BLANKS = "'\u2019 \u00a0\u2009\u202f"
MISSING = frozenset({"", "-", "--", "---", "nan", "na", "n/a", "#n/a", "nat", "null", "none"})
_EXPONENT = r"(?:[eEdD][+-]?\d+)?"
_INTEGER, _WORD = rf"^[+-]?\d+{_EXPONENT}$", r"(?i)^[+-]?inf(?:inity)?$"
_QUANTITY = rf"^\s*(?P<number>[+-]?[\d.,][\d.,{BLANKS}]*{_EXPONENT})\s*(?P<unit>[^\d\s.,].*?)\s*$"
#: of the rows: fewer decimal points than these do not prove that commas part columns; of the numbers like 1,234: fewer
#: numbers with a decimal point than these do not prove that those are whole
SLIPS = 0.05
_LOOK = 1000  # rows in which a proof is looked for before all the others


@dataclass(frozen=True)
class Convention:
    """How the numbers of a table are written.

    decimal : its decimal sign. decided : whether enough tells; if not, no column with numbers like 1,234 can be read.
    alone : whether the other sign stands nowhere.
    """

    decimal: str = POINT
    decided: bool = True
    alone: bool = False

    @property
    def other(self) -> str:
        """The sign that groups thousands, where one of the two does."""
        return COMMA if self.decimal == POINT else POINT


def decide(columns: Sequence[Texts], present: Collection[str] = (POINT, COMMA), fallback: str = "") -> Convention:
    """How the numbers of all columns are written; texts that are no numbers say nothing.

    present : the signs that may stand in a text. fallback : the decimal sign where no number tells; empty: it stays
    undecided.
    """
    signs = [sign for sign in (POINT, COMMA) if sign in present]
    if not signs:
        return Convention(alone=True)
    for rows in (_LOOK, None) if len(signs) == 1 else (None,):  # of the usual file its beginning is enough
        votes = {sign: sum(int(proofs(c[:rows], sign).sum()) for c in columns) for sign in (POINT, COMMA)}
        decimal = max(votes, key=lambda sign: votes[sign])
        if votes[decimal]:
            alone = signs == [decimal]
            groups = 0 if alone else sum(int(_match(c, _one_group(Convention(decimal).other)).sum()) for c in columns)
            return Convention(decimal, decided=votes[decimal] > SLIPS * groups, alone=alone)
    held = {sign: [c for c in columns if pc.any(pc.match_substring(c, sign)).as_py()] for sign in (POINT, COMMA)}
    open_ = [sign for sign in signs if any(_match(c, _one_group(sign)).any() for c in held[sign])]
    if len(open_) == 1 and any(_counts_on(c, open_[0]) for c in held[open_[0]]):
        return Convention(COMMA if open_ == [POINT] else POINT)
    return Convention(fallback or POINT, decided=bool(fallback) or not open_)


def parse(texts: Texts, convention: Convention) -> tuple[Floats, np.ndarray, str]:
    """Read a column of numbers.

    Returns
    -------
    (N,) numbers, NaN where there is none; the rows of texts that are none; why the column cannot be read, or empty.
    """
    sign, other = convention.decimal, convention.other
    if convention.decided and (convention.alone or not pc.any(pc.match_substring(texts, other)).as_py()):
        try:
            return _floats(texts, sign), np.empty(0, dtype=np.int64), ""
        except pa.ArrowInvalid:
            pass  # some are no numbers, or not in plain digits
    texts = pc.utf8_trim(texts, "\"' \t\u00a0")
    ones = _match(texts, _one_group(other))
    grouped = _match(texts, _grouped(other)) | _match(texts, _blanks(sign, "?"))
    good = grouped | _match(texts, _plain(sign)) | _match(texts, _INTEGER) | _match(texts, _WORD)
    if not convention.decided:
        good &= ~_match(texts, _one_group(sign))
    elif ones.any() and _groups_all(texts, sign):
        good |= ones
    missing = _mask(pc.is_null(texts)) | _mask(pc.is_in(pc.utf8_lower(texts), pa.array(sorted(MISSING))))
    bad = ~(good | missing)
    wrong = bad & (_match(texts, _plain(other)) | _match(texts, _grouped(sign)) | _match(texts, _one_group(sign)))
    written = pc.replace_substring_regex(pc.if_else(pa.array(good), texts, None), f"[{other}{BLANKS}]", "")
    values = _floats(pc.replace_substring_regex(written, "[dD]", "e"), sign)
    return values, np.flatnonzero(bad), _contradiction(texts, convention, np.flatnonzero(wrong))


def without_units(texts: Texts) -> tuple[Texts, Texts | None]:
    """The numbers and the units of a column with a unit behind each number, ``900 mV``, ``1.1 V``; else None."""
    first = re.match(_QUANTITY, first_text(texts))
    if first is None or units.find(first["unit"]) is None:
        return texts, None
    parts = pc.extract_regex(texts, _QUANTITY)
    if parts.null_count > texts.null_count:
        return texts, None
    return pc.utf8_trim_whitespace(pc.struct_field(parts, "number")), pc.struct_field(parts, "unit")


def first_text(texts: Texts) -> str:
    """The first text of a column; empty where it has none."""
    at = pc.index(pc.is_valid(texts), True).as_py() if texts.null_count else 0
    return str(texts[at].as_py()) if 0 <= at < len(texts) else ""


def whole_numbers(texts: Texts) -> np.ndarray | None:
    """(N,) differences to the first of numbers too long for a float, as clocks count; else None."""
    if not re.fullmatch(r"[+-]?\d{16,}", first_text(texts[:1])):
        return None
    try:
        counts = texts.cast(pa.int64())
    except pa.ArrowInvalid:
        return None
    return np.asarray(pc.subtract(counts, counts[0]).cast(pa.float64()).to_numpy(), dtype=float)


def proofs(texts: Texts, sign: str) -> Mask:
    """(N,) which numbers prove that a sign is the decimal one."""
    other = COMMA if sign == POINT else POINT
    plain = _match(texts, _plain(sign)) & ~_match(texts, _one_group(sign))
    return plain | _match(texts, _grouped(other)) | _match(texts, _blanks(sign, ""))


def _counts_on(texts: Texts, sign: str) -> bool:
    """Whether a column only counts up if a sign groups thousands, not if it is the decimal one: 995, 1,000, 1,005."""
    ones = _match(texts, _one_group(sign))
    if not ones.any() or not (ones | _match(texts, r"^\d{1,3}$") | _mask(pc.is_null(texts))).all():
        return False
    as_groups, as_decimals = _floats(pc.replace_substring(texts, sign, ""), POINT), _floats(texts, sign)
    return bool(np.nanmin(np.diff(as_groups), initial=0.0) >= 0.0 > np.nanmin(np.diff(as_decimals), initial=0.0))


def _groups_all(texts: Texts, sign: str) -> bool:
    """Whether a column has whole numbers alone, and those from 1000 on in groups: only then 1,234 is no slip."""
    return not _match(texts, rf"^[+-]?\d{{4,}}$|[{sign}]").any()


def _contradiction(texts: Texts, convention: Convention, rows: np.ndarray) -> str:
    if not len(rows):
        return ""
    text, more = texts[int(rows[0])].as_py(), f", and {len(rows) - 1} more like it" if len(rows) > 1 else ""
    where = f"holds {text!r} in row {rows[0] + 1} of the numbers{more}"
    if not convention.decided:
        return f"{where}, and no number of the file tells whether that is one and a fraction or more than a thousand"
    name = "points" if convention.decimal == POINT else "commas"
    return f"{where}, and the numbers of the file have decimal {name}: write it like them"


def _floats(texts: Texts, sign: str) -> Floats:
    """(N,) plain numbers with a decimal sign, NaN for null (raises pa.ArrowInvalid)."""
    plain = pc.replace_substring(texts, COMMA, POINT) if sign == COMMA else texts
    read = plain.cast(pa.float64())
    values = _held(read, np.dtype(float))
    if read.null_count:
        values[~_mask(pc.is_valid(read))] = np.nan
    return values


def _match(texts: Texts, pattern: str) -> Mask:
    return _mask(pc.match_substring_regex(texts, pattern))


def _mask(booleans: Any) -> Mask:
    """(N,) false where null."""
    return _held(pc.coalesce(booleans, pc.is_valid(booleans)).cast(pa.uint8()), np.dtype(np.uint8)).astype(bool)


def _held(column: Any, kind: np.dtype[Any]) -> np.ndarray:
    """(N,) copy of what a column holds, anything where null. ``to_numpy`` and Python values would import pandas."""
    chunks = [chunk for chunk in getattr(column, "chunks", [column]) if len(chunk)]
    parts = [np.frombuffer(c.buffers()[1], kind, len(c), c.offset * kind.itemsize) for c in chunks]
    return np.concatenate([np.empty(0, kind), *parts])


def _plain(sign: str) -> str:
    """A number with a decimal sign and no groups."""
    return rf"^[+-]?(?:\d+[{sign}]\d*|[{sign}]\d+){_EXPONENT}$"


def _one_group(sign: str) -> str:
    """A number that may be a whole one with a group, or one with three decimals."""
    return rf"^[+-]?[1-9]\d{{0,2}}[{sign}]\d{{3}}$"


def _grouped(sign: str) -> str:
    """A number whose digits can only be grouped by a sign."""
    decimal = COMMA if sign == POINT else POINT
    groups = rf"[{sign}]\d{{3}}"
    return rf"^[+-]?[1-9]\d{{0,2}}(?:(?:{groups})+[{decimal}]\d*|(?:{groups}){{2,}}){_EXPONENT}$"


def _blanks(sign: str, fraction: str) -> str:
    """A number in groups that blanks or quotes part. fraction : ``?`` where it may have none."""
    kinds = "|".join(rf"(?:{blank}\d{{3}})+" for blank in BLANKS)
    return rf"^[+-]?[1-9]\d{{0,2}}(?:{kinds})(?:[{sign}]\d*){fraction}{_EXPONENT}$"
