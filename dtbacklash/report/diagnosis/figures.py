"""The figures of a diagnosis: what was not fitted before and after, every signal, laws with recovered points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.plot_data import Curve, LawShown
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.report.components.intervals import scaled, unit_in_signs
from dtbacklash.report.components.style import INK, MUTED, envelope, new_figure, styled

MEASURED, NOMINAL, EXTENDED = INK, "#0072b2", "#d55e00"
NOISE = r"noise ($\pm 2 \sigma$)"
HELD_OUT = "#e8ecf0"
ZOOM_SHARE, ZOOM_SAMPLES = 0.07, 120  # length of the closer look: share of the record, and samples at least
RAN_AWAY = 1e3  # a model that is so many times further off than the measurement ever was has run away
NOTE_HEIGHT = 0.1  # of the note about a model out of view, in heights of the panel
OUT_OF_VIEW = 1.5  # a model that leaves the measured range by this much of it does not set the scale
USUAL, RARE = 0.998, 4.0  # what leaves this quantile of what is left by this factor does not either


#: a figure for a screen, and one for a phone: width and height, inch
WIDE, NARROW = (7.4, 3.8), (4.0, 4.2)
#: reversals that a figure of one look shows, samples at least
TURNS, SAMPLES_MIN = 16, 60


@styled
def judged_figure(curve: Curve, unit: tuple[float, str], size: tuple[float, float] = WIDE) -> Figure:
    """The recording and the model before and after on the part that was not fitted, and below it what is left.

    curve: one channel. unit: to draw it in, its size in SI and its name. size: of the figure, inch.
    """
    window = look(curve)
    part = (curve.t_s >= window[0]) & (curve.t_s <= window[1])
    factor, name = unit
    t, scale = curve.t_s[part], 1.0 / factor
    measured, before, after = (
        scale * _drawable(v, curve.measured)[part] for v in (curve.measured, curve.nominal, curve.extended)
    )
    figure = new_figure(size[1], size[0])
    top, below = figure.subplots(2, 1, sharex=True, height_ratios=[2.2, 1.0])
    lines: list[tuple[Floats, str, dict[str, Any]]] = [(measured, "recorded", {"color": MEASURED, "lw": 2.4})]
    if curve.changed:
        lines.append((before, "model before", {"color": NOMINAL, "lw": 1.3, "ls": (0, (4, 1.6))}))
    lines.append((after, "model after" if curve.changed else "model", {"color": EXTENDED, "lw": 1.2}))
    for values, label, style in lines:
        top.plot(*envelope(*_broken(t, values)), label=label, **style)
    _frame(top, [(values, label, str(style["color"])) for values, label, style in lines], name)
    top.set_ylabel(f"{curve.name} [{unit_in_signs(name)}]")
    floor = scale * (curve.noise_floor or 0.0)
    if floor:
        below.axhspan(-2 * floor, 2 * floor, color="#00805f", alpha=0.22, lw=0, label=NOISE)
    below.plot(*envelope(*_broken(t, measured - after)), color=EXTENDED, lw=0.9)
    below.set_ylabel(f"left [{unit_in_signs(name)}]")
    below.set_xlabel("time [s]")
    below.set_xlim(*window)
    below.margins(y=0.12)
    figure.legend(loc="outside upper left", ncols=4 if size[0] > NARROW[0] else 2, columnspacing=1.4)
    return figure


def look(curve: Curve) -> tuple[float, float]:
    """A part of what was not fitted in which the signal reverses some times: where the nominal model errs most."""
    first = int(np.searchsorted(curve.t_s, curve.held_out_from_s)) if curve.held_out_from_s is not None else 0
    away = curve.measured[first:] - np.median(curve.measured[first:])
    turns = int(np.count_nonzero(np.diff(np.sign(away[np.abs(away) > 0.1 * np.abs(away).max(initial=0.0)]))))
    n = len(away)
    return zoom(curve, min(n, max(SAMPLES_MIN, round(n * TURNS / max(turns, TURNS)))))


@styled
def curve_figure(curve: Curve, model: str = "extended") -> Figure:
    """Signal above, what each model leaves unexplained below; left the whole record, right a closer look.

    curve: one channel.
    model: what to call the better model: ``extended`` or ``recalibrated``.
    """
    curve = replace(
        curve, nominal=_drawable(curve.nominal, curve.measured), extended=_drawable(curve.extended, curve.measured)
    )
    rows = ["nominal", *([model] if curve.changed else [])]
    figure = new_figure(2.7 + 1.5 * len(rows) + 0.5)
    axes = figure.subplots(
        1 + len(rows), 2, sharex="col", width_ratios=[1.5, 1.0], height_ratios=[2.6] + [1.45] * len(rows)
    )
    window = zoom(curve)
    for column, (begin, end) in enumerate(((curve.t_s[0], curve.t_s[-1]), window)):
        part = (curve.t_s >= begin) & (curve.t_s <= end)
        _signal(axes[0, column], curve, part, model, label=column == 0)
        for ax, name in zip(axes[1:, column], rows, strict=True):
            values = curve.measured - (curve.nominal if name == "nominal" else curve.extended)
            _left_over(ax, curve, part, values, name, label=column == 0)
        for ax in axes[:, column]:
            _shade(ax, curve, begin, end)
            ax.set_xlim(begin, end)
        axes[-1, column].set_xlabel("time [s]")
    for ax in axes[:-1, 0]:
        ax.axvspan(*window, fc="none", ec=MUTED, lw=0.9, ls=":")
    axes[-1, 0].axvspan(*window, fc="none", ec=MUTED, lw=0.9, ls=":")
    axes[0, 0].set_title("the whole record")
    axes[0, 1].set_title("a closer look")
    figure.legend(loc="outside upper left", ncols=5, columnspacing=1.6)
    return figure


def zoom(curve: Curve, samples: int | None = None) -> tuple[float, float]:
    """The stretch to look at more closely: where the nominal model errs most, if possible in what was held out."""
    n = len(curve.t_s)
    size = min(n, max(ZOOM_SAMPLES, round(ZOOM_SHARE * n))) if samples is None else samples
    error = curve.measured - curve.nominal if curve.changed else curve.measured
    first = 0
    if curve.held_out_from_s is not None:
        first = min(int(np.searchsorted(curve.t_s, curve.held_out_from_s)), n - size)
    error = error - np.mean(error)
    total, square = (np.concatenate([[0.0], np.cumsum(e)]) for e in (error, error**2))
    spread = (square[size:] - square[:-size]) / size - ((total[size:] - total[:-size]) / size) ** 2
    begin = first + int(np.argmax(spread[first:]))
    return float(curve.t_s[begin]), float(curve.t_s[begin + size - 1])


def _signal(ax: Axes, curve: Curve, part: NDArray[np.bool_], model: str, label: bool) -> None:
    t = curve.t_s[part]
    factor, unit = scaled(curve.unit, float(np.ptp(curve.measured)))
    lines: list[tuple[Floats, str, dict[str, Any]]] = [(curve.measured, "measured", {"color": MEASURED, "lw": 2.4})]
    lines.append((curve.nominal, "nominal model", {"color": NOMINAL, "lw": 1.3, "ls": (0, (4, 1.6))}))
    if curve.changed:
        lines.append((curve.extended, f"{model} model", {"color": EXTENDED, "lw": 1.2}))
    for values, name, style in lines:
        ax.plot(*envelope(*_broken(t, values[part] / factor)), label=name if label else None, **style)
    _frame(ax, [(values[part] / factor, name, str(style["color"])) for values, name, style in lines], unit)
    if label:
        ax.set_ylabel(f"{curve.name} [{unit_in_signs(unit)}]")


def _broken(t: Floats, values: Floats) -> tuple[Floats, Floats]:
    """The same with a NaN in every gap, so that no line is drawn across it."""
    gaps = np.flatnonzero(np.diff(t) > 1.5 * np.diff(t).min(initial=np.inf)) + 1
    return np.insert(t, gaps, 0.5 * (t[gaps] + t[gaps - 1])), np.insert(values, gaps, np.nan)


def _drawable(values: Floats, measured: Floats) -> Floats:
    """The same, cut far outside of what is in view: a model that ran away has numbers that nothing can draw."""
    reach = RAN_AWAY * (float(np.abs(measured).max()) or 1.0)
    return np.clip(np.nan_to_num(values, nan=reach, posinf=reach, neginf=-reach), -reach, reach)


def _frame(ax: Axes, lines: list[tuple[Floats, str, str]], unit: str) -> None:
    """Scale to the measurement, which is the first of (values, name, colour), and to the models that stay near it.

    One far outside would flatten all and gets a note.
    """
    low, high = float(lines[0][0].min()), float(lines[0][0].max())
    span = high - low or abs(high) or 1.0
    allowed, ends, notes = (low - OUT_OF_VIEW * span, high + OUT_OF_VIEW * span), (low, high), {True: 0, False: 0}
    for values, name, color in lines[1:]:
        bottom, top = float(np.min(values)), float(np.max(values))
        if allowed[0] <= bottom and top <= allowed[1]:
            ends = min(ends[0], bottom), max(ends[1], top)
            continue
        up = not top - high <= low - bottom
        end = top if up else bottom
        ran_away = abs(end) >= 0.99 * RAN_AWAY * max(abs(low), abs(high))
        reach = "runs away" if ran_away else f"{'up' if up else 'down'} to {end:.3g} {unit}"
        height = 0.02 + NOTE_HEIGHT * notes[up]
        notes[up] += 1
        ax.text(
            0.97, 1.0 - height if up else height, f"{name}: {reach}", transform=ax.transAxes, ha="right",
            va="top" if up else "bottom", color=color, fontsize=10, zorder=6,
            bbox={"fc": "white", "ec": "none", "alpha": 0.85, "pad": 1.5},
        )  # fmt: skip
    span = ends[1] - ends[0] or abs(ends[1]) or 1.0
    # room for the notes, and a margin
    ax.set_ylim(ends[0] - (0.1 + 0.16 * notes[False]) * span, ends[1] + (0.1 + 0.16 * notes[True]) * span)


def _left_over(ax: Axes, curve: Curve, part: NDArray[np.bool_], values: Floats, name: str, label: bool) -> None:
    """Measured minus model over the band of the noise (two standard deviations to each side)."""
    most, size = float(np.abs(values).max()), float(np.quantile(np.abs(values), USUAL))
    rare = most > RARE * size > 0.0  # a beginning in motion, say
    t, size = curve.t_s[part], size if rare else most
    factor, unit = scaled(curve.unit, max(size, 2 * (curve.noise_floor or 0.0)))
    if curve.noise_floor:
        band = 2 * curve.noise_floor / factor
        first = label and name == "nominal"
        ax.axhspan(-band, band, color="#00805f", alpha=0.22, lw=0, label=NOISE if first else None, zorder=1)
        for edge in (-band, band) if band * factor > 0.05 * size else ():  # the curve may hide the band
            ax.axhline(edge, color="#00634a", lw=1.0, ls=(0, (3, 2)), zorder=3)
    ax.plot(
        *envelope(*_broken(t, values[part] / factor)),
        color=NOMINAL if name == "nominal" else EXTENDED,
        lw=0.9,
        zorder=2,
    )
    ax.margins(y=0.12)
    if rare:
        reach = 1.3 * max(size, 2 * (curve.noise_floor or 0.0)) / factor
        ax.set_ylim(-reach, reach)
    if label:
        ax.set_ylabel(f"measured \N{MINUS SIGN}\n{name} [{unit_in_signs(unit)}]", fontsize=10.5)


def _shade(ax: Axes, curve: Curve, begin: float, end: float) -> None:
    """Grey where the models were not fitted."""
    start = curve.held_out_from_s
    if start is None or start >= end:
        return
    first = ax.get_subplotspec().is_first_row() and ax.get_subplotspec().is_first_col()  # type: ignore[union-attr]
    ax.axvspan(max(begin, start), end, color=HELD_OUT, lw=0, zorder=0, label="held out" if first else None)


@styled
def law_figure(shown: LawShown) -> Figure:
    """The law against its state, and the points that the recording gives, with two standard errors."""
    figure = new_figure(4.3)
    ax = figure.subplots()
    fx, x_unit = scaled(shown.state_unit, _reach(np.concatenate([shown.law_state, shown.state])))
    fy, y_unit = scaled(shown.effort_unit, _reach(np.concatenate([shown.law_effort, shown.recovered])))
    if shown.effort_unit == shown.state_unit and len(shown.law_state):  # output over input
        ends = np.array([shown.law_state.min(), shown.law_state.max()])
        ax.plot(ends / fx, ends / fy, color=MUTED, lw=1.2, ls=(0, (2, 2)), label="without it", zorder=2)
    if len(shown.law_state):
        label = f"fitted law: {name_in_words(shown.effect)}"
        ax.plot(shown.law_state / fx, shown.law_effort / fy, color=EXTENDED, lw=2.4, label=label, zorder=3)
    if len(shown.state):
        ax.errorbar(
            shown.state / fx, shown.recovered / fy, yerr=2 * shown.error / fy, fmt="o", color=NOMINAL, ms=4.5, lw=1.1,
            capsize=2.5, label=r"recovered from the recording ($\pm 2 \sigma$)", zorder=4,
        )  # fmt: skip
    ax.axhline(0, color=INK, lw=0.7, zorder=1)
    limits = _effort_limits(shown)
    if limits is not None:
        ax.set_ylim(limits[0] / fy, limits[1] / fy)
    ax.set_xlabel(f"{shown.state_label} [{unit_in_signs(x_unit)}]")
    ax.set_ylabel(f"{shown.effort_label} [{unit_in_signs(y_unit)}]")
    figure.legend(loc="outside upper left", ncols=3, columnspacing=1.6)
    return figure


def _effort_limits(shown: LawShown) -> tuple[float, float] | None:
    """From zero to the law and the points that are known to half their span; others may leave the picture."""
    span = float(np.ptp(shown.recovered)) if len(shown.recovered) else 0.0
    known = shown.recovered[
        shown.error <= 0.5 * max(span, float(np.ptp(shown.law_effort)) if len(shown.law_effort) else 0.0)
    ]
    edges = np.concatenate([known, shown.law_effort, np.zeros(1)])
    pad = 0.12 * float(np.ptp(edges))
    return (float(edges.min()) - pad, float(edges.max()) + pad) if pad > 0.0 else None


def _reach(values: Floats) -> float:
    return float(np.quantile(np.abs(values), 0.98)) if len(values) else 0.0
