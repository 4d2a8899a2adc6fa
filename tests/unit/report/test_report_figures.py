"""Figures: what is drawn is what was given, nothing global is touched, files are small and repeatable."""

import matplotlib
import numpy as np
import pytest
import synthetic
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.collections import LineCollection
from PIL import Image

from dtbacklash.experiment.metrics import move_table, step_metrics
from dtbacklash.report.components import style
from dtbacklash.report.components.style import envelope
from dtbacklash.report.paper import figures
from dtbacklash.report.run import overview

seeded = settings(deadline=None, derandomize=True)


@pytest.fixture(scope="module")
def estimates():
    return synthetic.estimates_table()


@pytest.fixture(scope="module")
def trace(estimates):
    return synthetic.trace_table(estimates)


def line(ax, label):
    found = [item for item in ax.lines if item.get_label() == label]
    assert len(found) == 1, f"{label} among {[item.get_label() for item in ax.lines]}"
    return found[0]


def labels(ax):
    return [item.get_label() for item in ax.lines]


@seeded
@given(n=st.integers(1, 5000), bins=st.integers(1, 300), seed=st.integers(0, 1000))
def test_the_envelope_keeps_extremes_ends_and_order(n, bins, seed):
    t, y = np.arange(n) * 0.1, np.random.default_rng(seed).standard_normal(n)
    times, values = envelope(t, y, bins)
    assert len(times) == len(values) <= max(2 * bins + 4, 1)
    assert (np.diff(times) > 0).all()
    assert (values.min(), values.max()) == (y.min(), y.max())
    assert (times[0], times[-1]) == (t[0], t[-1])
    assert np.isin(values, y).all()


def test_the_envelope_keeps_a_single_spike_and_a_gap():
    y = np.zeros(200_000)
    y[123_456], y[50_000:60_000] = 47.1, np.nan
    times, values = envelope(np.arange(200_000), y)
    assert len(values) < 3000
    assert 47.1 in values
    assert np.isnan(values[(times > 50_200) & (times < 59_800)]).all()


def step_figure(t, q3, u):
    return figures.response_and_voltage(t, q3, u, step_metrics(t, q3, u, 1.0))


def test_the_step_figure_marks_overshoot_settling_and_peak():
    figure = step_figure(*synthetic.step_response(True))
    top, bottom = figure.axes
    told = " ".join(text.get_text() for ax in (top, bottom) for text in ax.texts)
    assert "overshoot 85.6 %" in told
    assert "settled (±1 %): 3.38 s" in told
    assert "peak 47.1 V" in told
    assert (top.get_ylabel(), bottom.get_ylabel()) == ("$q_3$ [mm]", "$u$ [V]")


def test_the_step_figure_names_neither_an_overshoot_nor_a_settling_time_that_is_not_there():
    t, q3, u = synthetic.step_response(False)
    assert not any("overshoot" in text.get_text() for text in step_figure(t, q3, u).axes[0].texts)
    early = step_figure(t[:300], q3[:300], u[:300])
    assert any("not settled" in text.get_text() for text in early.axes[0].texts)


def test_the_play_figure_shows_twice_the_gap():
    t, motor, screw = synthetic.play(20.0)
    _, right = figures.play_figure(t, motor, screw, 20.0).axes
    assert any("40°" in text.get_text() for text in right.texts)
    upper = line(right, r"$\theta_d = \theta_m \pm \theta_b$")
    assert (upper.get_ydata() - upper.get_xdata()).tolist() == pytest.approx([20.0, 20.0])


def test_accepted_estimates_stand_where_they_were_applied_and_rejected_ones_where_they_were_asked_for(trace, estimates):
    gap = figures.gap_scenario(trace, estimates).axes[1]
    good, bad = estimates[estimates["accepted"]], estimates[~estimates["accepted"]]
    assert line(gap, "accepted").get_xydata().tolist() == good[["t_applied_s", "gap_deg"]].values.tolist()
    assert line(gap, "rejected").get_xdata().tolist() == bad["t_event_s"].tolist()
    # an absurd one leaves the scale alone and is told as a number
    assert gap.get_ylim()[1] < 150
    assert [text.get_text() for text in gap.texts] == ["432°"]


def test_an_estimate_that_comes_after_the_end_is_not_drawn_outside(trace, estimates):
    late = estimates.copy()
    late.loc[8, "t_applied_s"] = 203.0
    assert np.nanmax(line(figures.gap_scenario(trace, late).axes[1], "accepted").get_xdata()) == 165.0
    late.loc[3, "gap_deg"] = np.nan
    assert "none" in [text.get_text() for text in figures.gap_scenario(trace, late).axes[1].texts]


def test_a_controller_without_a_gap_model_has_no_estimate_in_the_figure():
    for guess in (0.0, np.nan):
        gap = figures.gap_scenario(synthetic.trace_table(None).assign(gap_hat_deg=guess)).axes[1]
        assert labels(gap) == [r"actual $\theta_b$"]


def test_the_novelty_figure_has_its_threshold_and_an_event_for_each_estimation(trace, estimates):
    panel = figures.novelty_scenario(trace, estimates.iloc[[2, 4, 6]], 0.1).axes[2]
    assert set(line(panel, "threshold 0.1 mm").get_ydata()) == {0.1}
    assert line(panel, "event").get_xdata().tolist() == estimates["t_event_s"].iloc[[2, 4, 6]].tolist()


@pytest.mark.parametrize("threshold", [None, 0.1])
def test_the_overview_has_the_panels_that_the_run_has(trace, estimates, threshold):
    figure = overview.run_overview(trace, estimates, move_table(trace), threshold)
    units = [ax.get_ylabel() for ax in figure.axes]
    novelty = [] if threshold is None else ["index [mm]"]
    assert units == ["position [mm]", "gap angle [deg]", *novelty, "$u$ [V]"]


def test_without_moves_and_without_a_gap_the_overview_shows_the_tracking_error(trace, estimates):
    still = trace.assign(r_mm=np.sin(trace["t_s"]), gap_deg=0.0, gap_hat_deg=0.0)
    figure = overview.run_overview(still, estimates.iloc[:0], move_table(still))
    assert [ax.get_ylabel() for ax in figure.axes] == ["position [mm]", "$r - q_3$ [mm]", "$u$ [V]"]


def test_every_move_is_laid_over_the_others_from_zero_to_one(trace):
    moves = move_table(trace)
    figure = overview.moves_overlay(trace, moves)
    curves = next(item for item in figure.axes[0].collections if isinstance(item, LineCollection))
    shapes = [path.vertices for path in curves.get_paths()]
    assert len(shapes) == len(moves) == 10
    for shape in shapes:
        assert shape[0] == pytest.approx([0, 0], abs=1e-3)
        assert shape[-1, 1] == pytest.approx(1, abs=0.01)
    assert curves.get_array().tolist() == pytest.approx(synthetic.s_curve(moves["t_s"].to_numpy()).tolist())


def test_one_move_at_a_constant_gap_needs_no_colour_bar(trace):
    part = trace[trace["t_s"] < 10]
    assert len(overview.moves_overlay(part, move_table(part)).axes) == 2
    swings = trace[trace["t_s"] < 40].assign(q3_mm=lambda x: np.sin(30 * x["t_s"]))  # moves that never settle
    assert overview.moves_overlay(swings, move_table(swings)).axes[0].get_xlim()[1] == pytest.approx(3.0)


def test_a_long_trace_makes_a_small_sharp_and_repeatable_file(trace, estimates, tmp_path):
    first, second = (style.save(figures.gap_scenario(trace, estimates), tmp_path / "new" / f"{k}.png") for k in (1, 2))
    assert first.stat().st_size < 300_000
    assert first.read_bytes() == second.read_bytes()
    with Image.open(first) as image:
        assert image.width >= 1200


def test_a_png_is_what_savefig_gives_and_the_labels_of_its_panels_stand_in_one_line(trace, estimates, tmp_path):
    drawn = overview.run_overview(trace, estimates, move_table(trace))
    content = style.png(drawn)
    lefts = [ax.yaxis.label.get_window_extent().x0 for ax in drawn.axes]
    assert lefts == pytest.approx([lefts[0]] * 3, abs=0.01)
    assert lefts[0] > 0
    for ax in drawn.axes:
        assert not any(ax.yaxis.label.get_window_extent().overlaps(text.get_window_extent())
                       for text in ax.get_yticklabels() if text.get_text())  # fmt: skip
    with matplotlib.rc_context(style.RC):
        again = overview.run_overview(trace, estimates, move_table(trace))
        again.savefig(tmp_path / "a.png", metadata={"Software": None}, pil_kwargs={"compress_level": 4})
    assert content == (tmp_path / "a.png").read_bytes()


@settings(seeded, max_examples=15)
@given(
    rows=st.integers(1, 3), columns=st.integers(1, 3), place=st.sampled_from(["upper left", "lower center"]),
    scale=st.sampled_from([1.0, 1e-4, 12345.0]), bar=st.booleans(), equal=st.booleans(),
)  # fmt: skip
def test_labels_legends_and_bars_touch_neither_each_other_nor_the_border(rows, columns, place, scale, bar, equal):
    @style.styled
    def draw():
        figure = style.new_figure(2.6 * rows + 1.0, 4.0 * columns)
        for k, ax in enumerate(axes := figure.subplots(rows, columns, squeeze=False).flat):
            ax.plot([0, 1], [0, scale], label=f"line {k}")
            ax.set(title="title", xlabel="time [s]", ylabel="much\nof it [mm]", aspect=1.0 / scale if equal else "auto")
        if bar:
            style.colour_bar(overview.ScalarMappable(cmap=overview.GAP_MAP), axes[-1], "gap [deg]", 0.8)
        figure.legend(loc=f"outside {place}", ncols=3)
        figure.get_layout_engine().execute(figure)
        return [part.get_tightbbox(figure.canvas.get_renderer()) for part in (*figure.axes, *figure.legends)]

    found = draw()
    width, height = 4.0 * columns * 160, (2.6 * rows + 1.0) * 160
    for k, box in enumerate(found):
        assert (box.min > -1).all()
        assert (box.max < (width + 1, height + 1)).all()
        assert not any(box.overlaps(other) for other in found[:k])
