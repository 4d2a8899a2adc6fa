"""Which code this is: hashes of the package's own sources and settings, and of laws that others have registered."""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parent
ROOT = PACKAGE.name
#: an import from the package, with the names in or without parentheses; what only a type checker sees is none
IMPORT = re.compile(rf"^[ \t]*(?:from ({ROOT}[\w.]*) import (\([^)]*\)|.*)|import ({ROOT}[\w.]*))", re.MULTILINE)
#: a package that holds such files compiles them
C_SOURCES = ("*.c", "*.h")
FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:(?:[ \t].*)?\n)+", re.MULTILINE)

_foreign: set[str] = set()


def imported(module: str) -> list[Path]:
    """The files of a module of the package and of all that it imports, directly or not, within functions too.

    Not ``dtbacklash/__init__.py``, which names all that users import, and through which nothing in the package goes.
    """
    names = [module]
    files: dict[Path, None] = {}
    for name in names:  # which grows meanwhile
        path = PACKAGE.joinpath(*name.split(".")[1:])
        file = next((one for one in (path.with_suffix(".py"), path / "__init__.py") if one.is_file()), None)
        if file is None or path == PACKAGE or file in files:
            continue
        files[file] = None
        files |= dict.fromkeys(c for kind in C_SOURCES if path.is_dir() for c in path.glob(kind))
        names.append(name.rpartition(".")[0])  # a package's own code runs before that of its modules
        names += _names(file)
    return sorted(files)


@cache
def _names(file: Path) -> list[str]:
    """The names that a file imports from the package: modules, and what may be one."""
    names: list[str] = []
    for source, inside, alone in IMPORT.findall(FOR_TYPES.sub("", file.read_text(encoding="utf-8"))):
        names += [source or alone, *(f"{source}.{one}" for one in re.findall(r"\w+", inside))]
    return names


@cache
def _digest(parts: tuple[str, ...], foreign: frozenset[str]) -> str:
    total = hashlib.sha256()
    for part in parts:
        path = PACKAGE / part
        inside = sorted(file for kind in ("*.py", "*.yaml", "*.mplstyle", *C_SOURCES) for file in path.rglob(kind))
        for source in imported(part) if part.startswith(f"{ROOT}.") else [path] if path.is_file() else inside:
            total.update(source.read_bytes())
    for text in sorted(foreign):
        total.update(text.encode())
    return total.hexdigest()[:16]


def digest(parts: tuple[str, ...] = (".",)) -> str:
    """Hash of these parts of the package, 16 hexadecimal digits: code, settings, style of figures.

    A part is a file, a folder, or a module (``dtbacklash.prove.conceal``) with all that it imports. Laws from outside
    the package count as a part of each of them.
    """
    return _digest(parts, frozenset(_foreign))


def note_foreign(text: str) -> None:
    """Let a law from outside the package, in words, count as a part of the code."""
    _foreign.add(text)
