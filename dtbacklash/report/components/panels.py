"""Panels of a run over time, for every figure that shows one: response, gap, novelty index, voltage."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from dtbacklash.report.components.style import COLOUR, MUTED, envelope, legend_above

#: marks that may stand on the border of a panel, and a text at the right of a mark
ON_TOP: dict[str, Any] = {"zorder": 4, "clip_on": False}
BESIDE: dict[str, Any] = {"xytext": (8, 0), "textcoords": "offset points", "va": "center", "fontsize": 10}


def finish_time_axis(axes: list[Axes], trace: pd.DataFrame) -> None:
    """One time axis for all panels, labelled under the last."""
    t = trace["t_s"].to_numpy()
    axes[-1].set_xlim(t[0], t[-1])
    axes[-1].set_xlabel("time [s]")
    for ax in axes:
        ax.margins(y=0.08)


def response_panel(ax: Axes, trace: pd.DataFrame) -> None:
    """Reference and output over time [mm]."""
    t = trace["t_s"].to_numpy()
    ax.plot(*envelope(t, trace["q3_mm"]), color=COLOUR["output"], lw=1.3, label="output $q_3$")
    ax.plot(*envelope(t, trace["r_mm"]), color=COLOUR["reference"], lw=1.2, ls=(0, (4, 2)), label="reference $r$")
    ax.set_ylabel("position [mm]")
    legend_above(ax)


def voltage_panel(ax: Axes, trace: pd.DataFrame) -> None:
    """Control voltage over time [V]."""
    ax.plot(*envelope(trace["t_s"], trace["u_v"]), color=COLOUR["voltage"], lw=1.1)
    ax.set_ylabel("$u$ [V]")


def gap_panel(ax: Axes, trace: pd.DataFrame, estimates: pd.DataFrame | None) -> None:
    """Actual and estimated gap over time [deg]; what the twin returned is marked when it was known."""
    t, guess = trace["t_s"].to_numpy(), trace["gap_hat_deg"].to_numpy(dtype=float)
    ax.plot(*envelope(t, trace["gap_deg"]), color=COLOUR["gap"], label=r"actual $\theta_b$")
    if np.nan_to_num(guess).any():
        ax.plot(*envelope(t, guess), color=COLOUR["gap_hat"], label=r"estimate $\hat\theta_b$")
    _mark_estimates(ax, trace, estimates)
    ax.set_ylabel("gap angle [deg]")
    legend_above(ax, columns=4)


def _mark_estimates(ax: Axes, trace: pd.DataFrame, estimates: pd.DataFrame | None) -> None:
    """Dots for accepted estimates (when applied), crosses for rejected ones (when asked for).

    A rejected value may be absurd: it is drawn at the panel's upper edge, with its number, and leaves the
    scale alone.
    """
    if estimates is None or estimates.empty:
        return
    accepted = estimates["accepted"].astype(bool)
    good, bad = estimates[accepted], estimates[~accepted]
    if len(good):
        when = good["t_applied_s"].where(good["t_applied_s"].notna(), good["t_event_s"])
        when = when.where(when <= trace["t_s"].iloc[-1])  # what comes after the end has no place in the panel
        ax.plot(when, good["gap_deg"], "o", color=COLOUR["gap_hat"], ms=7, mec="white", label="accepted", **ON_TOP)
    if not len(bad):
        return
    shown = np.concatenate([trace["gap_deg"], trace["gap_hat_deg"].fillna(0.0), good["gap_deg"], [1.0]])
    ceiling = 1.12 * shown.max()
    value = bad["gap_deg"].to_numpy(dtype=float)
    height = np.clip(np.nan_to_num(value, nan=ceiling, posinf=ceiling, neginf=0.0), 0.0, ceiling)
    ax.plot(bad["t_event_s"], height, "x", color=COLOUR["rejected"], ms=9, mew=2.4, label="rejected", **ON_TOP)
    for x, y, number in zip(bad["t_event_s"], height, value, strict=True):
        if y != number:
            text = f"{number:.0f}°" if math.isfinite(number) else "none"
            ax.annotate(text, (x, y), color=COLOUR["rejected"], **BESIDE)


def index_panel(ax: Axes, trace: pd.DataFrame, column: str, lines: list[float], unit: str) -> None:
    """A further novelty index over time with its threshold (or both of them) in grey; gaps where it says nothing."""
    for level in lines:
        ax.axhline(level, color=MUTED, lw=1.8)
    ax.plot(trace["t_s"], trace[column], color=COLOUR["novelty"], lw=1.3)
    ax.set_ylabel(f"[{unit}]" if unit else "ratio")


def novelty_panel(ax: Axes, trace: pd.DataFrame, estimates: pd.DataFrame | None, threshold_mm: float) -> None:
    """Novelty index over time [mm], its threshold in grey, a triangle at each event."""
    novelty = trace["novelty_mm"].fillna(0.0)
    ax.axhline(threshold_mm, color=MUTED, lw=1.8, label=f"threshold {threshold_mm:g} mm")
    ax.plot(*envelope(trace["t_s"], novelty), color=COLOUR["novelty"], lw=1.3, label="index")
    if estimates is not None and len(estimates):
        ceiling = 1.1 * max(float(novelty.max()), threshold_mm)
        at, color = np.full(len(estimates), ceiling), COLOUR["gap_hat"]
        ax.plot(estimates["t_event_s"], at, "v", color=color, ms=8, mec="white", label="event", clip_on=False)
    ax.set_ylabel("index [mm]")
    legend_above(ax)
