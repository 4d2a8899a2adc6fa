"""The channels of a recording as they were read: a panel each, over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from dtbacklash.arrays import Floats
from dtbacklash.report.components.style import COLOUR, envelope, panels, styled
from dtbacklash.units import in_signs, scaled

#: height of a panel, in
HEIGHT = 1.5


@styled
def channels_figure(
    t_s: Floats, channels: dict[str, Floats], units: dict[str, str], stretches: tuple[tuple[int, int], ...] = ()
) -> Figure:
    """Raw signals over time; where the recording has a gap the line is broken.

    Parameters
    ----------
    t_s : (N,) s. channels : name -> (N,) in SI. units : name -> SI unit.
    stretches : (first, last + 1) samples without a gap; none: all.
    """
    figure, axes = panels([HEIGHT] * len(channels))
    for ax, (name, values) in zip(axes, channels.items(), strict=True):
        factor, unit = scaled(units[name], float(np.abs(values).max()))
        colour = COLOUR["voltage"] if name in ("u", "r") else COLOUR["output"]
        for first, last in stretches or ((0, len(t_s)),):
            ax.plot(*envelope(t_s[first:last], values[first:last] / factor), color=colour, lw=1.1)
        ax.set_ylabel(f"{name} [{in_signs(unit)}]")
    axes[-1].set_xlim(t_s[0], t_s[-1])
    axes[-1].set_xlabel("time [s]")
    return figure
