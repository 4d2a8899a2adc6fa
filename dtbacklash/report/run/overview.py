"""The figures of one run: all of its signals over time, and all of its moves on top of each other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from dtbacklash.report.components import panels, style
from dtbacklash.report.components.intervals import scaled, unit_in_signs

# dark to light without the palest end: a thin line must be seen on white, and the order in grey print too
GAP_MAP = LinearSegmentedColormap.from_list("gap", ["#14365d", "#0072b2", "#3fa7a0", "#e0a100", "#d55e00"])

Panel = tuple[str, float, Callable[[Axes], None]]


@style.styled
def run_overview(
    trace: pd.DataFrame,
    estimates: pd.DataFrame,
    moves: pd.DataFrame,
    threshold_mm: float | None = None,
    indexes: list[tuple[str, str, list[float], str]] | None = None,
) -> Figure:
    """Everything over time; the panels follow what the run has.

    trace: columns `t_s, r_mm, q3_mm, u_v, gap_deg, gap_hat_deg, novelty_mm`.
    estimates: table of estimations, may be empty.
    moves: `metrics.move_table` of the trace; if it is empty the tracking error gets a panel.
    threshold_mm: novelty threshold [mm] if the novelty index triggers the twin, else None (no panel).
    indexes: further indexes: title, column of the trace, thresholds, unit.
    """
    chosen: list[Panel] = [("reference and output", 2.5, lambda ax: panels.response_panel(ax, trace))]
    if moves.empty:
        chosen.append(("tracking error", 1.6, lambda ax: _error_panel(ax, trace)))
    gaps = trace[["gap_deg", "gap_hat_deg"]].fillna(0.0)
    if gaps.to_numpy().any() or len(estimates):
        chosen.append(("backlash gap angle", 2.1, lambda ax: panels.gap_panel(ax, trace, estimates)))
    if threshold_mm is not None:
        title = r"novelty index $|\hat\eta|$"
        chosen.append((title, 1.6, lambda ax: panels.novelty_panel(ax, trace, estimates, threshold_mm)))
    for title, column, lines, unit in indexes or []:
        draw = partial(panels.index_panel, trace=trace, column=column, lines=lines, unit=unit)
        chosen.append((title, 1.3, draw))
    chosen.append(("motor input voltage", 1.6, lambda ax: panels.voltage_panel(ax, trace)))
    return _stacked(chosen, trace)


@style.styled
def open_overview(trace: pd.DataFrame, signals: list[dict[str, Any]]) -> Figure:
    """An open-loop run over time: the command, then what each sensor shows, then the gap if there is one.

    trace: columns `t_s`, those that `signals` names, and `gap_deg` of a rig with a gear.
    signals: `signal, column, unit, of, quantity, rms` of the command and of each sensor, as in a run's summary.
    """
    height = 1.7 if len(signals) <= 4 else 1.3
    chosen: list[Panel] = [(_signal_title(s), height, partial(_signal_panel, trace=trace, signal=s)) for s in signals]
    if "gap_deg" in trace and trace["gap_deg"].to_numpy().any():
        gap = {"column": "gap_deg", "unit": "deg", "of": "gear", "rms": 0.0}
        chosen.append(("backlash gap angle", height, partial(_signal_panel, trace=trace, signal=gap)))
    return _stacked(chosen, trace)


def _stacked(chosen: list[Panel], trace: pd.DataFrame) -> Figure:
    """The panels below each other on one time axis."""
    figure, axes = style.panels([height for _, height, _ in chosen])
    for ax, (_, _, draw) in zip(axes, chosen, strict=True):
        draw(ax)
    style.letter(axes, [title for title, _, _ in chosen])
    panels.finish_time_axis(axes, trace)
    return figure


def _signal_title(signal: dict[str, Any]) -> str:
    name = signal["signal"]
    if not signal["of"]:
        return f"{signal['quantity']} {name}"
    return f"{name}: {signal['quantity']} of {signal['of']}"


def _signal_panel(ax: Axes, trace: pd.DataFrame, signal: dict[str, Any]) -> None:
    """One signal over time, in a unit of its size."""
    colour = style.COLOUR["output"] if signal["of"] else style.COLOUR["voltage"]
    factor, unit = scaled(signal["unit"], signal["rms"] or 0.0)
    ax.plot(*style.envelope(trace["t_s"], trace[signal["column"]] / factor), color=colour, lw=1.1)
    ax.set_ylabel(f"[{unit_in_signs(unit)}]")


def _error_panel(ax: Axes, trace: pd.DataFrame) -> None:
    """Reference minus output over time [mm]."""
    ax.plot(*style.envelope(trace["t_s"], trace["r_mm"] - trace["q3_mm"]), color=style.COLOUR["error"], lw=1.1)
    ax.set_ylabel("$r - q_3$ [mm]")


@style.styled
def moves_overlay(trace: pd.DataFrame, moves: pd.DataFrame, band: float = 0.01) -> Figure:
    """Every move from 0 to 1 on one time axis, coloured by the gap: what wear does to the transient.

    Left the whole response, right a closer look at the target with the settling band.

    trace: columns `t_s, q3_mm, gap_deg`.
    moves: `metrics.move_table` of the trace, at least one row.
    band: settling band as a share of the move.
    """
    t, q3, gap = (trace[name].to_numpy(dtype=float) for name in ("t_s", "q3_mm", "gap_deg"))
    begins = np.searchsorted(t, moves["t_s"].to_numpy() - 1e-9)
    ends = np.append(begins[1:], t.size)
    window = _window(moves, t)
    curves, gaps = [], []
    for begin, end, start, target in zip(begins, ends, moves["from_mm"], moves["to_mm"], strict=True):
        stop = min(end, int(np.searchsorted(t, t[begin] + window)))
        shape = (q3[begin:stop] - start) / (target - start)
        curves.append(np.column_stack(style.envelope(t[begin:stop] - t[begin], shape, bins=500)))
        gaps.append(gap[begin])
    figure = style.new_figure(3.9)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.15])
    scale = Normalize(min(gaps), max(gaps) if max(gaps) > min(gaps) else min(gaps) + 1.0)
    for ax, width in ((left, 1.3), (right, 1.5)):
        ax.axhspan(1 - band, 1 + band, color=style.MUTED, alpha=0.28, lw=0, label=f"±{100 * band:g} %")
        ax.add_collection(LineCollection(curves, array=np.array(gaps), cmap=GAP_MAP, norm=scale, lw=width))
        ax.set_xlim(0, window)
        ax.set_xlabel("time since the move [s]")
    _scale_overlay(left, right, curves, band)
    left.set_ylabel("response / move")
    style.letter([left, right], ["every move, from 0 to 1", "close to the target"])
    style.legend_above(right)
    if max(gaps) > min(gaps):
        style.colour_bar(ScalarMappable(scale, GAP_MAP), right, "gap at the move [deg]")
    return figure


@style.styled
def band_figure(trace: pd.DataFrame, columns: list[str]) -> Figure:
    """What is simulated within its 95 % band, a panel a sensor, and beside it half the band's width."""
    t = trace["t_s"].to_numpy(dtype=float)
    figure = style.new_figure(0.6 + 1.9 * len(columns))
    axes = figure.subplots(len(columns), 2, sharex=True, squeeze=False, width_ratios=[1.5, 1.0])
    for (left, right), name in zip(axes, columns, strict=True):
        here, low, high = (trace[n].to_numpy(dtype=float) for n in (name, f"{name}_low", f"{name}_high"))
        (times, lows), (_, highs) = (band_ends(t, ends) for ends in (low, high))
        left.fill_between(times, lows, highs, color=style.COLOUR["output"], alpha=0.3, lw=0, label="95 %")
        left.plot(*style.envelope(t, here), color=style.COLOUR["output"], lw=1.2, label="simulated")
        left.set_ylabel(name)
        right.plot(*style.envelope(t, 0.5 * (high - low)), color=style.COLOUR["error"], lw=1.2)
        right.set_ylim(bottom=0.0)
    axes[0, 0].legend(loc="best")
    axes[0, 0].set_title("(a)  within the band")
    axes[0, 1].set_title("(b)  half of its width")
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    return figure


def band_ends(t: np.ndarray[Any, Any], ends: np.ndarray[Any, Any]) -> tuple[np.ndarray[Any, Any], ...]:
    """Samples of a band's end, which is smooth, as many as can be seen."""
    step = max(1, len(t) // 2400)
    return t[::step], ends[::step]


def _window(moves: pd.DataFrame, t: np.ndarray[Any, Any]) -> float:
    """How long after a move to look: until those that settle have settled and a little more.

    Moves that never settle do not stretch it beyond 3 s: their oscillation would be a solid block.
    """
    spacing = float(np.diff(np.append(moves["t_s"].to_numpy(), t[-1])).max())
    settling = moves["settling_time_s"]
    window = 1.5 * float(settling.max()) if settling.notna().any() else 0.0
    return min(max(window, 0.05 if settling.notna().all() else 3.0), spacing)


def _scale_overlay(left: Axes, right: Axes, curves: list[np.ndarray[Any, Any]], band: float) -> None:
    """Left all of the response; right as far from the target as any goes once it has been reached."""
    values = np.concatenate([curve[:, 1] for curve in curves])
    low, high = min(0.0, float(values.min())), max(1.05, float(values.max()))
    left.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
    reach = 3 * band
    for curve in curves:
        arrived = np.flatnonzero(curve[:, 1] >= 1 - band)
        if arrived.size:
            reach = max(reach, float(np.abs(curve[arrived[0] :, 1] - 1).max()))
    reach = min(reach, 12 * band)  # close to the target, also where one move is far from it
    right.set_ylim(1 - 1.15 * reach, 1 + 1.15 * reach)
