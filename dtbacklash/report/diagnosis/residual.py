"""Figures beside the page: what a model leaves of a channel, and the profile likelihood of a parameter."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import welch

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.plot_data import Curve, Profile
from dtbacklash.report.components.intervals import scaled, unit_in_signs
from dtbacklash.report.components.style import INK, MUTED, envelope, new_figure, styled
from dtbacklash.report.diagnosis.figures import EXTENDED, NOISE, NOMINAL, _broken

#: lags of the autocorrelation; samples of a segment of the spectrum; 95 % of a normal distribution
LAGS, SEGMENT, NORMAL95 = 100, 1024, 1.96
#: values of a profile that span more than this ratio are drawn over a logarithm
WIDE = 10.0


@styled
def residual_figure(curve: Curve) -> Figure:
    """Measured minus model over time; below it the autocorrelation with the 95 % band of white noise, and the spectrum.

    curve: one channel.
    """
    left = np.nan_to_num(curve.measured - curve.extended)
    factor, unit = scaled(curve.unit, float(np.abs(left).max()) or (curve.noise_floor or 0.0))
    figure = new_figure(5.4)
    axes = figure.subplot_mosaic([["time", "time"], ["lags", "spectrum"]])
    axes["time"].plot(*envelope(*_broken(curve.t_s, left / factor)), color=EXTENDED, lw=0.9)
    if curve.noise_floor:
        band = 2.0 * curve.noise_floor / factor
        axes["time"].axhspan(-band, band, color="#00805f", alpha=0.22, lw=0, label=NOISE)
        figure.legend(loc="outside upper left")
    axes["time"].set_xlim(curve.t_s[0], curve.t_s[-1])
    axes["time"].set_xlabel("time [s]")
    axes["time"].set_ylabel(f"left of {curve.name} [{unit_in_signs(unit)}]")
    step_s, correlation = float(np.diff(curve.t_s).min()), autocorrelation(left)
    axes["lags"].vlines(step_s * np.arange(1, len(correlation)), 0.0, correlation[1:], color=EXTENDED, lw=1.1)
    chance = NORMAL95 / math.sqrt(len(left))
    axes["lags"].axhspan(-chance, chance, color=MUTED, alpha=0.25, lw=0)
    reach = 1.1 * max(float(np.abs(correlation[1:]).max(initial=0.0)), 2.0 * chance)
    axes["lags"].set_ylim(-reach, reach)
    axes["lags"].axhline(0.0, color=INK, lw=0.7)
    axes["lags"].set_xlabel("lag [s]")
    axes["lags"].set_ylabel("autocorrelation")
    hertz, power = welch(left / factor, 1.0 / step_s, nperseg=min(SEGMENT, len(left)))
    axes["spectrum"].loglog(hertz[1:], np.maximum(power[1:], np.finfo(float).tiny), color=EXTENDED, lw=1.0)
    axes["spectrum"].set_xlabel("frequency [Hz]")
    axes["spectrum"].set_ylabel(f"spectrum [{unit_in_signs(unit)}²/Hz]")
    return figure


@styled
def profile_figure(found: Profile, unit: str, nominal: float | None = None) -> Figure:
    """The rise of -2 log likelihood over the values of a parameter, and the parabola of its standard error.

    unit : of the values, SI. nominal : the value that the rig gives, if it is near.
    """
    factor, shown = scaled(unit, float(np.abs(found.values).max()))
    figure = new_figure(3.9)
    ax = figure.subplots()
    fine = np.linspace(found.values[0], found.values[-1], 200)
    with np.errstate(divide="ignore", invalid="ignore"):
        parabola = ((fine - found.fitted) / found.error) ** 2
    ax.plot(fine / factor, parabola, color=MUTED, lw=1.2, ls=(0, (4, 2)), label="of the standard error")
    ax.plot(found.values / factor, found.rises, "o-", color=EXTENDED, lw=2.0, ms=4.5, label="all others fitted anew")
    ax.axhline(NORMAL95**2, color=INK, lw=0.7, label="ends of a 95 % interval")
    if nominal is not None and found.values[0] <= nominal <= found.values[-1]:
        ax.axvline(nominal / factor, color=NOMINAL, lw=1.2, ls=(0, (1, 1.5)), label="nominal")
    if found.values[0] > 0.0 and found.values[-1] > WIDE * found.values[0]:
        ax.set_xscale("log")
    ax.set_ylim(0.0, 1.1 * max(float(found.rises.max()), NORMAL95**2))
    ax.set_xlabel(f"{found.title} [{unit_in_signs(shown)}]")
    ax.set_ylabel("rise of $-2 \\log$ likelihood")
    figure.legend(loc="outside upper left", ncols=2, columnspacing=1.6)
    return figure


def autocorrelation(values: Floats, lags: int = LAGS) -> Floats:
    """(K,) The correlation of a signal with itself, from lag 0 to ``lags`` samples; 0 where it does not move."""
    away = values - values.mean()
    power = float(away @ away)
    count = min(lags + 1, len(away))
    return (
        np.array([away[: len(away) - k] @ away[k:] for k in range(count)]) / power if power > 0.0 else np.zeros(count)
    )
