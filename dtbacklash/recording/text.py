"""Text tables: delimiter, decimal sign, comments, header and a line of units are found by looking."""

from __future__ import annotations

import csv
import io
import re

import numpy as np
import pandas as pd

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.recording.refusal import Refused

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


def read(content: bytes) -> tuple[list[str], list[str], dict[str, Floats]]:
    """Read a text table.

    Returns
    -------
    names of the columns, their units where a line states them (else empty), and the columns.

    Raises
    ------
    Refused : no table of numbers, no header, text among the numbers, lines of different lengths.
    """
    whole = _decoded(content)
    lines = whole.split("\n", HEAD_LINES)[:HEAD_LINES]
    delimiter, decimal, first = _dialect(lines)
    width = len(_fields(lines[first], delimiter))
    names, written = _header(lines[:first], delimiter, width)
    if not any(names):
        raise Refused("has no header: name the columns in the first line, e.g. t,u,q3")
    body = whole.split("\n", first)[first] if first else whole
    try:
        frame = pd.read_csv(
            io.StringIO(body), sep=delimiter, decimal=decimal, header=None, names=range(width),
            index_col=False, comment="#" if "#" in whole[: len(whole) - len(body)] else None,
            low_memory=False,
        )  # fmt: skip
    except pd.errors.ParserError as error:
        reason = str(error).split("C error: ")[-1].strip()
        raise Refused(f"has lines of different lengths ({reason}; lines counted from line {first + 1})") from error
    columns, kept, kept_units = {}, [], []
    for j, name in enumerate(names):
        values = _numbers(frame[j], name, first)
        if not name or name in columns:
            if name:
                raise Refused(f"has two columns named {name}")
            continue
        columns[name] = values
        kept.append(name)
        kept_units.append(written[j])
    return kept, kept_units, columns


def _decoded(content: bytes) -> str:
    try:
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
    """Delimiter, decimal sign and the index of the first line of numbers."""
    best: tuple[int, str, str, int] | None = None
    for delimiter, decimal in DIALECTS:
        for index, line in enumerate(lines):
            if _skipped(line):
                continue
            fields = _fields(line, delimiter)
            filled = [field for field in fields if field]
            if len(filled) >= 2 and all(_is_number(field, decimal) for field in filled):
                if best is None or len(fields) > best[0]:
                    best = (len(fields), delimiter, decimal, index)
                break
    if best is None:
        raise Refused("holds no table of numbers with at least two columns")
    return best[1], best[2], best[3]


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


def _numbers(column: pd.Series, name: str, first: int) -> Floats:
    if column.dtype != object and pd.api.types.is_numeric_dtype(column):
        return column.to_numpy(dtype=float)
    strings = column.astype("string").str.strip()
    numbers = pd.to_numeric(strings, errors="coerce")
    missing = strings.isna() | strings.str.lower().isin(["", "nan", "na", "n/a", "null", "none", "-"])
    bad = np.flatnonzero((numbers.isna() & ~missing).to_numpy(dtype=bool))
    if len(bad):
        raise Refused(
            f"column {name or '(unnamed)'} holds text ({str(column.iloc[bad[0]])[:30]!r}) in row {bad[0] + 1} of the "
            f"numbers, {len(bad)} time{'s' if len(bad) > 1 else ''}"
        )
    return numbers.to_numpy(dtype=float, na_value=np.nan)
