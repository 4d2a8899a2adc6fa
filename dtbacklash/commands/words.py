"""A command line of ``key=value`` words and options, read alike by the commands that have no Hydra."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from dtbacklash.errors import UserError

VERBOSE = ("-v", "--verbose")
#: what is read as a number of workers, and as a seed, at most
JOBS_MAX, SEED_MOST = 256, 2**53


@dataclass(frozen=True)
class Words:
    """What was given: ``given`` key -> value, ``options``, and the words of ``prefix`` as they are."""

    given: dict[str, str] = field(default_factory=dict)
    options: set[str] = field(default_factory=set)
    passed: list[str] = field(default_factory=list)


def whole(key: str, text: str, low: int, high: int) -> int:
    """Read a whole number within bounds.

    Raises
    ------
    UserError : it is none, or out of bounds.
    """
    if not text.isascii() or not text.isdecimal() or len(text) > 20 or not low <= int(text) <= high:
        raise UserError(key, text, f"must be a whole number from {low} to {high}")
    return int(text)


def read_words(
    words: Sequence[str], keys: Sequence[str], options: Sequence[str], choose: str, prefix: str | None = None
) -> Words:
    """Read a command line; words whose key begins with ``prefix`` are passed on unread.

    Raises
    ------
    UserError : an unknown word (``choose`` says which options there are), a key without a value or twice.
    """
    found = Words()
    known = [*keys, f"{prefix}KEY"] if prefix else keys
    for word in words:
        if word in options:
            found.options.add(word)
            continue
        key, equals, value = word.partition("=")
        if word.startswith("-"):
            raise UserError("option", word, choose)
        if not equals:
            raise UserError("argument", word, "write key=value")
        if prefix and key.lstrip("+").startswith(prefix):
            found.passed.append(word)
            continue
        if key not in keys:
            raise UserError(key, value, "no such setting; choose one of " + ", ".join(known))
        if not value:
            raise UserError(key, "", "give a value")
        if key in found.given:
            raise UserError(key, value, f"is given twice; the first is {found.given[key]}")
        found.given[key] = value
    return found
