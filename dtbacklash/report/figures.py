"""The figures of the paper: responses (4, 6), the play (7), gap scenarios (8, 10, 13) and novelty (14).

Every function returns a `matplotlib.figure.Figure`; `style.save(figure, path)` writes it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from dtbacklash.metrics import step_metrics
from dtbacklash.report.decimate import envelope
from dtbacklash.report.style import COLOUR, INK, MUTED, legend_above, letter, panels, styled


@styled
def response_and_voltage(
    t_s: ArrayLike, q3_mm: ArrayLike, u_v: ArrayLike, target_mm: float = 1.0, band: float = 0.01
) -> Figure:
    """Step response and control voltage (Figures 4 and 6), with overshoot, settling time and peak marked.

    Args:
        t_s: times [s], shape (n,); the step comes at t_s[0], from rest at 0 mm.
        q3_mm: position of the top mass [mm], shape (n,).
        u_v: control voltage [V], shape (n,).
        target_mm: size of the step [mm].
        band: settling band as a share of the step.
    """
    t, q3, u = (np.asarray(a, dtype=float) for a in (t_s, q3_mm, u_v))
    found = step_metrics(t, q3, u, target_mm, band=band)
    figure, (top, bottom) = panels([2.9, 2.4])
    top.axhspan(target_mm * (1 - band), target_mm * (1 + band), color=MUTED, alpha=0.25, lw=0)
    top.plot(t[[0, -1]], [target_mm] * 2, color=COLOUR["reference"], lw=1.4, ls="--", label="reference")
    top.plot(*envelope(t, q3), color=COLOUR["output"], label="$q_3$")
    top.set_ylabel("$q_3$ [mm]")
    _mark_settling(top, t[0], found.settling_time_s, band, target_mm)
    if found.overshoot_pct > 100 * band:
        # the top of the response, seen from the side of the target
        peak = int(np.argmax(q3 * np.sign(target_mm)))
        _mark_point(top, t[peak], q3[peak], f"overshoot {found.overshoot_pct:.3g} %", COLOUR["output"])
    bottom.axhline(0, color=INK, lw=0.8)
    bottom.plot(*envelope(t, u), color=COLOUR["voltage"])
    peak = int(np.argmax(np.abs(u)))
    _mark_point(bottom, t[peak], u[peak], f"peak {u[peak]:.3g} V", COLOUR["voltage"])
    bottom.set_ylabel("$u$ [V]")
    bottom.set_xlabel("time [s]")
    bottom.set_xlim(t[0], t[-1])
    for ax in (top, bottom):
        ax.margins(y=0.1)
    letter([top, bottom], ["top platform position", "motor input voltage"])
    legend_above(top)
    return figure


def _mark_point(ax: Axes, x: float, y: float, text: str, colour: str) -> None:
    """A dot at the point and its value beside it."""
    ax.plot([x], [y], "o", color=colour, ms=6, mec="white", zorder=5, clip_on=False)
    ax.annotate(text, (x, y), xytext=(10, 0), textcoords="offset points", color=colour, va="center", fontweight="bold")


def _mark_settling(ax: Axes, t0: float, settling_s: float, band: float, target: float) -> None:
    """A vertical line where the response enters the band for good, or a note that it never does."""
    note: dict[str, Any] = {"color": INK, "fontweight": "bold", "textcoords": "offset points", "va": "center"}
    if math.isnan(settling_s):
        ax.annotate(
            f"not settled within ±{100 * band:g} %",
            (1, 0.1),
            xycoords="axes fraction",
            xytext=(-6, 0),
            ha="right",
            **note,
        )
        return
    text = f"{1000 * settling_s:.3g} ms" if settling_s < 0.1 else f"{settling_s:.3g} s"
    ax.axvline(t0 + settling_s, color=INK, lw=1.0, ls=":")
    ax.annotate(
        f"settled (±{100 * band:g} %): {text}",
        (t0 + settling_s, 0.2 * target),
        xytext=(-6, 0),
        ha="right",
        bbox={"fc": "white", "ec": "none", "pad": 1.5, "alpha": 0.85},
        **note,
    )


@styled
def play_figure(t_s: ArrayLike, theta_m_deg: ArrayLike, theta_d_deg: ArrayLike, gap_deg: float) -> Figure:
    """Input and output of the play over time and against each other (Figure 7).

    Args:
        t_s: times [s], shape (n,).
        theta_m_deg: motor angle [deg], shape (n,).
        theta_d_deg: angle of the lead screw [deg], shape (n,).
        gap_deg: gap angle, the half-width of the play [deg]; the lag marked is twice this.
    """
    t, motor, screw = (np.asarray(a, dtype=float) for a in (t_s, theta_m_deg, theta_d_deg))
    figure, (left, right) = panels([2.6, 4.2], sharex=False)
    left.plot(*envelope(t, motor, 4000), color=INK, label=r"motor $\theta_m$")
    left.plot(*envelope(t, screw, 4000), color=COLOUR["gap_hat"], label=r"lead screw $\theta_d$")
    left.set_xlim(t[0], t[-1])
    left.set_xlabel("time [s]")
    left.set_ylabel("angle [deg]")
    legend_above(left)
    for sign, label in ((1, r"$\theta_d = \theta_m \pm \theta_b$"), (-1, None)):
        edge = np.array([motor.min(), motor.max()])
        right.plot(edge, edge + sign * gap_deg, color=MUTED, lw=1.1, ls="--", label=label)
    right.plot(motor, screw, color=COLOUR["gap_hat"], lw=1.3)
    right.set_xlabel(r"$\theta_m$ [deg]")
    right.set_ylabel(r"$\theta_d$ [deg]")
    # the lag is marked above the stretch from rest and below the first reversal: nothing crosses it there
    level = 0.2 * screw.max()
    lag = rf"$2\theta_b$ = {2 * gap_deg:g}°"
    note: dict[str, Any] = {"textcoords": "offset points", "fontweight": "bold"}
    right.annotate(
        "",
        (level - gap_deg, level),
        (level + gap_deg, level),
        arrowprops={"arrowstyle": "<->", "color": INK, "lw": 1.3, "shrinkA": 0, "shrinkB": 0},
    )
    right.annotate(lag, (level + gap_deg, level), xytext=(12, -8), va="top", **note)
    legend_above(right)
    letter([left, right], ["over time", "lead screw against motor"])
    return figure


@styled
def gap_scenario(trace: pd.DataFrame, estimates: pd.DataFrame | None = None) -> Figure:
    """Reference and output above, actual and estimated gap below (Figures 8, 10, 13).

    Args:
        trace: columns `t_s, r_mm, q3_mm, gap_deg, gap_hat_deg`. The estimate is drawn unless it is 0 or NaN
            throughout (a controller without a model of the gap).
        estimates: table of estimations, marked as accepted or rejected; None or empty: no marks.
    """
    figure, axes = panels([2.7, 2.3])
    response_panel(axes[0], trace)
    gap_panel(axes[1], trace, estimates)
    letter(axes, ["reference and output", "backlash gap angle"])
    finish_time_axis(figure, axes, trace)
    return figure


@styled
def novelty_scenario(trace: pd.DataFrame, estimates: pd.DataFrame | None, threshold_mm: float) -> Figure:
    """As `gap_scenario`, and below it the novelty index with its threshold and the events (Figure 14).

    Args:
        trace: columns `t_s, r_mm, q3_mm, gap_deg, gap_hat_deg, novelty_mm`.
        estimates: table of estimations; each is an event.
        threshold_mm: index above which an event is raised [mm].
    """
    figure, axes = panels([2.5, 2.1, 1.8])
    response_panel(axes[0], trace)
    gap_panel(axes[1], trace, estimates)
    novelty_panel(axes[2], trace, estimates, threshold_mm)
    letter(axes, ["reference and output", "backlash gap angle", r"novelty index $|\hat\eta|$"])
    finish_time_axis(figure, axes, trace)
    return figure


def finish_time_axis(figure: Figure, axes: list[Axes], trace: pd.DataFrame) -> None:
    """One time axis for all panels, labelled under the last."""
    t = trace["t_s"].to_numpy()
    axes[-1].set_xlim(t[0], t[-1])
    axes[-1].set_xlabel("time [s]")
    for ax in axes:
        ax.margins(y=0.08)
    figure.align_ylabels(axes)


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
        ax.plot(
            when,
            good["gap_deg"],
            "o",
            color=COLOUR["gap_hat"],
            ms=7,
            mec="white",
            zorder=4,
            label="accepted",
            clip_on=False,
        )
    if not len(bad):
        return
    shown = np.concatenate([trace["gap_deg"], trace["gap_hat_deg"].fillna(0.0), good["gap_deg"], [1.0]])
    ceiling = 1.12 * shown.max()
    value = bad["gap_deg"].to_numpy(dtype=float)
    height = np.clip(np.nan_to_num(value, nan=ceiling, posinf=ceiling, neginf=0.0), 0.0, ceiling)
    ax.plot(
        bad["t_event_s"],
        height,
        "x",
        color=COLOUR["rejected"],
        ms=9,
        mew=2.4,
        zorder=4,
        label="rejected",
        clip_on=False,
    )
    for x, y, number in zip(bad["t_event_s"], height, value, strict=True):
        if y != number:
            text = f"{number:.0f}°" if math.isfinite(number) else "none"
            ax.annotate(
                text,
                (x, y),
                xytext=(8, 0),
                textcoords="offset points",
                va="center",
                fontsize=10,
                color=COLOUR["rejected"],
            )


def novelty_panel(ax: Axes, trace: pd.DataFrame, estimates: pd.DataFrame | None, threshold_mm: float) -> None:
    """Novelty index over time [mm], its threshold in grey, a triangle at each event."""
    novelty = trace["novelty_mm"].fillna(0.0)
    ax.axhline(threshold_mm, color=MUTED, lw=1.8, label=f"threshold {threshold_mm:g} mm")
    ax.plot(*envelope(trace["t_s"], novelty), color=COLOUR["novelty"], lw=1.3, label="index")
    if estimates is not None and len(estimates):
        ceiling = 1.1 * max(float(novelty.max()), threshold_mm)
        ax.plot(
            estimates["t_event_s"],
            np.full(len(estimates), ceiling),
            "v",
            color=COLOUR["gap_hat"],
            ms=8,
            mec="white",
            label="event",
            clip_on=False,
        )
    ax.set_ylabel("index [mm]")
    legend_above(ax)
