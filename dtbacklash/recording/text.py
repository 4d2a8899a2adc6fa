"""Text tables: :mod:`.layout` finds columns, :mod:`.preamble` reads the head, :mod:`.numerals` the numbers."""

from __future__ import annotations

import logging
import re
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.recording import heads, layout, numerals, preamble, stamps
from dtbacklash.recording.channels import runs
from dtbacklash.recording.numerals import POINT, Convention, Texts
from dtbacklash.recording.preamble import Preamble
from dtbacklash.recording.refusal import Refused
from dtbacklash.recording.table import EMPTY, Column, Table, since_1970

log = logging.getLogger(__name__)

ODD = 0.05  # of a column's rows that may hold a text in place of a number: a reading that failed
PAUSE = 100.0  # samples between two parts of a log whose clock begins anew
COUNTERS, OVER_STEPS = (2.0**16, 2.0**32), 10.0  # a counter of so many bits runs over, from one sample to the next
MANY = 2_000_000  # rows from which it is said beforehand what they cost
READ_S, READ_GB = 3e-6, 1.5e-7  # what a row takes to read, and a value in memory (measured on 10^6 rows)
COST = (
    "{count} rows: reading them takes about {s:.0f} s and {gb:.1g} GB, and a diagnosis at least twice as long; "
    "recording.rows=[0,{few}] takes fewer"
)
_PAIR_NUMBER = r"[+-]?(?:\d+(?:[.,]\d*)?|\.\d+)(?:[eEdD][+-]?\d+)?"
_PAIR = re.compile(
    rf"(?<!\w)([A-Za-z_]\w*)\s*[:=]\s*\"?({_PAIR_NUMBER})\"?(?:\s?([A-Za-z°µ%/]+)(?!\s*[\w.:=])|(?![\w.]))"
)
_BEFORE = re.compile(rf"{stamps.STAMP.pattern}|{preamble.NUMBER.pattern}")


def read(content: bytes, rows: tuple[int, int] | None = None, decimal: str = "") -> Table:
    """Read a text table; a column of time stamps becomes seconds from the first row on.

    rows : those to read, half-open, counted from the first of numbers; None: all. decimal : the decimal sign, where no
    number of the table tells.

    Raises
    ------
    Refused : no table of numbers, lines of different lengths.
    """
    whole = _unlabelled(_decoded(content))
    found = layout.find(whole)
    *lines, body = whole.split("\n", found.first)
    above = layout.rows_above(lines, found)
    wide = max(found.width, *(len(row) for row in above if len(row) <= 2 * found.width), 0)
    if rows is None and (count := whole.count("\n")) > MANY:
        log.warning(COST.format(count=count, s=count * READ_S, gb=count * wide * READ_GB, few=MANY // 2))
    if any("#" in line for line in lines):
        body = re.sub("#[^\n]*", "", body)
    texts = layout.split(body, found.delimiter, wide, found.first)
    width = 1 + max((j for j, column in enumerate(texts) if column.null_count < len(column)), default=0)
    texts = [column.slice(*((rows[0], rows[1] - rows[0]) if rows else (0,))) for column in texts[:width]]
    present = [sign for sign in ".," if sign in body and (sign != found.delimiter or '"' in body)]
    parts = [numerals.without_units(column) for column in texts]
    convention = numerals.decide([numbers for numbers, _ in parts if not _stamped(numbers)], present, decimal)
    head = preamble.understood(above, width, convention.decimal)
    table = Table(numbered=not any(head.names), constants={"dt": head.step_s} if head.step_s else {})
    last = above[-1] if above else []
    headed = len(last) == width and not any(map(preamble.NUMBER.fullmatch, last))  # each column has its head
    if found.delimiter == "," and not headed:
        _check_commas(texts, [name for name in (*head.names, *head.spare) if name])
    if table.numbered:
        head.names = [str(j) for j in range(width)]
    columns = {j: _column(c, convention) for j, c in enumerate(texts) if head.names[j] or c.null_count < len(c)}
    texts = _cut_texts(table, columns, texts, convention)
    for j, column in columns.items():
        if column.values is None:
            columns[j] = _column(texts[j], convention, ODD)
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
    lines = whole.split("\n", layout.HEAD_LINES)[: layout.HEAD_LINES]
    if 2 * sum(" -> " in line for line in lines) > len(lines):
        return whole.replace(" -> ", "," if "," in lines[-1] else "\t" if "\t" in lines[-1] else " ")
    found = [pairs for line in lines if len(pairs := _PAIR.findall(line)) > 1]
    if 2 * len(found) < len(lines) or not found:
        return whole
    names = [name for name, *_ in found[-1]]
    heads_ = [f"{name} [{unit}]" if units.find(unit) else name for name, *_, unit in found[-1]]
    timed = not any(map(heads.is_time, names))
    rows = [";".join(["t", *heads_] if timed else heads_)]
    for line in whole.split("\n"):
        pairs = _PAIR.findall(line)
        if [name for name, *_ in pairs] == names:
            before = _BEFORE.search(line[: line.index(names[0])]) if timed else None
            rows.append(
                ";".join([*([before[0] if before else ""] if timed else []), *(value for _, value, *_ in pairs)])
            )
    return "\n".join(rows)


def _stamped(texts: Texts) -> bool:
    """Whether a column begins with a time stamp."""
    return stamps.STAMP.fullmatch(numerals.first_text(texts).strip()) is not None


def _check_commas(texts: list[Texts], names: list[str]) -> None:
    """Refuse commas of numbers between commas of columns, 0,001,1,5 or 0,1,257.3 below t,u: more columns than names.

    Raises
    ------
    Refused : so it may be.
    """
    full = [column for column in texts if column.null_count < len(column)]
    if len(names) >= len(full):
        return
    whole = sum(int(numerals.proofs(column, POINT).sum()) for column in full) <= numerals.SLIPS * len(full[0])
    zeros = any(pc.any(pc.match_substring_regex(column, r"^\s*[+-]?0\d+\s*$")).as_py() for column in full)
    longest = [column.filter(pc.is_valid(full[-1])) for column in full]
    groups = np.any([_parts_of_one(left, right) for left, right in pairwise(longest)], axis=0).all()
    if (whole and (zeros or names)) or (groups and names):
        kind = "whole numbers" if whole else "numbers"
        raise Refused(
            f"has {len(full)} columns of {kind} below {len(names) or 'no'} names: a comma in a number cannot be "
            "told from a comma between columns; part them by semicolons, or put the numbers in quotes"
        )


def _parts_of_one(left: Texts, right: Texts) -> np.ndarray:
    """(N,) where two columns may hold the parts of a number like 1,257.3: a whole number, and three digits next."""
    parts = pc.and_(
        pc.match_substring_regex(left, r"^[+-]?[1-9]\d{0,2}$"), pc.match_substring_regex(right, r"^\d{3}(\.\d*)?$")
    )
    return np.asarray(pc.fill_null(parts, False).to_numpy(), dtype=bool)


def _column(texts: Texts, convention: Convention, odd: float = 0.0) -> Column:
    """A column of numbers or stamps; else a phrase says what it holds instead. odd : share that may be texts."""
    if texts.null_count == len(texts):
        return Column(np.full(len(texts), np.nan), unusable=EMPTY)
    if (counts := numerals.whole_numbers(texts)) is not None:
        return Column(counts, since_1970(float(texts[0].as_py())))
    if _stamped(texts) and (clock := stamps.seconds(texts.to_pandas())) is not None:
        return Column(clock, "s")
    numbers, units_behind = numerals.without_units(texts)
    values, bad, why = numerals.parse(numbers, convention)
    if why:
        return Column(unusable=why)
    if not len(bad):
        return Column(values) if units_behind is None else _quantities(values, units_behind, texts)
    times = f"{len(bad)} time{'s' if len(bad) > 1 else ''}"
    why = f"holds text ({texts[int(bad[0])].as_py().strip()[:30]!r}) in row {bad[0] + 1} of the numbers, {times}"
    if len(bad) <= odd * len(values):
        return Column(values, unusable=why)
    return Column(unusable=why, labels=texts.to_pandas().str.strip() if 2 * len(bad) > len(values) else None)


def _quantities(values: Floats, behind: Texts, texts: Texts) -> Column:
    """A column of numbers that have their unit behind them, in the unit of the first: 900 mV, 1.1 V."""
    names = behind.combine_chunks().dictionary_encode()
    found = [units.find(text) for text in names.dictionary.to_pylist()]
    if None in found or len({unit.si for unit in found if unit}) != 1:
        return Column(
            unusable=f"holds text ({numerals.first_text(texts)[:30]!r})", labels=texts.to_pandas().str.strip()
        )
    own = names.dictionary[0].as_py()
    per = np.array([units.per_si(own) * unit.factor for unit in found if unit])
    return Column(values * per[np.asarray(names.indices.fill_null(0))], own)


def _cut_texts(table: Table, columns: dict[int, Column], texts: list[Texts], convention: Convention) -> list[Texts]:
    """The rows without lines of text between or below the numbers; where they stand, the log may have begun anew.

    They are known by the first column that holds numbers or stamps otherwise.
    """
    count = len(texts[0])
    odd_ones = {j: _odd(texts[j], convention) for j, column in columns.items() if column.values is None}
    mostly = [j for j, column in columns.items() if column.unusable != EMPTY
              and (j not in odd_ones or 2 * odd_ones[j][0].sum() > count)]  # fmt: skip
    _, texts_in, why = odd_ones.get(mostly[0] if mostly else -1, (None, (), ""))
    if why or not len(texts_in):  # a number that contradicts the others is no text
        return texts
    lines, odd = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    lines[texts_in] = True
    for _, bad, _ in odd_ones.values():
        odd[bad] |= 2 * len(bad) < count
    for start, stop in runs(odd):  # a head in between holds numbers as well
        lines[start:stop] |= lines[start:stop].any()
    keep = ~lines
    texts = [column.filter(pa.array(keep)) for column in texts]
    for j, column in columns.items():
        if column.unusable != EMPTY:
            columns[j] = _column(texts[j], convention)
    count = int(lines.sum())
    table.starts = tuple(np.unique((np.cumsum(keep))[lines]).tolist())
    table.notes.append(f"{count} line{'s' if count > 1 else ''} of text between or below the numbers left out.")
    return texts


def _odd(texts: Texts, convention: Convention) -> tuple[np.ndarray, np.ndarray, str]:
    """A mask of the numbers or stamps in a column, the rows of other texts, and why the column cannot be read."""
    if _stamped(texts):
        read = np.array([stamps.STAMP.fullmatch((text or "").strip()) is not None for text in texts.to_pylist()])
        return read, np.flatnonzero(~read), ""
    values, rows, why = numerals.parse(texts, convention)
    return np.isfinite(values), rows, why


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
