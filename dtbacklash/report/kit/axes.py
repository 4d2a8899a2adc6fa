"""Logarithmic axes whose labels never touch."""

from __future__ import annotations

import math
from collections.abc import Iterable

from matplotlib.axis import Axis, YAxis
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

#: an axis shows at least this factor
SPAN = 15.0
#: from this many decades on only whole decades are labelled, and at most this many labels in all
DECADES, LABELS = 2.2, 6


def logarithmic(axis: Axis, values: Iterable[float], pad: float = 1.5) -> None:
    """A logarithmic axis about these values; where none can stand on it, about one.

    Labels are 1, 2, 5 within a decade or two, else powers of ten, as many as have room; plain numbers up to 1000.
    """
    fit = [v for v in values if math.isfinite(v) and v > 0.0] or [1.0]
    low, high = min(fit) / pad, max(fit) * pad
    high = max(high, SPAN * low)
    axes = axis.axes
    set_scale, set_limits = (
        (axes.set_yscale, axes.set_ylim) if isinstance(axis, YAxis) else (axes.set_xscale, axes.set_xlim)
    )
    set_scale("log")
    set_limits(low, high)
    label_decades(axis, low, high)


def label_decades(axis: Axis, low: float, high: float) -> None:
    """Label an axis that is logarithmic from ``low`` to ``high`` already; thin ticks stand between the labels."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    between = [m * 10.0**k for k in decades for m in range(1, 10)]
    if math.log10(high / low) < DECADES:
        ticks = [m * 10.0**k for k in decades for m in (1, 2, 5)]
    else:
        step = math.ceil(sum(low <= 10.0**k <= high for k in decades) / LABELS)
        ticks = [10.0**k for k in decades if k % step == 0]
    axis.set_major_locator(FixedLocator([t for t in ticks if low <= t <= high]))
    axis.set_minor_locator(
        FixedLocator([t for t in between if low <= t <= high]) if len(decades) < 8 else NullLocator()
    )
    axis.set_major_formatter(FuncFormatter(_label))
    axis.set_minor_formatter(NullFormatter())


def _label(value: float, _position: int) -> str:
    if 1e-3 < value < 1e4:
        return f"{value:g}"
    return f"$10^{{{round(math.log10(value))}}}$"
