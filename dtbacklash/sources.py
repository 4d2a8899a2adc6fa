"""Which code this is: hashes of the package's own sources and settings, and of laws that others have registered."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parent

_foreign: set[str] = set()


@cache
def _digest(parts: tuple[str, ...], foreign: frozenset[str]) -> str:
    total = hashlib.sha256()
    for part in parts:
        path = PACKAGE / part
        inside = (file for kind in ("*.py", "*.yaml", "*.mplstyle") for file in path.rglob(kind))
        for source in [path] if path.is_file() else sorted(inside):
            total.update(source.read_bytes())
    for text in sorted(foreign):
        total.update(text.encode())
    return total.hexdigest()[:16]


def digest(parts: tuple[str, ...] = (".",)) -> str:
    """Hash of these parts (files or folders) of the package, 16 hexadecimal digits: code, settings, style of figures.

    Laws from outside the package count as a part of each of them.
    """
    return _digest(parts, frozenset(_foreign))


def note_foreign(function: Callable[..., Any] | str) -> None:
    """Let a function from outside the package, or a text that stands for one, count as a part of the code."""
    if isinstance(function, str):
        _foreign.add(function)
    elif PACKAGE not in Path(inspect.getfile(function)).parents:
        _foreign.add(inspect.getsource(function))
