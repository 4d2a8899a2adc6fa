"""What somebody may have meant: the nearest of the names that there are."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

#: how alike a name has to be
ALIKE = 0.6


def near(word: str, known: Iterable[str], most: int = 3) -> list[str]:
    """The names that are like a word, or that hold it, nearest first.

    >>> near("coulomb", ["backlash", "coulomb_friction", "cogging"])
    ['coulomb_friction']
    """
    names = list(known)
    holds = [name for name in names if len(word) > 2 and word.lower() in name.lower()]
    return list(dict.fromkeys([*difflib.get_close_matches(word, names, n=most, cutoff=ALIKE), *holds]))[:most]


def meant(word: str, known: Iterable[str]) -> str:
    """``did you mean a or b? `` before what is allowed; empty where nothing is near."""
    found = near(word, known)
    return f"did you mean {' or '.join(found)}? " if found else ""
