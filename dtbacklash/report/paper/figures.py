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

from dtbacklash.experiment.metrics import StepMetrics
from dtbacklash.report.components.panels import finish_time_axis, gap_panel, novelty_panel, response_panel
from dtbacklash.report.components.style import COLOUR, INK, MUTED, envelope, legend_above, letter, panels, styled


@styled
def response_and_voltage(
    t_s: ArrayLike, q3_mm: ArrayLike, u_v: ArrayLike, found: StepMetrics, target_mm: float = 1.0, band: float = 0.01
) -> Figure:
    """Step response and control voltage (Figures 4 and 6), with overshoot, settling time and peak marked.

    t_s: times [s], shape (n,); the step comes at t_s[0], from rest at 0 mm.
    q3_mm: position of the top mass [mm], shape (n,).
    u_v: control voltage [V], shape (n,).
    found: what the step did, by `metrics.step_metrics` or a row of the moves.
    target_mm: size of the step [mm].
    band: settling band as a share of the step.
    """
    t, q3, u = (np.asarray(a, dtype=float) for a in (t_s, q3_mm, u_v))
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

    trace: columns `t_s, r_mm, q3_mm, gap_deg, gap_hat_deg`. The estimate is drawn unless it is 0 or NaN
        throughout (a controller without a model of the gap).
    estimates: table of estimations, marked as accepted or rejected; None or empty: no marks.
    """
    figure, axes = panels([2.7, 2.3])
    response_panel(axes[0], trace)
    gap_panel(axes[1], trace, estimates)
    letter(axes, ["reference and output", "backlash gap angle"])
    finish_time_axis(axes, trace)
    return figure


@styled
def novelty_scenario(trace: pd.DataFrame, estimates: pd.DataFrame | None, threshold_mm: float) -> Figure:
    """As `gap_scenario`, and below it the novelty index with its threshold and the events (Figure 14).

    trace: columns `t_s, r_mm, q3_mm, gap_deg, gap_hat_deg, novelty_mm`.
    estimates: table of estimations; each is an event.
    threshold_mm: index above which an event is raised [mm].
    """
    figure, axes = panels([2.5, 2.1, 1.8])
    response_panel(axes[0], trace)
    gap_panel(axes[1], trace, estimates)
    novelty_panel(axes[2], trace, estimates, threshold_mm)
    letter(axes, ["reference and output", "backlash gap angle", r"novelty index $|\hat\eta|$"])
    finish_time_axis(axes, trace)
    return figure
