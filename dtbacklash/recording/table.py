"""A table as a file holds it: columns with what is said of them, before anybody asks which of them are channels."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from dtbacklash.arrays import Floats

EMPTY = "has no values"  # why an empty column holds no numbers
_NANOSECONDS = re.compile(r"(.*?)(nano_?sec(ond)?s?|nsecs?)")


@dataclass
class Column:
    """A column of numbers, or of something else.

    values : (N,) numbers; None where it holds something else. unit : as the file states it. clock : the column of its
    times; empty: that of all. unusable : why it holds no numbers ("is complex"); matters only where it is a channel.
    """

    values: Floats | None = None
    unit: str = ""
    clock: str = ""
    unusable: str = ""


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


def with_clocks(table: Table) -> Table:
    """The table with whole seconds and the nanoseconds in a column beside them made one, and equal clocks made one."""
    lower = {name.lower(): name for name in table.columns}
    for name in lower:
        found = _NANOSECONDS.fullmatch(name)
        whole = found and next(
            (lower[found[1] + s] for s in ("sec", "secs", "s", "seconds") if found[1] + s in lower), ""
        )
        if whole:
            s, ns = table.columns[whole].values, table.columns[lower[name]].values
            if s is not None and ns is not None:
                table.columns[whole] = Column(s - s[0] + 1e-9 * ns, "s")
    clocks = {c.clock: table.columns[c.clock].values for c in table.columns.values() if c.clock}
    first = next(iter(clocks), None)
    if first is None or not all(_equal(values, clocks[first]) for values in clocks.values()):
        return table
    columns = {name: column for name, column in table.columns.items() if name not in clocks}
    for column in columns.values():
        column.clock = ""
    table.columns = {"t": table.columns[first], **columns}
    return table


def _equal(one: Floats | None, other: Floats | None) -> bool:
    return one is not None and other is not None and np.array_equal(one, other, equal_nan=True)
