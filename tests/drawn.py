"""Looks at figures as a reader would."""

import itertools
from typing import Any

from matplotlib.figure import Figure


def overlapping(figure: Figure, *, rotated: bool = True) -> list[tuple[str, str]]:
    """Pairs of tick labels of a figure that touch; without ``rotated`` those that are not upright are left out.

    The box about a slanted label is larger than the label: such ones are not compared with each other.
    """
    figure.canvas.draw()
    labels = [found for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) for found in _labels(axis)]
    if not rotated:
        labels = [found for found in labels if not found[2]]
    pairs = itertools.combinations(labels, 2)
    return [(a, b) for (a, box, slant), (b, other, leans) in pairs if not (slant and leans) and box.overlaps(other)]


def _labels(axis: Any) -> list[tuple[str, Any, float]]:
    """Text, box and angle of each label that is seen."""
    low, high = sorted(axis.get_view_interval())
    ticks = [tick for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()) if low <= tick.get_loc() <= high]
    shown = [tick.label1 for tick in ticks if tick.label1.get_visible() and tick.label1.get_text()]
    return [(text.get_text(), text.get_window_extent(), text.get_rotation()) for text in shown]
