"""Range checks that end in one line: the key, the value, and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Iterable

from dtbacklash.errors import UserError


def number(
    key: str,
    value: float,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    below: float = math.inf,
    at_most: float = math.inf,
    unit: str = "",
) -> None:
    """Refuse NaN, infinities and values outside (``above``, ``below``) or [``at_least``, ``at_most``].

    Raises
    ------
    UserError : names ``key`` and the whole allowed range in ``unit``.
    """
    if math.isfinite(value) and above < value < below and at_least <= value <= at_most:
        return
    phrases = [] if math.isfinite(value) else ["finite"]
    phrases += limits(above=above, at_least=at_least, below=below, at_most=at_most)
    phrase = " and ".join(phrases) or "finite"
    raise UserError(key, value, f"must be {phrase}" + (f" {unit}" if unit else ""))


def limits(*, above: float, at_least: float, below: float, at_most: float) -> list[str]:
    """Bounds in words; a whole number with all its digits."""
    found = []
    if at_least > -math.inf:
        found.append(f"at least {_text(at_least)}")
    if above > -math.inf:
        found.append("positive" if above == 0 else f"above {_text(above)}")
    if at_most < math.inf:
        found.append(f"at most {_text(at_most)}")
    if below < math.inf:
        found.append(f"below {_text(below)}")
    return found


def _text(bound: float) -> str:
    return str(bound) if isinstance(bound, int) else f"{bound:g}"


def choice(key: str, value: str, allowed: Iterable[str]) -> None:
    """Refuse a ``value`` that is not one of ``allowed`` (raises UserError listing them)."""
    options = list(allowed)
    if value not in options:
        raise UserError(key, value, "choose one of " + ", ".join(options))
