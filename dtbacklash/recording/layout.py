"""Where the numbers of a text table begin, and what parts their columns: found by looking at lines from all of it."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from itertools import pairwise
from typing import NamedTuple

import pyarrow as pa
from pyarrow import csv as arrow_csv

from dtbacklash import units
from dtbacklash.recording import preamble, stamps
from dtbacklash.recording.numerals import BLANKS, MISSING, Texts
from dtbacklash.recording.refusal import NoTable, Refused

NUMBER, STAMP, TEXT = "number", "stamp", "text"
COMMENTS = ("#", "%", "//", "*", "!")
HEAD_LINES = 400  # a preamble longer than this is not looked for; a quarter as many lines are looked at in the rest
FEW = 0.05  # of the lines with so many fields: a column that is filled in fewer decides nothing
SPACE = r"\s+"
DELIMITERS = ("\t", ";", "|", ",", SPACE)  # in the order in which they are tried: the unmistakable ones first
_VALUE = re.compile(
    rf"{preamble.NUMBER.pattern}|[+-]?(inf|infinity)|" + "|".join(re.escape(word) for word in MISSING if word),
    re.IGNORECASE,
)
_QUANTITY = re.compile(rf"({preamble.NUMBER.pattern})\s*([^\W\d]\D*|°|µ\D+)")
#: digits in groups of three, for a point as decimal sign
_GROUPED = re.compile(
    rf"[+-]?\d{{1,3}}(([,{BLANKS}]\d{{3}})+\.\d*|([,{BLANKS}]\d{{3}}){{2,}}|([{BLANKS.replace(' ', '')}]\d{{3}})+)"
)
#: the same by blanks, which part columns as well: only where the names and the numbers around it tell
_GROUPED_BY_BLANKS = re.compile(r"[+-]?\d{1,3}( \d{3})+")
_BLANKS = re.compile(r"[ \t\f]+")
_BEFORE_BRACKET = re.compile(r"\s+(?=[\[({<])")
_POINT = str.maketrans(".,", ",.")
_MISSING = sorted({form for word in MISSING for form in (word, word.upper(), word.capitalize())} | {"NaN", "NaT"})
_BLOCK = 1 << 24  # bytes that are split at once


class Layout(NamedTuple):
    """delimiter : between columns, or SPACE. first : index of the first line of numbers. width : number of columns."""

    delimiter: str
    first: int
    width: int


def find(whole: str) -> Layout:
    """Find where the numbers are.

    Columns of numbers and of time stamps are those that hold them in most lines; there may be texts beside them.

    Raises
    ------
    Refused : no table of numbers, or a column of which blanks may part either digits or numbers.
    """
    head = whole.split("\n", HEAD_LINES)[:HEAD_LINES]
    lines = [*head, *_spread(whole, sum(map(len, head)) + len(head))]
    best: tuple[int, Layout] | None = None
    unclear: dict[str, str] = {}
    for delimiter in DELIMITERS:
        split = {k: fields_of(line, delimiter) for k, line in enumerate(lines) if not _skipped(line)}
        common = Counter(len(fields) for fields in split.values() if len(fields) > 1).most_common(1)
        width = common[0][0] if common else 0
        rows = [fields for fields in split.values() if len(fields) == width]
        columns = [[fields[j] for fields in rows if fields[j]] for j in range(width)]
        clear = delimiter not in (SPACE, ",")  # parts of its fields may be no columns
        blanks = []  # whether they may part the digits of a column's numbers
        for j, filled in enumerate(columns):
            names = _names(head, delimiter, width, j) if any(map(_GROUPED_BY_BLANKS.fullmatch, filled)) else []
            known = _are_groups(filled, names)
            blanks.append(clear and known)
            if not known:
                unclear[delimiter] = _either(j, names, filled)
                if clear and names and not any(" " in name for name in names):  # one name for two numbers
                    raise Refused(unclear[delimiter])
        kinds = [
            TEXT if clear and not known else _kind(filled, known) if len(filled) > FEW * len(rows) else ""
            for filled, known in zip(columns, blanks, strict=True)
        ]  # fmt: skip
        good = [j for j, kind in enumerate(kinds) if kind in (NUMBER, STAMP)]
        score = len(good) - kinds.count(TEXT)
        if len(good) < 2 or NUMBER not in kinds or (best is not None and score <= best[0]):
            continue
        keyed = kinds[0] == "" and 1 in good  # a key there has its value among the numbers
        rest = {k: fields for k, fields in split.items() if k < len(head) and not (keyed and fields[0])}
        begins = ((k, _begins(fields, good, width, blanks)) for k, fields in rest.items())
        first = next((k for (k, one), (_, next_one) in pairwise(begins) if one and next_one), None)
        while first and _goes_on(split.get(first - 1, []), good, width):
            first -= 1
        if first is not None:
            best = score, Layout(delimiter, first, width)
            if clear and len(good) == width:  # parts of these would be numbers as well
                break
    if unclear and (best is None or best[1].delimiter in unclear):
        raise Refused(next(iter(unclear.values())) if best is None else unclear[best[1].delimiter])
    if best is None:
        full = [line for line in lines if not _skipped(line)]
        alone = len(full) <= 2 and any(
            sum(map(_is_number, fields_of(line, d))) > 1 for line in full for d in DELIMITERS
        )
        raise NoTable("holds one row of numbers" if alone else "holds no table of numbers with at least two columns")
    delimiter, first, width = best[1]
    above = fields_of(lines[first - 1], delimiter) if first else []
    if any(above[width:]) and all(map(_is_number, filter(None, above))):  # no head, but a row of numbers
        raise Refused(_lengths(width, first, len(above)))
    return best[1]


def rows_above(lines: list[str], layout: Layout) -> list[list[str]]:
    """The fields of the lines above the numbers; a commented head may have blanks or commas where those have tabs."""
    delimiter, _, width = layout
    rows = []
    for line in lines:
        bare = line.strip() if delimiter == SPACE else line.strip(" ")
        for sign in COMMENTS:
            bare = bare.removeprefix(sign).strip() if bare.startswith(sign) else bare
        joined = _BEFORE_BRACKET.sub("", bare)  # t [s] is one field
        splits = [fields_of(joined if delimiter == SPACE else bare, delimiter)]
        if bare != line.strip() and len(splits[0]) < width - 1:
            splits += [fields_of(joined, SPACE), fields_of(bare, ",")]
        if bare.strip("-=+|:_ \t,;"):  # more than a line that is drawn
            rows.append(next((fields for fields in splits if 0 <= width - len(fields) <= 1), splits[0]))
    return rows


def split(body: str, delimiter: str, width: int, first: int) -> list[Texts]:
    """The texts of ``width`` columns, null where a value is missing. first : lines above, for messages.

    Raises
    ------
    Refused : a line of numbers with more fields than the others.
    """
    if delimiter == SPACE:
        body, delimiter = _joined(body), "\t"
    try:
        return _split(body, delimiter, width)
    except pa.ArrowInvalid:
        return _split(_repaired(body, delimiter, width, first), delimiter, width)


def fields_of(line: str, delimiter: str) -> list[str]:
    """The fields of a line without blanks and quotes around them."""
    if delimiter == SPACE:
        fields = _BLANKS.split(line.strip(" \t\f"))
    elif '"' in line:  # a quoted head may hold the delimiter
        fields = next(csv.reader([line], delimiter=delimiter, skipinitialspace=delimiter != "\t"), [])
    else:
        fields = line.split(delimiter)
    return [field.strip().strip("\"'").strip() for field in fields]


def _split(body: str, delimiter: str, width: int) -> list[Texts]:
    names = [str(j) for j in range(width)]
    table = arrow_csv.read_csv(
        pa.py_buffer(body.encode()),
        arrow_csv.ReadOptions(column_names=names, use_threads=False, block_size=_BLOCK),
        arrow_csv.ParseOptions(delimiter=delimiter),
        arrow_csv.ConvertOptions(
            column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=True, null_values=_MISSING
        ),
    )
    return list(table.columns)


def _repaired(body: str, delimiter: str, width: int, first: int) -> str:
    """The lines, each with ``width`` fields: short ones filled up, empty fields and texts beyond cut off."""
    out = io.StringIO()
    writer = csv.writer(out, delimiter=delimiter, lineterminator="\n")
    for k, line in enumerate(body.split("\n")):
        if line.count(delimiter) == width - 1 and '"' not in line:
            out.write(line + "\n")
        elif line.strip():
            fields = fields_of(line, delimiter)
            if any(fields[width:]) and any(map(_is_number, fields)):
                raise Refused(_lengths(width, first + k + 1, len(fields)))
            writer.writerow([*fields, *[""] * width][:width])
    return out.getvalue()


def _lengths(width: int, line: int, fields: int) -> str:
    return f"has lines of different lengths (expected {width} fields in line {line}, saw {fields})"


def _joined(body: str) -> str:
    """Columns that any number of blanks part, with a tab between them."""
    body = f"\n{body}\n".replace("\t", " ")
    while "  " in body:
        body = body.replace("  ", " ")
    return body.replace("\n ", "\n").replace(" \n", "\n").replace(" ", "\t").strip("\n")


def _spread(whole: str, start: int) -> list[str]:
    """Lines from all of the rest of a text."""
    lines = []
    for at in range(start, len(whole), max(1, 4 * (len(whole) - start) // HEAD_LINES)):
        begin = whole.find("\n", at) + 1
        end = whole.find("\n", begin)
        if begin and end > 0:
            lines.append(whole[begin:end])
    return lines


def _skipped(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith(COMMENTS)


def _names(head: list[str], delimiter: str, width: int, column: int) -> list[str]:
    """What stands above a column, also behind the sign of a comment; a unit in brackets belongs to its name."""
    signs = "".join(COMMENTS) + " "
    above = (fields_of(_BEFORE_BRACKET.sub("", line.lstrip(signs)), delimiter) for line in head)
    texts = [fields[column] for fields in above if len(fields) == width]
    return [text for text in texts if re.search(r"[^\W\d_]", text) and not _is_number(text)]


def _are_groups(fields: list[str], names: list[str]) -> bool:
    """Whether blanks within the numbers of a column part groups of digits, and cannot part numbers.

    No name has a blank there, and some number has none, or so many groups that a name for each would be missing.
    """
    groups = {len(field.split(" ")) for field in fields if _GROUPED_BY_BLANKS.fullmatch(field)}
    single = any(" " not in field and _is_number(field) for field in fields)
    return not groups or (not any(" " in name for name in names) and (single or max(groups) > 2))


def _either(column: int, names: list[str], fields: list[str]) -> str:
    name = repr(names[-1]) if names else f"number {column + 1}"
    value = next(field for field in fields if _GROUPED_BY_BLANKS.fullmatch(field))
    return f"has a column ({name}) with {value!r}, which may be one number or several; write it without blanks"


def _begins(fields: list[str], good: list[int], width: int, blanks: list[bool]) -> bool:
    """Whether a line is the first of the numbers: two or more of them, and nothing else in their columns."""
    filled = [j for j in good if j < len(fields) and fields[j].lower() not in MISSING]
    numbers = sum(_kind([fields[j]], blanks[j]) in (NUMBER, STAMP) for j in filled)
    return width - 1 <= len(fields) <= width and numbers == len(filled) and numbers > 1


def _goes_on(fields: list[str], good: list[int], width: int) -> bool:
    """Whether a line above the first of the numbers is one of them, in which some are missing or failed."""
    filled = [j for j in good if len(fields) == width and fields[j]]
    numbers = [j for j in filled if _kind([fields[j]], blanks=True) in (NUMBER, STAMP)]
    return len(numbers) > 1 and numbers[0] == good[0]


def _kind(fields: list[str], blanks: bool) -> str:
    """What most of the fields are. blanks : may part the digits of a whole number."""
    if 2 * sum(_is_number(field, blanks) for field in fields) > len(fields):
        return NUMBER
    return STAMP if 2 * sum(stamps.STAMP.fullmatch(field) is not None for field in fields) > len(fields) else TEXT


def _is_number(field: str, blanks: bool = False) -> bool:
    """Whether a text is a number with a decimal point or comma. blanks : may part the digits of a whole number."""
    if blanks and _GROUPED_BY_BLANKS.fullmatch(field):
        return True
    for text in (field, field.translate(_POINT)):
        said = _QUANTITY.fullmatch(text)  # 3.2 V
        unit = units.find(said.groups()[-1]) if said else None
        if unit is not None or _VALUE.fullmatch(text) or _GROUPED.fullmatch(text):
            return True
    return False
