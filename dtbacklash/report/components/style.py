"""The look of the house: one style for every figure, one colour for every signal.

Figures are built on `matplotlib.figure.Figure` without pyplot: no global state, no window, a faster start.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, YAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator
from numpy.typing import ArrayLike, NDArray

INK = "#1f2933"  # text, axes, the truth
MUTED = "#7b8794"  # thresholds, notes, bands

# Okabe and Ito's palette (told apart with any colour vision), one colour a signal
COLOUR = {
    "reference": "#7b8794",
    "output": "#0072b2",
    "gap": INK,
    "gap_hat": "#d55e00",
    "rejected": "#b5478a",
    "voltage": "#00805f",
    "novelty": "#6a51a3",
    "error": "#b5478a",
}
SERIES = ["#0072b2", "#d55e00", "#00805f", "#b5478a", "#6a51a3", "#9a7d0a", "#56b4e9", INK]
"""Colours for what is no signal (the series of a sweep), in this order."""
MARKERS = ["o", "s", "D", "^", "v", "P", "X", "*"]

WIDTH = 9.0  # inch
#: an axis shows at least this factor
SPAN = 15.0
#: from this many decades on only whole decades are labelled, and at most this many labels in all
DECADES, LABELS = 2.2, 6

RC = matplotlib.rc_params_from_file(Path(__file__).with_name("house.mplstyle"), use_default_template=False)

P = ParamSpec("P")
T = TypeVar("T")


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Run a drawing function under the house style and leave matplotlib's global settings as they were."""

    @wraps(draw)
    def under_style(*args: P.args, **kwargs: P.kwargs) -> T:
        with matplotlib.rc_context(RC):
            return draw(*args, **kwargs)

    return under_style


def panels(heights: list[float], sharex: bool = True) -> tuple[Figure, list[Axes]]:
    """A figure with one panel below the other.

    heights: height of each panel [inch].
    sharex: whether the panels share their x axis.
    """
    figure = new_figure(sum(heights) + 0.4)
    axes = figure.subplots(len(heights), 1, sharex=sharex, squeeze=False, height_ratios=heights)[:, 0]
    return figure, list(axes)


class Layout(ConstrainedLayoutEngine):
    """matplotlib's, and labels of panels in one line.

    `Figure.align_ylabels` would do the latter, too, but then each panel measures all of them, eight times a figure.
    """

    def __init__(self) -> None:
        super().__init__()
        self._lines: list[Sequence[Axes]] = []

    def line_up(self, axes: Sequence[Axes]) -> None:
        """Put the y labels of panels, one below the other, into one line."""
        self._lines.append(axes)

    def execute(self, fig: Figure) -> None:
        """Lay out; the labels are lined up once."""
        super().execute(fig)
        canvas = fig.canvas
        assert isinstance(canvas, FigureCanvasAgg)
        for axes in self._lines:
            for ax in axes:
                ax.yaxis.get_tightbbox(canvas.get_renderer())  # puts its label beside its own ticks
            left = min(ax.yaxis.label.get_position()[0] for ax in axes)
            for ax in axes:
                ax.yaxis.set_label_coords((left - ax.bbox.x0) / ax.bbox.width, 0.5)
        self._lines.clear()


def line_up(axes: Sequence[Axes]) -> None:
    """Put the y labels of a figure's panels, one below the other, into one line."""
    layout = axes[0].figure.get_layout_engine()
    assert isinstance(layout, Layout)
    layout.line_up(axes)


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure of the house's width; sizes in inch."""
    figure = Figure(figsize=(width, height), layout=Layout())
    FigureCanvasAgg(figure)
    return figure


def letter(axes: list[Axes], titles: list[str]) -> None:
    """Title the panels (a), (b), (c) ... ; a single panel gets no letter."""
    for index, (ax, title) in enumerate(zip(axes, titles, strict=True)):
        ax.set_title(f"({chr(ord('a') + index)})  {title}" if len(axes) > 1 else title)


def legend_above(ax: Axes, columns: int = 4) -> None:
    """Legend in the title's line at the right, where it can hide no data."""
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.0, columnspacing=1.4)


@styled
def png(figure: Figure) -> bytes:
    """The figure as a PNG.

    `savefig` gives the same bytes, but draws twice: once without ink, for the layout, which lays out by itself.
    """
    figure.set_dpi(matplotlib.rcParams["savefig.dpi"])
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    written, canvas = io.BytesIO(), figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    # no software version in the file: the same figure is the same bytes
    canvas.print_png(written, metadata={"Software": None}, pil_kwargs={"compress_level": 4})
    return written.getvalue()


def save(figure: Figure, path: Path) -> Path:
    """Write the figure as PNG (its folder is made if needed) and return the path."""
    return save_png(png(figure), path)


def save_png(content: bytes, path: Path) -> Path:
    """Write a figure that is drawn already (its folder is made if needed) and return the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def envelope(t: ArrayLike, y: ArrayLike, bins: int = 1200) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The smallest and the largest sample of each of `bins` equal stretches, in the order of time.

    On paper a line through them cannot be told from a line through all samples, as long as a bin is no wider
    than a pixel or two.

    t: times, shape (n,).
    y: values, shape (n,). A NaN in a bin stays a NaN there, which leaves a gap in the line.
    bins: number of stretches.

    Returns:
        Times and values, at most 2*bins + 2 of each; first and last sample are kept. With n <= 2*bins: all.
    """
    times, values = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    n = times.size
    if n <= 2 * bins:
        return times, values
    size = -(-n // bins)
    full = n // size
    blocks = values[: full * size].reshape(full, size)
    offsets = np.arange(full) * size
    picked = np.concatenate([offsets + blocks.argmin(axis=1), offsets + blocks.argmax(axis=1), [0, n - 1]])
    if full * size < n:
        rest = values[full * size :]
        picked = np.append(picked, [full * size + int(rest.argmin()), full * size + int(rest.argmax())])
    keep = np.unique(picked)
    return times[keep], values[keep]


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
