"""Numbers as text: as many digits as a reader needs."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import pandas as pd


def number(value: Any, digits: int = 3, missing: str = "-") -> str:
    """A number with `digits` significant digits, never in exponential form between 0.001 and a million.

    None, NaN and NA become `missing`; a text stays as it is; True and False become yes and no.
    """
    if isinstance(value, str):
        return value
    if pd.isna(value):
        return missing
    if isinstance(value, bool) or type(value).__name__ == "bool":  # numpy's bool has the same name
        return "yes" if value else "no"
    if not isinstance(value, Real):
        return str(value)
    x = float(value)
    if x == 0 or not math.isfinite(x) or not 1e-3 <= abs(x) < 1e6:
        return f"{x:.{digits}g}"
    decimals = max(digits - 1 - math.floor(math.log10(abs(x))), 0)
    text = f"{x:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def fixed(value: Any, decimals: int, missing: str = "-") -> str:
    """A number with a fixed count of decimals, for a column; what is missing is `missing`, -0 is 0."""
    if pd.isna(value):
        return missing
    text = f"{float(value):.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text


def quantity(value: Any, unit: str, digits: int = 3) -> str:
    """A number and its unit; the unit "1" is not written."""
    return number(value, digits) if unit in ("", "1") else f"{number(value, digits)} {unit}"
