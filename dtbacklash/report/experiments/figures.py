"""Which effects an experiment would confuse, as a matrix."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from dtbacklash.diagnose.experiments.isolability import ALIKE, SHOWS, Isolability
from dtbacklash.diagnose.words import named_in_words
from dtbacklash.report.kit.style import INK, MUTED, new_figure, styled

#: from what is confused to what is at right angles
SINES = LinearSegmentedColormap.from_list("sines", ["#d55e00", "#f3d3b8", "#f4f6f8"])
#: inch a row, and beside the matrix for names
SIDE, NAMES = 0.24, 4.2


@styled
def matrix_figure(found: Isolability) -> Figure:
    """The sines between all effects that show, place by place; what would be confused is orange, with its number."""
    n = len(found.effects)
    figure = new_figure(NAMES - 0.4 + SIDE * n, width=NAMES + 1.2 + SIDE * n)
    ax = figure.subplots()
    shown = np.where(np.eye(n, dtype=bool), np.nan, found.sines)
    image = ax.imshow(shown, cmap=SINES, vmin=0.0, vmax=1.0)
    for i, j in zip(*np.nonzero((found.sines < ALIKE) & ~np.eye(n, dtype=bool)), strict=True):
        text = f"{found.sines[i, j]:.2f}".lstrip("0")
        ax.text(j, i, text, ha="center", va="center", fontsize=6.5, color="white")
    names = [named_in_words(e.effect, e.location) for e in found.effects]
    ax.set_xticks(range(n), names, rotation=90, fontsize=9)
    ax.set_yticks(range(n), names, fontsize=9)
    places = [e.location for e in found.effects]
    for k in (k for k in range(1, n) if places[k] != places[k - 1]):
        ax.axhline(k - 0.5, color=MUTED, lw=0.8)
        ax.axvline(k - 0.5, color=MUTED, lw=0.8)
    ax.grid(False)
    ax.tick_params(length=0)
    bar = figure.colorbar(image, ax=ax, shrink=0.5, pad=0.02)
    bar.set_label("sine of the angle between two effects", color=INK)
    bar.ax.axhline(ALIKE, color=INK, lw=1.0)
    ax.set_title(f"What this experiment would confuse: sines below {ALIKE:g}\n"
                 f"({len(found.pairs)} pairs of {n} effects that show at {SHOWS:g} standard errors)")  # fmt: skip
    return figure
