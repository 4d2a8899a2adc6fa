"""The figure of a sweep: the right layout for any axes, and no job left out."""

import numpy as np
import pytest
import synthetic
from drawn import overlapping
from PIL import Image

from dtbacklash.report.sweep.figure import PANELS, draw, sweep_figure

CONTROLLERS = ["imc", "nimc_fixed", "nimc_twin", "nimc_novelty"]
ACCEPTANCE = {"controller": CONTROLLERS, "profile": ["s_curve", "step"], "twin.delay_s": [0, 4]}


def drawn(axes_list, kind="done"):
    """Number of markers: plain ones (in data) or failed (crosses) or unsettled (white triangles)."""
    crosses = sum(len(i.get_xdata()) for ax in axes_list for i in ax.lines if i.get_marker() == "x")
    white = sum(len(i.get_xdata()) for ax in axes_list for i in ax.lines if i.get_color() == "white")
    if kind == "failed":
        return crosses
    if kind == "unsettled":
        return white
    data = [i for ax in axes_list for i in ax.lines if i.get_marker() != "x" and i.get_color() != "white"]
    return sum(int(np.isfinite(np.asarray(i.get_xydata(), dtype=float)).all(axis=1).sum()) for i in data)


def test_the_sweep_of_sixteen_jobs_shows_each_once_in_each_panel():
    table = synthetic.sweep_table(ACCEPTANCE)
    table.loc[[4, 9], "settling_time_s_max"] = np.nan
    panels = sweep_figure(table, list(ACCEPTANCE)).axes
    assert len(panels) == 6  # three figures of merit, a column for each delay
    assert drawn(panels, "failed") == 3
    assert drawn(panels, "unsettled") == 2
    assert drawn(panels) == 3 * 15 - 2
    assert [ax.get_title(loc="left") for ax in panels[:2]] == ["twin.delay_s = 0", "twin.delay_s = 4"]
    before = table.assign(status="failed", **dict.fromkeys(PANELS, np.nan))
    table = before.copy()
    assert drawn(sweep_figure(table, list(ACCEPTANCE)).axes, "failed") == 3 * 16
    assert table.equals(before)


@pytest.mark.parametrize(("axis", "values", "shown", "line"), [
    ("twin.delay_s", [8, 0, 4], [0, 4, 8], "-"), ("twin.delay_s", ["8", "0", "16", "4"], [0, 4, 8, 16], "-"),
    ("seed", [2, 0, 1, 4, 3], [0, 1, 2, 3, 4], "None"),
])  # fmt: skip
def test_a_numeric_axis_becomes_a_line_in_rising_order_but_seeds_are_not_joined(axis, values, shown, line):
    curve = sweep_figure(synthetic.sweep_table({axis: values}), [axis]).axes[0].lines[0]
    assert (curve.get_xdata().tolist(), curve.get_linestyle()) == (shown, line)


@pytest.mark.parametrize(
    "axes",
    [
        {},
        {"profile.path": ["/data/a.csv", "/data/b.csv"], "twin.guard": [True, False]},
        {"controller": CONTROLLERS, "twin.delay_s": [0, 1.5, 4]},
        {**ACCEPTANCE, "optimizer": ["bfgs", "lbfgsb"], "seed": [0, 1]},
        {"seed": list(range(40)), "twin.delay_s": list(range(20))},
    ],
    ids=["none", "paths", "mixed", "five", "two long"],
)
def test_any_number_of_axes_gives_a_figure_with_every_job(axes, tmp_path):
    table = synthetic.sweep_table(axes or {"seed": [0, 1]})
    figure = sweep_figure(table, list(axes))
    jobs = int((table["status"] == "done").sum())
    assert drawn(figure.axes) == 3 * jobs
    with Image.open(draw(table, list(axes), tmp_path / "sweep.png")) as image:
        assert image.height < 12_000


def test_one_diverging_job_does_not_hide_the_others():
    table = synthetic.sweep_table(ACCEPTANCE)
    table.loc[5, "overshoot_pct_max"] = 590.0
    top = sweep_figure(table, list(ACCEPTANCE)).axes[0]
    assert top.get_yscale() == "symlog"
    assert top.get_ylim()[1] > 590


def test_missing_values_of_any_kind_are_missing():
    table = synthetic.sweep_table(ACCEPTANCE)
    plain = sweep_figure(table, list(ACCEPTANCE)).axes
    table["n_estimations"] = table["n_estimations"].astype("Int64")
    whole = table["overshoot_pct_max"]
    table["overshoot_pct_max"] = whole.astype(object).where(whole.notna(), None)
    assert drawn(sweep_figure(table, list(ACCEPTANCE)).axes) == drawn(plain)


OPTIMIZERS = ["bfgs", "lbfgsb", "nelder_mead", "differential_evolution", "dual_annealing"]
SWEEPS = {
    "categories": ACCEPTANCE,
    "long names": {"optimizer": OPTIMIZERS, "profile": ["s_curve", "wear"], "twin.delay_s": [0, 4]},
    "many names": {"rig": [f"machine_{j}_of_hall" for j in range(12)]},
    "decades": {"optimizer.tolerance": [1e-6, 1e-4, 1e-2, 0.5], "controller": CONTROLLERS},
    "uneven values": {"twin.buffer": [500, 1000, 2000, 16000], "twin.settle": [0, 100, 200], "seed": [0, 1, 2, 3]},
    "a line a job": {**ACCEPTANCE, "optimizer": OPTIMIZERS[:3], "seed": [0, 1]},
}


#: a job that diverged gives the first panel another scale, and each of its labels another width
@pytest.mark.parametrize(
    ("name", "diverged"), [*((name, True) for name in SWEEPS), ("categories", False), ("decades", False)]
)
def test_no_labels_touch(name, diverged):
    table = synthetic.sweep_table(SWEEPS[name])
    if diverged:
        table.loc[table.index[-1], "overshoot_pct_max"] = 3.2e5
        table["settling_time_s_max"] *= 1e-3
    assert overlapping(sweep_figure(table, list(SWEEPS[name]))) == []


def test_equal_values_of_two_series_are_both_seen():
    table = synthetic.sweep_table({"twin.delay_s": [0, 2, 4], "controller": ["imc", "nimc_twin"]})
    table["overshoot_pct_max"] = 3.0
    lines = [
        line for line in sweep_figure(table, ["twin.delay_s", "controller"]).axes[0].lines if len(line.get_xdata())
    ]
    sizes = [line.get_markersize() for line in lines if line.get_marker() in "os"]
    assert sizes[0] > sizes[1]
