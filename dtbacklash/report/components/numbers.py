"""Numbers as text, in one notation: as many digits as a reader needs, powers of ten for very small and large ones."""

from __future__ import annotations

import math
import re
from numbers import Real
from typing import Any

import pandas as pd

from dtbacklash.units import SUPERSCRIPT


def number(value: Any, digits: int = 3, missing: str = "-", plain: bool = False) -> str:
    """A number with `digits` significant digits; below 0.001 and from a million on with a power of ten.

    None, NaN and NA become `missing`; a text stays as it is; True and False become yes and no. `plain`: in letters
    that every terminal has, 1e-9.
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
        text = f"{x:.{digits}g}"
        return re.sub(r"e([+-])0*", lambda e: "e-" if e[1] == "-" else "e", text) if plain else powers(text)
    decimals = max(digits - 1 - math.floor(math.log10(abs(x))), 0)
    text = f"{x:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


#: a share of which no reader notices less, in percent
UNNOTICED = 1e-3


def percent(share: float, digits: int = 3, plain: bool = False) -> str:
    """A share in percent; what nobody would notice is said to be less than that."""
    value = 100.0 * share
    if 0.0 < abs(value) < UNNOTICED:
        return f"< {UNNOTICED:g} %"
    return f"{number(value, digits, plain=plain)} %"


def change(value: float, nominal: float) -> str:
    """By how much a value is larger than its nominal one, in percent with its sign; a dash beside a nominal 0."""
    if not nominal:
        return "-"
    percents = 100.0 * (value / nominal - 1.0)
    return "0 %" if abs(percents) < UNNOTICED else f"{percents:+.3g} %"


def powers(text: str) -> str:
    """A text with its numbers of the form 3.1e-12 written 3.1 × 10⁻¹²."""

    def ten(found: re.Match[str]) -> str:
        return f"{found[1]} \N{MULTIPLICATION SIGN} 10{str(int(found[2])).translate(SUPERSCRIPT)}"

    return re.sub(r"\b(\d+(?:\.\d+)?)e([+-]?\d+)\b", ten, text)


def fixed(value: Any, decimals: int, missing: str = "-") -> str:
    """A number with a fixed count of decimals, for a column; what is missing is `missing`, -0 is 0."""
    if pd.isna(value):
        return missing
    text = f"{float(value):.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text


def quantity(value: Any, unit: str, digits: int = 3) -> str:
    """A number and its unit; the unit "1" is not written."""
    return number(value, digits) if unit in ("", "1") else f"{number(value, digits)} {unit}"
