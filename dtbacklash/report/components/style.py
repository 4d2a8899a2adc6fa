"""The look of the house: one style for every figure, one colour for every signal.

Figures are built on `matplotlib.figure.Figure` without pyplot: no global state, no window, a faster start.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, YAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.layout_engine import LayoutEngine
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator
from matplotlib.transforms import Bbox
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
#: room about axes with their labels, and the width of a colour bar, inch
PAD, BAR = 0.06, 0.15
#: axes whose size changes by less than this share keep their ticks
ALIKE = 0.25
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


class Layout(LayoutEngine):
    """Room for what stands about the axes, measured once; matplotlib's constrained layout measures it four times.

    The axes of a figure stand in one grid; y labels of a column in one line. Legends of the figure get room above or
    below it. bars : axes -> their colour bar, and its height as a share of theirs.
    """

    def __init__(self) -> None:
        super().__init__()
        self._adjust_compatible, self._colorbar_gridspec = False, False
        self.bars: dict[Axes, tuple[Axes, float]] = {}
        self._labels_aligned = False

    def execute(self, fig: Figure) -> None:
        """Put the axes into their places."""
        canvas = fig.canvas
        assert isinstance(canvas, FigureCanvasAgg)
        renderer = canvas.get_renderer()
        placed = {ax: spec for ax in fig.axes if (spec := ax.get_subplotspec()) is not None}
        if not placed:
            return
        for axis in (axis for ax in fig.axes for axis in (ax.xaxis, ax.yaxis) if not axis.label.get_text()):
            axis.set_label_coords(0.0, 0.0)  # no label: matplotlib need not look for its place
        before = np.array([ax.bbox.size for ax in placed])
        self._place(fig, placed, renderer)
        if not np.allclose(before, [ax.bbox.size for ax in placed], rtol=ALIKE):  # they may have other ticks now
            self._place(fig, placed, renderer)
        for column in range(0 if self._labels_aligned else next(iter(placed.values())).get_gridspec().ncols):
            labelled = [ax for ax, s in placed.items() if s.colspan.start == column and ax.yaxis.label.get_text()]
            _align_labels(labelled, renderer)
        self._labels_aligned = True

    def _place(self, fig: Figure, placed: dict[Axes, SubplotSpec], renderer: RendererBase) -> None:
        grid, pad = next(iter(placed.values())).get_gridspec(), PAD * fig.dpi
        (left, right), (top, bottom) = (np.full((2, n), pad) for n in (grid.ncols, grid.nrows))
        for ax, spec in placed.items():
            tight, rows, columns = ax.get_tightbbox(renderer, for_layout_only=True), spec.rowspan, spec.colspan
            assert tight is not None
            for margins, at, room in (
                (left, columns.start, ax.bbox.x0 - tight.x0),
                (right, columns.stop - 1, tight.x1 - ax.bbox.x1 + self._bar_room(ax, renderer)),
                (bottom, rows.stop - 1, ax.bbox.y0 - tight.y0), (top, rows.start, tight.y1 - ax.bbox.y1),
            ):  # fmt: skip
                margins[at] = max(margins[at], room + pad)
        for legend in fig.legends:
            box = legend.get_window_extent(renderer)
            (top if box.y0 + box.y1 > fig.bbox.height else bottom[::-1])[0] += box.height + 2.0 * pad
        x0, x1 = _cells(left, right, fig.bbox.width, grid.get_width_ratios())
        y1, y0 = (fig.bbox.height - edge for edge in _cells(top, bottom, fig.bbox.height, grid.get_height_ratios()))
        for ax, spec in placed.items():
            rows, columns = spec.rowspan, spec.colspan
            box = Bbox([(x0[columns.start], y0[rows.stop - 1]), (x1[columns.stop - 1], y1[rows.start])])
            _put(ax, box)
            if ax in self.bars:
                bar, share = self.bars[ax]
                x, half = box.x1 + 2.0 * pad, 0.5 * share * box.height
                middle = 0.5 * (box.y0 + box.y1)
                _put(bar, Bbox([(x, middle - half), (x + BAR * fig.dpi, middle + half)]))

    def _bar_room(self, ax: Axes, renderer: RendererBase) -> float:
        """How wide the colour bar of these axes is with its labels, pixels; 0 without one."""
        if ax not in self.bars:
            return 0.0
        bar = self.bars[ax][0]
        tight = bar.get_tightbbox(renderer, for_layout_only=True)
        assert tight is not None
        return float(tight.x1 - bar.bbox.x1 + (BAR + 2.0 * PAD) * ax.figure.dpi)


def _put(ax: Axes, box: Bbox) -> None:
    """Put axes into a box, pixels."""
    ax.set_position(ax.figure.transFigure.inverted().transform_bbox(box))
    ax.set_in_layout(True)  # set_position takes them out


def _align_labels(axes: list[Axes], renderer: RendererBase) -> None:
    """Put the y labels of a column into one line, where there are several."""
    if len(axes) < 2:
        return
    for ax in axes:
        ax.yaxis.get_tightbbox(renderer)  # puts its label beside its own ticks
    left = min(ax.yaxis.label.get_position()[0] for ax in axes)
    for ax in axes:
        ax.yaxis.set_label_coords((left - ax.bbox.x0) / ax.bbox.width, 0.5)


def _cells(
    before: NDArray[np.float64], after: NDArray[np.float64], length: float, ratios: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the cells of a grid begin and end, pixels, with these margins before and after each."""
    sizes = max(length - before.sum() - after.sum(), 1.0) * np.asarray(ratios) / np.sum(ratios)
    begins = np.cumsum(before) + np.concatenate([[0.0], np.cumsum(sizes + after)[:-1]])
    return begins, begins + sizes


def colour_bar(mappable: ScalarMappable, ax: Axes, label: str, shrink: float = 1.0) -> Colorbar:
    """A colour bar at the right of its axes. shrink: its height as a share of theirs."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    layout, bar = figure.get_layout_engine(), figure.add_axes((0.9, 0.2, 0.02, 0.6))
    assert isinstance(layout, Layout)
    layout.bars[ax] = bar, shrink
    return figure.colorbar(mappable, cax=bar, label=label)


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure of the house's width; sizes in inch."""
    figure = Figure(figsize=(width, height), layout=Layout())
    FigureCanvasAgg(figure)
    # about where the layout puts axes: ticks are chosen for axes of the final size
    figure.subplotpars.update(left=0.8 / width, right=1.0 - 0.15 / width, bottom=0.6 / height, top=1.0 - 0.4 / height)
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
