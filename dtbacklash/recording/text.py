"""Text tables: delimiter, decimal sign, comments and the head are found by looking; :mod:`.preamble` reads the head."""

from __future__ import annotations

import csv
import io
import logging
import re
from collections import Counter
from itertools import pairwise

import numpy as np
import pandas as pd

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.recording import heads, preamble, stamps
from dtbacklash.recording.channels import runs
from dtbacklash.recording.preamble import Preamble
from dtbacklash.recording.refusal import Refused
from dtbacklash.recording.table import EMPTY, Column, Table, since_1970

log = logging.getLogger(__name__)

NUMBER, STAMP, TEXT = "number", "stamp", "text"
COMMENTS = ("#", "%", "//", "*", "!")
HEAD_LINES = 400  # a preamble longer than this is not looked for
FEW = 0.05  # of the lines with so many fields: a column that is filled in fewer decides nothing
ODD = 0.05  # of a column's rows that may hold a text in place of a number: a reading that failed
PAUSE = 100.0  # samples between two parts of a log whose clock begins anew
COUNTERS, OVER_STEPS = (2.0**16, 2.0**32), 10.0  # a counter of so many bits runs over, from one sample to the next
CLOCK_MIN = 2.0**53  # whole numbers beyond are nanoseconds of a clock, which count from the first on
MANY = 2_000_000  # rows from which it is said beforehand what they cost
READ_S, READ_GB = 3e-6, 1.5e-7  # what a row takes to read, and a value in memory (measured on 10^6 rows)
COST = (
    "{count} rows: reading them takes about {s:.0f} s and {gb:.1g} GB, and a diagnosis at least twice as long; "
    "recording.rows=[0,{few}] takes fewer"
)
_SPACE = r"\s+"
#: delimiter and decimal sign, in the order in which they are tried: the unmistakable ones first
DIALECTS = (*((d, ".") for d in "\t;|,"), (_SPACE, "."), ("\t", ","), (";", ","), (_SPACE, ","), (",", ","))
MISSING = frozenset({"", "-", "--", "---", "nan", "na", "n/a", "#n/a", "nat", "null", "none"})
_VALUE = re.compile(
    rf"{preamble.NUMBER.pattern}|[+-]?(inf|infinity)|" + "|".join(re.escape(word) for word in MISSING if word),
    re.IGNORECASE,
)
_QUANTITY = re.compile(rf"({preamble.NUMBER.pattern})\s*([^\W\d]\D*|°|µ\D+)")
#: digits in groups of three, which no decimal sign explains: 1,234.5 or 1,234,567 (for a point as decimal sign)
_GROUPED = re.compile(r"[+-]?\d{1,3}(([,' \u00a0\u2009\u202f]\d{3})+\.\d*|([,' \u00a0\u2009\u202f]\d{3}){2,})")
#: whole numbers in groups of three, and those that need none
_WHOLE, _SHORT = re.compile(r"[+-]?[1-9]\d{0,2}([.,]\d{3})+"), re.compile(r"[+-]?\d{1,3}")
_GROUPS = re.compile(r"(?<=\d)[,' \u00a0\u2009\u202f](?=\d{3})")
_PAIR = re.compile(
    rf"(?<!\w)([A-Za-z_]\w*)\s*[:=]\s*\"?({preamble.NUMBER.pattern})\"?(?:\s?([A-Za-z°µ%/]+)(?!\s*[\w.:=])|(?![\w.]))"
)
_BEFORE = re.compile(rf"{stamps.STAMP.pattern}|{preamble.NUMBER.pattern}")
_BEFORE_BRACKET = re.compile(r"\s+(?=[\[({<])")
_POINT = str.maketrans(".,", ",.")


def read(content: bytes, rows: tuple[int, int] | None = None) -> Table:
    """Read a text table; a column of time stamps becomes seconds from the first row on.

    rows : those to read, half-open, counted from the first of numbers; None: all.

    Raises
    ------
    Refused : no table of numbers, lines of different lengths.
    """
    whole = _unlabelled(_decoded(content))
    lines = whole.split("\n", HEAD_LINES)[:HEAD_LINES]
    delimiter, decimal, first, wide, width = _dialect(lines)
    above = _rows(lines[:first], delimiter, width)
    wide = max(wide, *(len(row) for row in above if len(row) <= 2 * wide), 0)
    if rows is None and (count := whole.count("\n")) > MANY:
        log.warning(COST.format(count=count, s=count * READ_S, gb=count * wide * READ_GB, few=MANY // 2))
    body = whole.split("\n", first)[first] if first else whole
    frame = _frame(body, delimiter, decimal, wide, first, lines[:first], rows)
    head = preamble.understood(above, width, decimal)
    table = Table(numbered=not any(head.names), constants={"dt": head.step_s} if head.step_s else {})
    if table.numbered:
        head.names = [str(j) for j in range(width)]
    columns = {j: _column(frame[j], decimal) for j in range(width) if head.names[j] or _filled(frame[j])}
    frame = _cut_texts(table, columns, frame, decimal)
    for j, column in columns.items():
        if column.values is None:
            columns[j] = _column(frame[j], decimal, ODD)
    _shift(head, columns, width)
    for j, column in columns.items():
        column.unit = head.units[j] or column.unit
        column.clock = head.names[head.clocks[j]] if head.clocks[j] >= 0 else ""
        name = head.names[j] or str(j)
        table.add(heads.bare(name) if column.unit == "s" and not head.units[j] else name, column)
    _follow_on(table)
    for name in head.spare:  # more names than columns
        table.add(name, Column(np.full(table.rows, np.nan), unusable=EMPTY))
    return table


def _frame(
    body: str, delimiter: str, decimal: str, wide: int, first: int, above: list[str], rows: tuple[int, int] | None
) -> pd.DataFrame:
    comment = "#" if any("#" in line for line in above) else None
    start, stop = rows or (0, None)
    try:
        return pd.read_csv(
            io.StringIO(body), sep=delimiter, decimal=decimal, header=None, names=range(wide), index_col=False,
            comment=comment, low_memory=False, skipinitialspace=delimiter != "\t", skiprows=start,
            nrows=None if stop is None else stop - start,
        )  # fmt: skip
    except pd.errors.ParserError as error:
        reason = str(error).split("C error: ")[-1].strip()
        raise Refused(f"has lines of different lengths ({reason}; lines counted from line {first + 1})") from error


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
    odd = sum(1 for sign in whole[:4096] if not (sign.isprintable() or sign in "\t\r\n\f\u00a0\u2009\u202f"))
    if odd:
        raise Refused("is not a recording that can be read: it is neither text nor a known binary format")
    return whole.replace("\r\n", "\n").replace("\r", "\n")


def _unlabelled(whole: str) -> str:
    """The text with the names of its values in a head, where each value has its own before it: ``t:0.1,u=2 V``.

    What stands before the first name is the time, if it is a number or a stamp, also before an arrow.
    """
    lines = whole.split("\n", HEAD_LINES)[:HEAD_LINES]
    if 2 * sum(" -> " in line for line in lines) > len(lines):
        return whole.replace(" -> ", "," if "," in lines[-1] else "\t" if "\t" in lines[-1] else " ")
    found = [pairs for line in lines if len(pairs := _PAIR.findall(line)) > 1]
    if 2 * len(found) < len(lines) or not found:
        return whole
    names = [name for name, *_ in found[-1]]
    heads_ = [f"{name} [{unit}]" if units.find(unit) else name for name, *_, unit in found[-1]]
    timed = not any(map(heads.is_time, names))
    rows = [",".join(["t", *heads_] if timed else heads_)]
    for line in whole.split("\n"):
        pairs = _PAIR.findall(line)
        if [name for name, *_ in pairs] == names:
            before = _BEFORE.search(line[: line.index(names[0])]) if timed else None
            rows.append(
                ",".join([*([before[0] if before else ""] if timed else []), *(value for _, value, *_ in pairs)])
            )
    return "\n".join(rows)


def _fields(line: str, delimiter: str) -> list[str]:
    if delimiter == _SPACE:
        fields = line.split()
    elif '"' in line:  # a quoted head may hold the delimiter
        fields = next(csv.reader([line], delimiter=delimiter), [])
    else:
        fields = line.split(delimiter)
    return [field.strip().strip("\"'").strip() for field in fields]


def _is_number(field: str, decimal: str) -> bool:
    if decimal == ",":
        field = field.translate(_POINT)
    said = _QUANTITY.fullmatch(field)  # 3.2 V
    unit = units.find(said.groups()[-1]) if said else None
    return unit is not None or _VALUE.fullmatch(field) is not None or _GROUPED.fullmatch(field) is not None


def _skipped(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith(COMMENTS)


def _dialect(lines: list[str]) -> tuple[str, str, int, int, int]:
    """Delimiter, decimal sign, the index of the first line of numbers, and the number of columns: of all, and up to the
    last one that holds something.

    Columns of numbers and of time stamps are those that hold them in most lines; there may be texts beside them.
    """
    best: tuple[int, str, str, int, int, int] | None = None
    for delimiter, decimal in DIALECTS:
        split = {k: _fields(line, delimiter) for k, line in enumerate(lines) if not _skipped(line)}
        common = Counter(len(fields) for fields in split.values() if len(fields) > 1).most_common(1)
        width = common[0][0] if common else 0
        rows = [fields for fields in split.values() if len(fields) == width]
        columns = [[fields[j] for fields in rows if fields[j]] for j in range(width)]
        kinds = [_kind(filled, decimal) if len(filled) > FEW * len(rows) else "" for filled in columns]
        good = [j for j, kind in enumerate(kinds) if kind in (NUMBER, STAMP)]
        score = len(good) - kinds.count(TEXT)
        if len(good) < 2 or NUMBER not in kinds or (best is not None and score <= best[0]):
            continue
        keyed = kinds[0] == "" and 1 in good  # a key there has its value among the numbers
        rest = {k: fields for k, fields in split.items() if not (keyed and fields[0])}
        begins = ((k, _begins(fields, good, width, decimal)) for k, fields in rest.items())
        first = next((k for (k, one), (_, next_one) in pairwise(begins) if one and next_one), None)
        if first is not None:
            sign = decimal.translate(_POINT) if _groups_whole(columns, decimal) else decimal
            best = (score, delimiter, sign, first, width, 1 + max(j for j in range(width) if columns[j]))
    if best is None:
        full = [line for line in lines if not _skipped(line)]
        alone = len(full) <= 2 and any(sum(_is_number(f, ".") for f in _fields(line, d)) > 1
                                       for line in full for d, _ in DIALECTS)  # fmt: skip
        raise Refused("holds one row of numbers" if alone else "holds no table of numbers with at least two columns")
    return best[1:]


def _begins(fields: list[str], good: list[int], width: int, decimal: str) -> bool:
    """Whether a line is the first of the numbers: two or more of them, and nothing else in their columns."""
    filled = [fields[j] for j in good if j < len(fields) and fields[j].lower() not in MISSING]
    numbers = sum(_kind([text], decimal) in (NUMBER, STAMP) or _WHOLE.fullmatch(text) is not None for text in filled)
    return width - 1 <= len(fields) <= width and numbers == len(filled) and numbers > 1


def _groups_whole(columns: list[list[str]], sign: str) -> bool:
    """Whether what looks like a decimal sign groups the digits of whole numbers: 995, 1,000, 1,005."""
    texts = [field for column in columns for field in column if sign in field]
    short = any(_SHORT.fullmatch(field) for column in columns if any(sign in f for f in column) for field in column)
    return bool(texts) and short and all(_WHOLE.fullmatch(field) for field in texts)


def _kind(fields: list[str], decimal: str) -> str:
    """What most of the fields are."""
    grouped = _groups_whole([fields], decimal.translate(_POINT))
    if 2 * sum(_is_number(f, decimal) or (grouped and _WHOLE.fullmatch(f) is not None) for f in fields) > len(fields):
        return NUMBER
    return STAMP if 2 * sum(stamps.STAMP.fullmatch(field) is not None for field in fields) > len(fields) else TEXT


def _rows(lines: list[str], delimiter: str, width: int) -> list[list[str]]:
    """The fields of the lines above the numbers; a commented head may have blanks or commas where those have tabs."""
    rows = []
    for line in lines:
        bare = line.strip() if delimiter == _SPACE else line.strip(" ")
        for sign in COMMENTS:
            bare = bare.removeprefix(sign).strip() if bare.startswith(sign) else bare
        joined = _BEFORE_BRACKET.sub("", bare)  # t [s] is one field
        splits = [_fields(joined if delimiter == _SPACE else bare, delimiter)]
        if bare != line.strip() and len(splits[0]) < width - 1:
            splits += [_fields(joined, _SPACE), _fields(bare, ",")]
        if bare.strip("-=+|:_ \t,;"):  # more than a line that is drawn
            rows.append(next((fields for fields in splits if 0 <= width - len(fields) <= 1), splits[0]))
    return rows


def _filled(column: pd.Series) -> bool:
    return bool(column.notna().any())


def _column(column: pd.Series, decimal: str, odd: float = 0.0) -> Column:
    """A column of numbers or stamps; else a phrase says what it holds instead. odd : share that may be texts."""
    if not _filled(column):
        return Column(np.full(len(column), np.nan), unusable=EMPTY)
    if column.dtype != object and pd.api.types.is_numeric_dtype(column):
        if pd.api.types.is_integer_dtype(column) and abs(int(column.iloc[0])) > CLOCK_MIN:
            return Column((column - column.iloc[0]).to_numpy(dtype=float), since_1970(float(column.iloc[0])))
        return Column(column.to_numpy(dtype=float))
    clock = stamps.seconds(column)
    if clock is not None:
        return Column(clock, "s")
    numbers, bad = _numbers(column, decimal)
    if not len(bad):
        return Column(numbers)
    quantities = _quantities(column, decimal)
    if quantities is not None:
        return quantities
    times = f"{len(bad)} time{'s' if len(bad) > 1 else ''}"
    why = f"holds text ({str(column.iloc[bad[0]])[:30]!r}) in row {bad[0] + 1} of the numbers, {times}"
    if len(bad) <= odd * len(column):
        return Column(numbers, unusable=why)
    return Column(unusable=why, labels=column.astype("string").str.strip() if 2 * len(bad) > len(column) else None)


def _numbers(column: pd.Series, decimal: str) -> tuple[Floats, np.ndarray]:
    """The numbers of a column of texts, and which rows hold none."""
    strings = column.astype("string").str.strip()
    if decimal == ",":
        strings = strings.str.translate(_POINT)
    missing = strings.isna() | strings.str.lower().isin(MISSING)
    numbers = pd.to_numeric(strings, errors="coerce")
    odd = strings[(numbers.isna() & ~missing).to_numpy(dtype=bool)]
    if len(odd):  # 1,234.5; 1.5D-3 as Fortran writes it
        plain = odd.str.replace(_GROUPS, "", regex=True).str.replace(r"(?<=\d|\.)[dD](?=[+-]?\d)", "e", regex=True)
        numbers = numbers.fillna(pd.to_numeric(plain, errors="coerce"))
    bad = np.flatnonzero((numbers.isna() & ~missing).to_numpy(dtype=bool))
    return numbers.to_numpy(dtype=float, na_value=np.nan), bad


def _quantities(column: pd.Series, decimal: str) -> Column | None:
    """A column of numbers that have their unit behind them, in the unit of the first: 900 mV, 1.1 V; else None."""
    parts = column.astype("string").str.extract(r"^\s*(.*?[\d.,])\s*([^\d\s.,].*?)\s*$")
    factors = {text: units.find(text) for text in parts[1].dropna().unique()}
    kinds = {unit.si if unit else "" for unit in factors.values()}
    if len(kinds) != 1 or "" in kinds or parts[1].notna().sum() < column.notna().sum():
        return None
    first = next(iter(factors))
    numbers, bad = _numbers(parts[0], decimal)
    per = parts[1].map({text: units.per_si(first) * unit.factor for text, unit in factors.items() if unit})
    return None if len(bad) else Column(numbers * per.to_numpy(dtype=float, na_value=np.nan), first)


def _cut_texts(table: Table, columns: dict[int, Column], frame: pd.DataFrame, decimal: str) -> pd.DataFrame:
    """The rows without lines of text between or below the numbers; where they stand, the log may have begun anew.

    They are known by the first column that holds numbers otherwise.
    """
    texts = {j: _numbers(frame[j], decimal) for j, column in columns.items() if column.values is None}
    mostly = [j for j, column in columns.items() if column.unusable != EMPTY
              and (j not in texts or 2 * np.isfinite(texts[j][0]).sum() > len(frame))]  # fmt: skip
    if not mostly or mostly[0] not in texts:
        return frame
    lines, odd = np.zeros(len(frame), dtype=bool), np.zeros(len(frame), dtype=bool)
    lines[texts[mostly[0]][1]] = True
    for _, bad in texts.values():
        odd[bad] |= 2 * len(bad) < len(frame)
    for start, stop in runs(odd):  # a head in between holds numbers as well
        lines[start:stop] |= lines[start:stop].any()
    keep = ~lines
    frame = frame[keep].reset_index(drop=True)
    for j, column in columns.items():
        if column.unusable != EMPTY:
            columns[j] = _column(frame[j], decimal)
    count = int(lines.sum())
    table.starts = tuple(np.unique((np.cumsum(keep))[lines]).tolist())
    table.notes.append(f"{count} line{'s' if count > 1 else ''} of text between or below the numbers left out.")
    return frame


def _follow_on(table: Table) -> None:
    """Let a part of a log whose clock began anew follow on the one before, after a gap.

    A clock begins anew where it goes back behind a line of text, or to its first value. A counter runs over at once.
    """
    clocks = {column.clock for column in table.columns.values()}
    timed = [name for name, c in table.columns.items() if c.values is not None and c.unusable != EMPTY
             and (name in clocks or heads.is_time(name))]  # fmt: skip
    if table.starts and "dt" in table.constants and not timed:
        parts = np.searchsorted(table.starts, np.arange(table.rows), "right") - (table.starts[0] == 0)
        table.add("t", Column(table.constants["dt"] * (np.arange(table.rows) + PAUSE * parts), "s"))
    alone = all(column.labels is None for column in table.columns.values())  # no signal behind another one
    for name in timed:
        raw = table.columns[name].values
        assert raw is not None
        t = table.columns[name].values = raw.copy()
        steps = np.diff(raw)
        usual = float(np.nanmedian(np.abs(steps))) if len(steps) else 0.0
        with np.errstate(over="ignore"):
            near = np.abs(raw - raw[:1]) <= 2.0 * usual
        for k in np.flatnonzero(steps < 0.0) + 1:
            over = [size for size in COUNTERS if abs(steps[k - 1] + size - usual) < OVER_STEPS * usual]
            if over:  # it ran over
                t[k:] += over[0]
            elif k in table.starts or (alone and -steps[k - 1] > PAUSE * usual and near[k]):
                t[k:] += t[k - 1] - t[k] + PAUSE * usual
                table.notes.append(f"{name} begins anew in row {k + 1} of the numbers: a part of its own.")


def _shift(head: Preamble, columns: dict[int, Column], width: int) -> None:
    """Name a first column without a name (a table of R, of pandas): it counts the rows, or it is the time."""
    values = columns[0].values if 0 in columns else None
    if values is not None and not head.names[0] and any(head.names) and not any(map(heads.is_time, head.names)):
        steps = np.diff(values)
        head.names[0] = heads.TIME if len(steps) and np.all(steps >= 0.0) and not np.all(steps == 1.0) else ""
    if head.names[-1] or width - 1 not in columns or columns[width - 1].unusable == EMPTY or values is None:
        return
    if len(values) > 1 and np.array_equal(values, values[0] + np.arange(len(values))) and values[0] in (0.0, 1.0):
        head.names, head.units = ["row", *head.names[:-1]], ["", *head.units[:-1]]
