"""What a person writes for recordings: a list ``[a.csv,b.csv]``, a pattern ``data/*.csv``, or one of them."""

from __future__ import annotations

import glob
import re
from pathlib import Path

from dtbacklash.errors import UserError


def sources_of(source: str, key: str = "recording") -> list[str]:
    """The single sources that are meant by a list, a pattern or a single source; files of a pattern by their names.

    Raises
    ------
    UserError : with the ``key``: a pattern that no file has, an empty list.
    """
    if Path(source).expanduser().is_file():
        return [source]
    if source.startswith("[") and source.endswith("]"):
        parts = [part.strip() for part in re.findall(r"(?:'[^']*'|\"[^\"]*\"|[^,])+", source[1:-1])]
        found = [one for part in parts if part for one in sources_of(part.strip("'\""), key)]
        if not found:
            raise UserError(key, source, "lists no recording; write [a.csv,b.csv]")
        return found
    if any(sign in source for sign in "*?["):
        files = sorted(f for f in glob.glob(str(Path(source).expanduser()), recursive=True) if Path(f).is_file())
        if not files:
            raise UserError(key, source, "no file has such a name")
        return files
    return [source]
