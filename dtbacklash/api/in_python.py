"""Errors of Python's functions in Python's words: where a message names a setting of the command line, the argument."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from dtbacklash.errors import UserError

#: ``recording.units.q3=mm``, ``recording.rows=[0,500]``: a setting of the recording, a name within it, its value
_SETTING = re.compile(r"\brecording\.(\w+)(?:\.(\w+))?=(\[[^\]]*\]|[^\s;,]*\w)")
#: a mapping in a line, and how the command line takes it
_MAPPING = re.compile(r"MAPPING\.yaml: \{files: \[FILE\], time: (\S+), channels: \{(.*?)\}\}, and give \S+")


@contextmanager
def speaks_python() -> Iterator[None]:
    """Let errors that are raised inside name the arguments of Python."""
    try:
        yield
    except UserError as error:
        _, argument, name = [*error.key.split("."), "", ""][:3] if error.key.startswith("recording.") else ("",) * 3
        error.key = f"{argument}[{name!r}]" if name else argument or error.key
        error.allowed = in_python(error.allowed)
        raise


def in_python(text: str) -> str:
    """Return a message with the arguments of Python in place of the settings of the command line.

    >>> in_python("give recording.units.q3=mm or recording.trust_units=true if they are right")
    "give units={'q3': 'mm'} or trust_units=True if they are right"
    >>> line = "MAPPING.yaml: {files: [FILE], time: 0, channels: {u: 1, q: x2}}, and give recording=MAPPING.yaml"
    >>> in_python(f"write {line}")
    "write frame.rename(columns={0: 't', 1: 'u', 'x2': 'q'}), and give this DataFrame"
    """
    return _MAPPING.sub(_renamed, _SETTING.sub(_argument, text))


def _argument(found: re.Match[str]) -> str:
    setting, name, value = found.groups()
    literal = _literal(value) if value != value.upper() or value.startswith("[") else value  # SECONDS, FILE stay
    return f"{setting}={{{name!r}: {literal}}}" if name else f"{setting}={literal}"


def _literal(word: str) -> str:
    plain = word in ("true", "false") or re.fullmatch(r"-?[\d.]+|\[.*\]", word)
    return word.capitalize() if word in ("true", "false") else word if plain else repr(word)


def _renamed(found: re.Match[str]) -> str:
    pairs = [one.split(": ") for one in [f"t: {found[1]}", *found[2].split(", ")]]
    columns = ", ".join(f"{_literal(column)}: {name!r}" for name, column in pairs)
    return f"frame.rename(columns={{{columns}}}), and give this DataFrame"
