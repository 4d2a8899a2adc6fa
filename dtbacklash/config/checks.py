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
    limits = [] if math.isfinite(value) else ["finite"]
    if at_least > -math.inf:
        limits.append(f"at least {at_least:g}")
    if above > -math.inf:
        limits.append("positive" if above == 0 else f"above {above:g}")
    if at_most < math.inf:
        limits.append(f"at most {at_most:g}")
    if below < math.inf:
        limits.append(f"below {below:g}")
    phrase = " and ".join(limits) or "finite"
    raise UserError(key, value, f"must be {phrase}" + (f" {unit}" if unit else ""))


def choice(key: str, value: str, allowed: Iterable[str]) -> None:
    """Refuse a ``value`` that is not one of ``allowed`` (raises UserError listing them)."""
    options = list(allowed)
    if value not in options:
        raise UserError(key, value, "choose one of " + ", ".join(options))
