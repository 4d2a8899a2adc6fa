"""Blocks on the terminal: at most 100 columns wide, plain text where no terminal is."""

from __future__ import annotations

import sys
from io import StringIO
from typing import TextIO

from rich import box
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from dtbacklash.report.components import blocks

WIDTH = 100


def show(*renderables: RenderableType, file: TextIO | None = None) -> None:
    """Print to `file` (default: stdout); at most 100 columns; what its encoding cannot say becomes "?"."""
    target = file or sys.stdout
    terminal = target.isatty()
    width = min(Console(file=target).width, WIDTH) if terminal else WIDTH
    buffer = StringIO()
    console = Console(file=buffer, width=width, force_terminal=terminal, highlight=False)
    for renderable in renderables:
        console.print(renderable)
    encoding = getattr(target, "encoding", None) or "utf-8"
    text = "\n".join(line.rstrip() for line in buffer.getvalue().splitlines())
    print(text.encode(encoding, "replace").decode(encoding), file=target)


def of(block: blocks.Table) -> Group:
    """A block's table for the terminal, below its title."""
    # ASCII lines: a log file and an old terminal show them as well
    table = Table(box=box.ASCII2, header_style="bold", show_edge=False, pad_edge=False)
    for head in block.heads:
        right = head.endswith("#")
        table.add_column(Text(head.removesuffix("#")), justify="right" if right else "left", overflow="fold")
    for row in block.rows:
        table.add_row(*(Text(str(cell).replace("`", "")) for cell in row))
    return Group(Text(block.title, style="bold"), table)
