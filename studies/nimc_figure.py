"""The figure of the forms of the internal model: a loop that never comes to rest, and the overshoot over the error."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes

from dtbacklash.report.kit.style import MARKERS, MUTED, SERIES, letter, new_figure, save, styled
from studies import nimc_forms

#: the left panel: true and believed gap, deg; friction, N m; sensors; until, s
SHOWN, UNTIL_S = (0.0, 50.0, 0.0, "encoder"), 6.0
#: the right panel: true gap, deg
TRUE_DEG = 20.0
#: overshoots above are drawn here, %
HIGHEST_PCT = 100.0


def _response(ax: Axes) -> None:
    """q3 of three forms over the first move; `measured` does as `inner_loop`."""
    ax.axhline(1.0, color=MUTED, lw=1.0)
    for form, colour in zip(nimc_forms.FORMS, SERIES, strict=False):
        if form == "measured":
            continue
        trace = nimc_forms.one("nimc_fixed", form, *SHOWN).trace
        early, front = trace["t_s"] < UNTIL_S, form == "inverse"
        ax.plot(trace["t_s"][early], trace["q3_mm"][early], color=colour, lw=2.0 if front else 1.0,
                zorder=3 if front else 2)  # fmt: skip
    ax.set_xlabel("time [s]")
    ax.set_ylabel("q3 [mm]")


def _errors(ax: Axes, grid: pd.DataFrame) -> None:
    """Largest overshoot over the error of the estimate; hollow where moves never settle."""
    part = grid[(grid["structure"] == "nimc") & (grid["true_deg"] == TRUE_DEG) & (grid["amplitude_mm"] == 1.0)]
    part = part.assign(error_pct=(100 * (part["believed_deg"] / TRUE_DEG - 1)).round())
    part = part[part["error_pct"].abs() <= 100]
    for form, colour, marker in zip(nimc_forms.FORMS, SERIES, MARKERS, strict=False):
        worst = part[part["form"] == form].groupby("error_pct").agg({"overshoot_pct": "max", "unsettled": "sum"})
        y = worst["overshoot_pct"].clip(lower=0.1, upper=HIGHEST_PCT)
        ax.plot(worst.index, y, color=colour, lw=1.4, label=form)
        for settles, fill in ((True, colour), (False, "white")):
            of = (worst["unsettled"] == 0) == settles
            ax.plot(worst.index[of], y[of], marker, color=colour, mfc=fill, ms=7, zorder=4)
    ax.set_yscale("log")
    ax.set_xlabel("error of the estimate [%]")
    ax.set_ylabel("largest overshoot [%]")


@styled
def draw(grid: pd.DataFrame, path: Path) -> None:
    """Draw both panels."""
    figure = new_figure(3.9, 9.0)
    left, right = figure.subplots(1, 2)
    _response(left)
    _errors(right, grid)
    true, believed, friction, sensors = SHOWN
    letter([left, right], [
        f"gap {true:g}°, believed {believed:g}°", f"gap {TRUE_DEG:g}°; hollow: not all settle",
    ])  # fmt: skip
    figure.legend(
        *right.get_legend_handles_labels(), loc="outside lower center", ncols=4,
        title=f"(a) friction {friction:g} N m, {sensors}; (b) worst of 0, 0.02 and 0.05 N m, ideal and encoder",
    )  # fmt: skip
    save(figure, path)
