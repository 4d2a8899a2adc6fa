"""The loop of a run as a control engineer looks at it: Bode, Nyquist with the play, sensitivity, and its margins."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dtbacklash.control.margins import Curves, DesignedLoop
from dtbacklash.report.components.numbers import number
from dtbacklash.report.components.style import COLOUR, INK, MUTED, SERIES, letter, logarithmic, new_figure, png, styled

#: frequencies of the figure, rad/s, and how far about the origin the Nyquist curve is looked at
LOWEST_RAD_S, POINTS, REACH = 0.3, 900, 2.5
CAPTION = (
    "The loop, cut at the voltage: its frequency response, its Nyquist curve, and what closes the loop over the play.",
    "In a good design the sensitivity stays below 2 and the small-gain bound below 1, and the curve that closes the "
    "loop over the play does not meet that of the play: where they meet, the loop may oscillate for ever.",
)


def rows(designed: DesignedLoop) -> list[list[str]]:
    """The table of margins: what, how much, what it says."""
    m = designed.margins()
    swings = "none predicted" if m.cycle_share is None else (
        f"{number(m.cycle_share)} half-gaps at {number(m.cycle_rad_s)} rad/s"
    )  # fmt: skip
    play = "a gap that the model has and the machine has not" if designed.models_gap else "a gap of the machine"
    return [
        ["gain margin", number(m.gain, missing="none"), "factor on the loop's gain that makes it unstable"],
        ["phase margin", _with_unit(m.phase_deg, "°"), "lag that does; it is smallest near "
         + _with_unit(m.crossover_rad_s, " rad/s")],
        ["delay margin", _with_unit(None if m.delay_s is None else 1e3 * m.delay_s, " ms"), "delay that does"],
        ["largest sensitivity", number(m.ms), "inverse of the distance from -1; 2 is a common bound"],
        ["small-gain bound", number(m.small_gain), "share of that distance by which the rig's tolerances move the "
         "loop, each by one; below 1 it stays stable"],
        ["limit cycle", swings, f"of the motor in {play}, by its describing function"],
    ]  # fmt: skip


def _with_unit(value: float | None, unit: str) -> str:
    return "none" if value is None else f"{number(value)}{unit}"


def loop_png(designed: DesignedLoop) -> bytes:
    """The figure of a loop as a PNG."""
    return png(loop_figure(designed))


@styled
def loop_figure(designed: DesignedLoop) -> Figure:
    """Bode, Nyquist, the loop over the play with its describing function, sensitivity."""
    highest = 0.9 * np.pi / designed.design.sample_time_s
    curves = Curves(designed, np.geomspace(LOWEST_RAD_S, highest, POINTS))
    figure = new_figure(6.4)
    (size, nyquist), (phase, play) = figure.subplots(2, 2, width_ratios=[1.4, 1.0])
    _bode(size, phase, curves)
    _nyquist(nyquist, curves)
    _play(play, curves)
    letter([size, nyquist, phase, play], ["size", "Nyquist curve of $L$", "phase", "loop over the play"])
    return figure


def _bode(size: Axes, phase: Axes, curves: Curves) -> None:
    omega = curves.omega
    size.axhline(1.0, color=MUTED, lw=1.0)
    size.plot(omega, np.abs(curves.loop), color=COLOUR["output"], label="$|L|$")
    size.plot(omega, curves.sensitivity, color=SERIES[1], label="sensitivity")
    size.plot(omega, curves.moved, color=SERIES[2], ls=(0, (4, 2)), label="small-gain bound")
    logarithmic(size.yaxis, [1e-3, 1e2], pad=1.0)
    size.legend(loc="upper right")
    angle = np.degrees(np.unwrap(np.angle(curves.loop)))
    angle -= 360.0 * np.round((angle[0] + 90.0) / 360.0)
    phase.axhline(-180.0, color=MUTED, lw=1.0)
    phase.plot(omega, angle, color=COLOUR["output"])
    phase.set_ylim(max(min(angle.min(), -200.0), -540.0), max(angle.max(), -80.0))
    phase.set_ylabel("[deg]")
    phase.set_xlabel("frequency [rad/s]")
    for ax in (size, phase):
        logarithmic(ax.xaxis, [omega[0], omega[-1]], pad=1.0)


def _nyquist(ax: Axes, curves: Curves) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    ax.plot(np.cos(turn), np.sin(turn), color=MUTED, lw=0.8)
    ax.plot(curves.loop.real, curves.loop.imag, color=COLOUR["output"])
    _complex_plane(ax)


def _play(ax: Axes, curves: Curves) -> None:
    share = np.linspace(0.005, 0.995, 600)
    inverse = -1.0 / curves.play(share)
    told = "$-1/(1-N)$" if curves.of.models_gap else "$-1/N$"
    ax.plot(curves.around_the_play.real, curves.around_the_play.imag, color=COLOUR["output"], label="loop")
    ax.plot(inverse.real, inverse.imag, color=SERIES[1], label=f"play, {told}")
    _complex_plane(ax)
    ax.legend(loc="upper right")


def _complex_plane(ax: Axes) -> None:
    ax.plot([-1.0], [0.0], "+", color=INK, ms=9, mew=1.6)
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlim(-REACH, REACH)
    ax.set_ylim(-REACH, REACH)
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
