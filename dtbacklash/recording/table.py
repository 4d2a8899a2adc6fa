"""A table as a file holds it: columns with what is said of them, before anybody asks which of them are channels."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from dtbacklash import units
from dtbacklash.arrays import Floats
from dtbacklash.recording import heads
from dtbacklash.recording.stamps import DAY_S

if TYPE_CHECKING:
    import pandas as pd

LABELS_MAX = 100  # different signals in a log that has a row for each message
_UNIT = re.compile(r"_?(units?|einheit)", re.IGNORECASE)
_LABEL = re.compile(r".*(name|signal|topic|field|channel|variable|tag|key|message|id)", re.IGNORECASE)
_VALUE = re.compile(r"_?(value|wert|data|phys(ical)?[ _]?value)s?\b.*", re.IGNORECASE)
_CLOCK_OF = re.compile(
    r"(?:time|t|zeit|timestamp)[ _.-]+(?:of )?(.+)|(.+?)[ _.-]+(?:time|t|zeit|timestamp)", re.IGNORECASE
)
#: seconds since 1970 in the years 2001 to 2096
SINCE_1970 = (1e9, 4e9)
#: days since 1900 and since 0 in the years 2001 to 2096; a clock in s that began so long ago has longer steps
DAYS, STEP_MAX_DAYS = ((36892.0, 71955.0), (730852.0, 765914.0)), 1e-5
EMPTY = "has no values"  # why an empty column holds no numbers
#: fractions of a second, behind what stands before the seconds as well
_FRACTION = re.compile(r"(.*?)((nano|micro|milli)_?sec(?:ond)?s?|[nmu]secs?|ms|us|ns)")


@dataclass
class Column:
    """A column of numbers, or of something else.

    values : (N,) numbers; None where it holds something else. unit : as the file states it. clock : the column of its
    times; empty: that of all. unusable : why it holds no numbers, or not all ("is complex"); matters only in a channel.
    labels : (N,) texts of a column of texts.
    """

    values: Floats | None = None
    unit: str = ""
    clock: str = ""
    unusable: str = ""
    labels: pd.Series | None = None


@dataclass
class Table:
    """Columns of one length, single numbers, what had to be said.

    starts : rows at which the log began anew, its clock maybe as well. numbered : the file has no names, and the
    columns are called by their numbers from 0.
    """

    columns: dict[str, Column] = field(default_factory=dict)
    constants: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    starts: tuple[int, ...] = ()
    numbered: bool = False

    @property
    def rows(self) -> int:
        """Number of rows."""
        return next((len(c.values) for c in self.columns.values() if c.values is not None), 0)

    def cut(self, start: int, stop: int) -> Table:
        """The table with some of its rows."""
        for column in self.columns.values():
            column.values = None if column.values is None else column.values[start:stop]
        return self

    def add(self, name: str, column: Column) -> None:
        """Put a column beside the others; where one of its name is there, it gets a number behind its name."""
        again = sum(1 for other in self.columns if other == name or other.startswith(f"{name} ("))
        self.columns[f"{name} ({again + 1})" if again else name] = column


def since_1970(value: float) -> str:
    """The unit in which a number counts the time since 1970, where it obviously does; or empty."""
    sizes = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    return next((unit for unit, size in sizes.items() if SINCE_1970[0] < value * size < SINCE_1970[1]), "")


def with_clocks(table: Table) -> Table:
    """The table with its signals and their times in columns of their own.

    A signal that a row names becomes a column; whole seconds and their fraction in a column beside them are one, as are
    equal clocks; ``u_time`` is the clock of ``u``.
    """
    _spread(table)
    _add_fractions(table)
    for name, column in table.columns.items():
        of = _CLOCK_OF.fullmatch(name)
        signal = table.columns.get((of[1] or of[2]) if of else "")
        if signal is not None and signal is not column and column.values is not None:
            signal.clock = name
        _date(name, column)
    clocks = {c.clock: table.columns[c.clock].values for c in table.columns.values() if c.clock}
    first = next(iter(clocks), None)
    if first is None or not all(_equal(values, clocks[first]) for values in clocks.values()):
        return table
    columns = {name: column for name, column in table.columns.items() if name not in clocks}
    for column in columns.values():
        column.clock = ""
    table.columns = {"t": table.columns[first], **columns}
    return table


def _add_fractions(table: Table) -> None:
    """Put whole seconds and whole parts of one together: ``sec`` and ``nanosec``, a time stamp and ``ms``."""
    for name, column in list(table.columns.items()):
        found, part = _FRACTION.fullmatch(name.lower()), column.values
        if not found or part is None:
            continue
        own, per = [found[1] + end for end in ("sec", "secs", "s", "seconds")], units.UNITS[found[2][0] + "s"].factor
        for other, c in table.columns.items():
            t = c.values if other.lower() in own or (not found[1] and c.unit == "s" and heads.is_time(other)) else None
            if (
                t is not None
                and not np.any(t % 1.0)
                and np.all((part % 1.0 == 0.0) & (part >= 0.0) & (part * per < 1.0))
            ):
                c.values, c.unit = t - t[0] + per * part, "s"
                del table.columns[name]
                break


def _date(name: str, column: Column) -> None:
    """Find the unit of times that count from a date: since 1970, or in days since 1900 or 0 as spreadsheets do."""
    t = column.values
    if column.unit or t is None or len(t) < 2 or not heads.is_time(name) or any(h.unit for h in heads.readings(name)):
        return
    column.unit = heads.unit_in_name(name) or since_1970(float(t[0]))
    if any(low < t[0] < high for low, high in DAYS) and np.nanmax(np.abs(np.diff(t))) < STEP_MAX_DAYS:
        column.values, column.unit = DAY_S * (t - t[0]), "s"


def _spread(table: Table) -> None:
    """Give each signal that a column of texts names a column, where one column holds the values of all."""
    values = [c.values for name, c in table.columns.items() if _VALUE.fullmatch(name) and c.values is not None]
    count = len(table.columns)
    for name, column in list(table.columns.items()) if len(values) == 1 else ():
        if column.labels is None or not _LABEL.fullmatch(name):
            continue
        import pandas as pd

        codes, labels = pd.factorize(column.labels)
        units = next((c.labels for n, c in table.columns.items() if _UNIT.fullmatch(n) and c.labels is not None), None)
        for code, label in enumerate(labels) if 1 < len(labels) <= LABELS_MAX else ():
            unit = "" if units is None else str(units[codes == code].fillna("").iloc[0])
            table.columns.setdefault(str(label), Column(np.where(codes == code, values[0], np.nan), unit))
    t = next((c.values for name, c in table.columns.items() if heads.is_time(name) and c.values is not None), None)
    if t is not None and np.any(np.diff(t) < 0.0) and len(table.columns) > count:  # one signal after the other
        order = np.argsort(t, kind="stable")
        for column in table.columns.values():
            column.values = None if column.values is None else column.values[order]


def _equal(one: Floats | None, other: Floats | None) -> bool:
    return one is not None and other is not None and np.array_equal(one, other, equal_nan=True)
