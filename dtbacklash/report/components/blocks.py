"""A result as blocks: titles, sentences, tables, figures. A page and a terminal show the same blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias


@dataclass(frozen=True)
class Table:
    """heads : texts; that of a column of numbers ends in ``#``. rows : cells; a cell of several lines has line breaks.
    marks : row -> a class of its own, such as ``chosen``. title : in the terminal. look : class of the table.
    """

    kind: ClassVar[str] = "table"
    heads: Sequence[str]
    rows: Sequence[Sequence[str | Link]]
    title: str = ""
    marks: dict[int, str] = field(default_factory=dict)
    look: str = ""


@dataclass(frozen=True)
class Figure:
    """A picture as a data URI. good : what to see in it. narrow : the same for a phone; empty: the same picture."""

    kind: ClassVar[str] = "figure"
    image: str
    caption: str
    good: str = ""
    title: str = ""
    narrow: str = ""


@dataclass(frozen=True)
class Code:
    """A command, or the text of a file."""

    kind: ClassVar[str] = "code"
    text: str


@dataclass(frozen=True)
class Items:
    """Sentences, each of its own."""

    kind: ClassVar[str] = "items"
    texts: Sequence[str]
    numbered: bool = False


@dataclass(frozen=True)
class Link:
    """A sentence with a link in it, or a cell that is one."""

    kind: ClassVar[str] = "link"
    before: str
    address: str
    text: str
    after: str = ""


@dataclass(frozen=True)
class Tiles:
    """The few figures to be read first: (value, what it is)."""

    kind: ClassVar[str] = "tiles"
    values: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Side:
    """Two columns, where the screen is wide enough for them."""

    kind: ClassVar[str] = "side"
    left: Sequence[Part]
    right: Sequence[Part]


@dataclass(frozen=True)
class Block:
    """A title with what stands below it. note : beside the title. folded : open it to see more than the title."""

    kind: ClassVar[str] = "block"
    title: str
    parts: Sequence[Part]
    note: str = ""
    folded: bool = False
    id: str = ""

    @property
    def empty(self) -> bool:
        """Whether there is nothing below the title."""
        return not any(shown(part) for part in self.parts)


#: a text is a paragraph; names in it stand in back-ticks
Part: TypeAlias = str | Table | Figure | Code | Items | Link | Tiles | Side | Block


def shown(part: Part) -> bool:
    """Whether a part has something to show."""
    content = {"table": "rows", "items": "texts", "figure": "image", "code": "text", "tiles": "values", "link": "text"}
    if isinstance(part, Block):
        return not part.empty
    if isinstance(part, Side):
        return any(map(shown, (*part.left, *part.right)))
    return bool(part if isinstance(part, str) else getattr(part, content[part.kind]))
