"""The words of an answer, and how a person's spelling becomes one of them."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from dtbacklash.config.near import meant

FILE = Path(__file__).with_name("vocabulary.csv")


def plain(text: str) -> str:
    """A word without case, and with single underscores for all that is no letter or digit."""
    return re.sub(r"[^a-z0-9]+", "_", text.strip().lower()).strip("_")


def table(words: Iterable[tuple[str, Iterable[str]]]) -> dict[str, str]:
    """Plain spelling -> word, for words with their synonyms.

    Raises ValueError: a spelling that stands for two words.
    """
    found: dict[str, str] = {}
    for word, synonyms in words:
        for spelling in (word, *synonyms):
            if found.setdefault(plain(spelling), word) != word:
                raise ValueError(f"{spelling!r} stands for {found[plain(spelling)]} and for {word}")
    return found


@cache
def effects() -> dict[str, str]:
    """Plain spelling -> effect."""
    with FILE.open(encoding="utf-8", newline="") as file:
        return table((row["effect"], filter(None, row["synonyms"].split(";"))) for row in csv.DictReader(file))


def word_of(text: str, known: Mapping[str, str]) -> str:
    """The word that a spelling stands for.

    Raises ValueError: no such word; says which ones are near.
    """
    if found := known.get(plain(text)):
        return found
    hint = meant(plain(text), dict.fromkeys(known.values())).strip()
    raise ValueError(f"{text[:40]!r} is not in the vocabulary" + (f"; {hint}" if hint else ""))
