"""Text tables: delimiter, decimal sign, comments, header and a line of units are found by looking."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.recording import heads, stamps
from dtbacklash.recording.refusal import Refused

NUMBER, STAMP, TEXT = "number", "stamp", "text"
COMMENTS = ("#", "%", "//")
HEAD_LINES = 400  # a preamble longer than this is not looked for
_SPACE = r"\s+"
#: delimiter and decimal sign, in the order in which they are tried: the unmistakable ones first
DIALECTS = (
    ("\t", "."),
    (";", "."),
    ("|", "."),
    (",", "."),
    (_SPACE, "."),
    ("\t", ","),
    (";", ","),
    (_SPACE, ","),
)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity)|na|n/a|null", re.IGNORECASE)


@dataclass
class Text:
    """A text table: its columns, the units of those that state one, and why others are no numbers."""

    columns: dict[str, Floats] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    unusable: dict[str, str] = field(default_factory=dict)


def read(content: bytes) -> Text:
    """Read a text table; a column of time stamps becomes seconds from the first row on.

    Raises
    ------
    Refused : no table of numbers, no header, lines of different lengths.
    """
    whole = _decoded(content)
    lines = whole.split("\n", HEAD_LINES)[:HEAD_LINES]
    delimiter, decimal, first = _dialect(lines)
    width = len(_fields(lines[first], delimiter))
    names, written = _header(lines[:first], delimiter, width)
    if not any(names):
        raise Refused("has no header: name the columns in the first line: the time, u, and the sensors of the rig")
    body = whole.split("\n", first)[first] if first else whole
    try:
        frame = pd.read_csv(
            io.StringIO(body), sep=delimiter, decimal=decimal, header=None, names=range(width),
            index_col=False, comment="#" if "#" in whole[: len(whole) - len(body)] else None,
            low_memory=False, skipinitialspace=True,
        )  # fmt: skip
    except pd.errors.ParserError as error:
        reason = str(error).split("C error: ")[-1].strip()
        raise Refused(f"has lines of different lengths ({reason}; lines counted from line {first + 1})") from error
    found = Text()
    for j, name in enumerate(names):
        if not name:
            continue
        if name in found.columns or name in found.unusable:
            raise Refused(f"has two columns named {name}")
        values = _numbers(frame[j])
        if isinstance(values, str):
            clock = stamps.seconds(frame[j])
            if clock is None:
                found.unusable[name] = values
                continue
            label = heads.bare(name)
            found.columns[label], found.units[label] = clock, "s"
            continue
        found.columns[name] = values
        if written[j]:
            found.units[name] = written[j]
    return found


def is_utf16(head: bytes) -> bool:
    """Whether a file begins as text of two bytes a sign."""
    zeros = [head[side::2].count(0) / max(1, len(head[side::2])) for side in (0, 1)]
    return head.startswith((b"\xff\xfe", b"\xfe\xff")) or (max(zeros) > 0.8 and min(zeros) < 0.05)


def _decoded(content: bytes) -> str:
    try:
        if is_utf16(content[:512]):
            order = "" if content[:1] in (b"\xff", b"\xfe") else "-be" if content[:1] == b"\0" else "-le"
            whole = content.decode(f"utf-16{order}")
        else:
            whole = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        whole = content.decode("latin-1")  # old instruments write µ and ° so
    odd = sum(1 for sign in whole[:4096] if not (sign.isprintable() or sign in "\t\r\n\f"))
    if odd:
        raise Refused("is not a recording that can be read: it is neither text nor a known binary format")
    return whole.replace("\r\n", "\n").replace("\r", "\n")


def _fields(line: str, delimiter: str) -> list[str]:
    if delimiter == _SPACE:
        fields = line.split()
    elif '"' in line:  # a quoted head may hold the delimiter
        fields = next(csv.reader([line], delimiter=delimiter), [])
    else:
        fields = line.split(delimiter)
    return [field.strip().strip("\"'").strip() for field in fields]


def _is_number(field: str, decimal: str) -> bool:
    if decimal == "," and "." in field:
        return False
    return _NUMBER.fullmatch(field.replace(",", ".") if decimal == "," else field) is not None


def _skipped(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith(COMMENTS)


def _dialect(lines: list[str]) -> tuple[str, str, int]:
    """Delimiter, decimal sign and the index of the first line of numbers.

    Columns of numbers and of time stamps are those that hold them in most lines; there may be texts beside them.
    """
    best: tuple[int, str, str, int] | None = None
    for delimiter, decimal in DIALECTS:
        split = {k: _fields(line, delimiter) for k, line in enumerate(lines) if not _skipped(line)}
        width = Counter(len(fields) for fields in split.values() if len(fields) > 1).most_common(1)
        rows = [fields for fields in split.values() if width and len(fields) == width[0][0]]
        kinds = [_kind([fields[j] for fields in rows], decimal) for j in range(width[0][0] if rows else 0)]
        good = [j for j, kind in enumerate(kinds) if kind in (NUMBER, STAMP)]
        score = len(good) - kinds.count(TEXT)
        if len(good) < 2 or NUMBER not in kinds or (best is not None and score <= best[0]):
            continue
        for k, fields in split.items():
            meant = [_kind([fields[j]], decimal) for j in good if j < len(fields)]
            if 2 * sum(kind in (NUMBER, STAMP) for kind in meant) > len(good) and len(fields) >= len(kinds) - 1:
                best = (score, delimiter, decimal, k)
                break
    if best is None:
        full = [line for line in lines if not _skipped(line)]
        alone = len(full) <= 2 and any(sum(_is_number(f, ".") for f in _fields(line, d)) > 1
                                       for line in full for d, _ in DIALECTS)  # fmt: skip
        raise Refused("holds one row of numbers" if alone else "holds no table of numbers with at least two columns")
    return best[1], best[2], best[3]


def _kind(fields: list[str], decimal: str) -> str:
    """What most of the filled fields are; empty where none is filled."""
    filled = [field for field in fields if field]
    if not filled:
        return ""
    if 2 * sum(_is_number(field, decimal) for field in filled) > len(filled):
        return NUMBER
    return STAMP if 2 * sum(stamps.STAMP.fullmatch(field) is not None for field in filled) > len(filled) else TEXT


def _header(lines: list[str], delimiter: str, width: int) -> tuple[list[str], list[str]]:
    """Names and units of the columns from the lines above the numbers; a commented header counts as well."""
    candidates = []
    for line in lines:
        bare = line.strip()
        for sign in COMMENTS:
            bare = bare.removeprefix(sign).strip()
        splits = [_fields(bare, delimiter)]
        if bare != line.strip():  # a commented header often has blanks or commas where the numbers have tabs
            splits += [_fields(bare, _SPACE), _fields(bare, ",")]
        fields = next((fields for fields in splits if fields and 0 <= width - len(fields) <= 1), None)
        if bare and fields is not None:
            candidates.append(fields + [""] * (width - len(fields)))
    if not candidates:
        return [""] * width, [""] * width
    last = [field.strip("[]()") for field in candidates[-1]]
    if len(candidates) > 1 and all(not field or field in ("-", "1") or units.find(field) for field in last):
        return candidates[-2], [field if units.find(field) else "" for field in last]
    return candidates[-1], [""] * width


def _numbers(column: pd.Series) -> Floats | str:
    """The numbers of a column, or a phrase that says what it holds instead."""
    if column.dtype != object and pd.api.types.is_numeric_dtype(column):
        return column.to_numpy(dtype=float)
    strings = column.astype("string").str.strip()
    numbers = pd.to_numeric(strings, errors="coerce")
    missing = strings.isna() | strings.str.lower().isin(["", "nan", "na", "n/a", "null", "none", "-"])
    bad = np.flatnonzero((numbers.isna() & ~missing).to_numpy(dtype=bool))
    if len(bad):
        times = f"{len(bad)} time{'s' if len(bad) > 1 else ''}"
        return f"holds text ({str(column.iloc[bad[0]])[:30]!r}) in row {bad[0] + 1} of the numbers, {times}"
    return numbers.to_numpy(dtype=float, na_value=np.nan)
