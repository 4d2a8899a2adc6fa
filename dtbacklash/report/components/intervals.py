"""Values with their 95 % intervals as an engineer writes them: 20.0 ± 0.5 mN m."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from dtbacklash.report.components.numbers import number
from dtbacklash.units import SUPERSCRIPT, scaled
from dtbacklash.units import in_signs as unit_in_signs

__all__ = ["degrees", "interval", "scaled", "unit_in_signs"]

DIGITS_MAX = 7  # of a value, however narrow its interval
SYMMETRIC = 0.15  # an interval whose halves differ by less is written with ±


def interval(
    value: float, ci95: Sequence[Any] | None, unit: str, plain: bool = False, size: float | None = None
) -> str:
    """A value, its 95 % interval and its unit.

    value: SI.
    ci95: the interval's two ends, SI; None, or an end that is None, NaN or infinite where it is open.
    unit: SI unit as in the catalogue, ``1`` for a share.
    plain: write it in letters that every terminal has.
    size: chooses the unit's prefix, for values to be compared; None: the value itself.
    """
    low, high = (_end(end) for end in (ci95 if ci95 is not None else (None, None)))
    factor, shown = scaled(unit, value if size is None else size)
    return _with_power(value / factor, low and low / factor, high and high / factor, shown, plain)


def degrees(unit: str, value: float) -> str:
    """An angle in degrees, in brackets; nothing for other units."""
    return f" ({number(math.degrees(value))}°)" if unit == "rad" else ""


def _end(value: Any) -> float | None:
    if value is None or not math.isfinite(float(value)):
        return None
    return float(value)


def _with_power(value: float, low: float | None, high: float | None, unit: str, plain: bool) -> str:
    """The text; what no prefix brings into reach gets a power of ten."""
    power = 0
    if value and math.isfinite(value) and not 1e-3 <= abs(value) < 1e6:
        power = math.floor(math.log10(abs(value)))
    ten = 10.0**power
    body, joined = _body(value / ten, None if low is None else low / ten, None if high is None else high / ten)
    if power:
        raised = f"e{power}" if plain else f" \N{MULTIPLICATION SIGN} 10{str(power).translate(SUPERSCRIPT)}"
        body = (f"({body})" if joined else body) + raised
    return _joined(body.replace("±", "+/-") if plain else body, unit, plain)


def _joined(text: str, unit: str, plain: bool) -> str:
    if unit in ("", "1"):
        return text
    shown = unit if plain else unit_in_signs(unit)
    joined = f"({text})" if "±" in text and not text.startswith("(") and unit == "%" else text
    return f"{joined} {shown.replace('µ', 'u') if plain else shown}"


def _body(value: float, low: float | None, high: float | None) -> tuple[str, bool]:
    """The numbers, and whether there is more than one of them."""
    if low is None and high is None:
        return number(value, 4), False
    if low is None or high is None:
        end, word = (high, "at most") if low is None else (low, "at least")
        return f"{number(value)}, {word} {number(end)}", True
    half = (high - low) / 2
    decimals = _decimals(value, half)
    if abs(value - (low + high) / 2) > SYMMETRIC * half:
        return f"{value:.{decimals}f} ({low:.{decimals}f} to {high:.{decimals}f})", True
    shown = f"{half:.{decimals}f}"
    if half > 0 and float(shown) == 0:
        shown = number(half, 1)
    return f"{value:.{decimals}f} ± {shown}", True


def _decimals(value: float, half: float) -> int:
    """Decimals that show the half-width with one digit, or two if it begins with 1, 2 or 3, as is the custom."""
    if half <= 0:
        return max(0, 3 - math.floor(math.log10(abs(value)))) if value else 0
    power = math.floor(math.log10(half))
    wanted = (1 if half < 3.55 * 10.0**power else 0) - power
    top = DIGITS_MAX - 1 - math.floor(math.log10(abs(value))) if value else wanted
    return max(0, min(wanted, top))
