"""Markdown, for the pages of the docs that are made from the code and for the tables beside a report."""

from __future__ import annotations

from collections.abc import Iterable


def between(text: str, begin: str, end: str, new: str) -> str:
    """A page with what stands between two marks in it replaced."""
    head, rest = text.split(begin)
    return f"{head}{begin}\n\n{new}\n{end}{rest.split(end)[1]}"


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table; a bar inside a cell is escaped."""
    lines = [list(heads)]
    lines.append(["---"] * len(lines[0]))
    lines += [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines) + "\n"
