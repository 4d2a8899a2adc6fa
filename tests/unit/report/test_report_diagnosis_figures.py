"""The figures of a diagnosis: signals with what is left over, laws, and the rig as a chain."""

from dataclasses import replace

import diagnosed
import numpy as np
import pytest
from nominal import nominal_rig

from dtbacklash.diagnosis.plot_data import Curve, LawShown
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.drawing import drawing_of, law_curve
from dtbacklash.physics.rig import build_rig
from dtbacklash.report.components.style import WIDTH
from dtbacklash.report.diagnosis.figures import curve_figure, law_figure, zoom
from dtbacklash.report.diagnosis.rig_drawing import GLYPHS, chain, draw_rig, label_width


def curve(n=2000, held=1.4, **more):
    t = np.arange(n) * 1e-3
    return Curve("q3", "m", t, np.sin(9 * t), **({"nominal": np.zeros(n), "extended": np.sin(9 * t)} | more),
                 held_out_from_s=held)  # fmt: skip


def test_the_closer_look_is_where_the_nominal_model_errs_in_held_out_data():
    t = np.arange(2000) * 1e-3
    bump = np.sin(400 * t) * ((t > 1.7) & (t < 1.8)) + 5 * np.sin(400 * t) * (t < 0.2)
    begin, end = zoom(curve(nominal=np.sin(9 * t) + bump))
    assert 1.6 < begin < 1.75 < end < 1.9
    assert end - begin == pytest.approx(0.139)


def test_a_short_record_is_looked_at_as_a_whole():
    assert zoom(curve(n=100, held=0.07)) == (0.0, pytest.approx(0.099))


def test_a_nominal_model_far_away_does_not_flatten_the_measurement():
    t = np.arange(2000) * 1e-3
    figure = curve_figure(curve(nominal=50 * t**2))
    low, high = figure.axes[0].get_ylim()
    assert (low, high) == (pytest.approx(-1.2, abs=0.1), pytest.approx(1.52, abs=0.1))
    assert "nominal model: up to 200 m" in [text.get_text() for text in figure.axes[0].texts]


@pytest.mark.parametrize("far", [np.inf, np.nan, 1e300, -1e9])
def test_models_that_ran_away_are_noted_and_flatten_nothing(far):
    values = np.sin(9 * np.arange(2000) * 1e-3)
    values[700:] = far
    figure = curve_figure(curve(nominal=2 * values, extended=values))
    low, high = figure.axes[0].get_ylim()
    assert -2.0 < low < high < 2.0
    notes = [text.get_text() for text in figure.axes[0].texts]
    assert notes == ["nominal model: runs away", "extended model: runs away"]
    figure.canvas.draw()


def test_residuals_are_measured_minus_model_each_in_its_own_scale():
    figure = curve_figure(curve(extended=np.sin(9 * np.arange(2000) * 1e-3) - 2e-6))
    assert [ax.get_ylabel() for ax in figure.axes[::2]] == [
        "q3 [m]", "measured \N{MINUS SIGN}\nnominal [m]", "measured \N{MINUS SIGN}\nextended [µm]",
    ]  # fmt: skip
    assert figure.axes[4].lines[0].get_ydata() == pytest.approx(2.0, rel=1e-6)


def test_models_that_agree_get_one_residual():
    same = curve(extended=np.zeros(2000))
    assert len(curve_figure(same).axes) == 4
    legend = [text.get_text() for text in curve_figure(same).legends[0].get_texts()]
    assert legend == ["measured", "nominal model", "held out"]


@pytest.mark.parametrize("effect", ["coulomb_friction", ""])
def test_a_law_is_drawn_where_there_is_one(effect):
    figure = law_figure(diagnosed.friction_law(effect))
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("fitted law: Coulomb friction" in legend) == bool(effect)
    assert figure.axes[0].get_ylabel() == "missing torque [mN m]"


def test_law_and_points_share_their_units():
    figure = law_figure(diagnosed.friction_law())
    (law,) = (line for line in figure.axes[0].lines if line.get_label() == "fitted law: Coulomb friction")
    assert np.abs(law.get_ydata()).max() == pytest.approx(20.0)
    points = figure.axes[0].containers[0].lines[0].get_ydata()
    assert np.abs(points).max() == pytest.approx(20.0, rel=0.1)


def test_a_play_is_a_loop_of_output_over_input():
    loop = law_curve(drawing_of(find("gear", "backlash", "")), {"half_gap": 0.1}, {}, (-0.3, 0.3))
    shown = LawShown("gear", "backlash", "angle of gear", "angle behind the gap", "rad", "rad", *loop)
    ax = law_figure(shown).axes[0]
    assert [line.get_label() for line in ax.lines][:2] == ["without it", "fitted law: backlash"]
    state, effort = ax.lines[1].get_data()
    assert (state[0], effort[0]) == (pytest.approx(state[-1]), pytest.approx(effort[-1]))


def test_an_unknown_point_does_not_set_the_scale():
    law = diagnosed.friction_law()
    wild = replace(law, recovered=np.append(law.recovered[:-1], 5.0), error=np.append(law.error[:-1], 9.0))
    assert law_figure(wild).axes[0].get_ylim()[1] < 30.0


def test_a_law_without_points_is_drawn_alone():
    none = np.empty(0)
    assert law_figure(replace(diagnosed.friction_law(), state=none, recovered=none, error=none)).axes


def test_every_kind_of_element_has_a_glyph():
    from dtbacklash.physics.element_kinds import KINDS

    missing = set(KINDS) - set(GLYPHS)
    assert missing <= {"base"}, f"elements drawn without a picture: {missing}"


def long_chain(masses=9):
    """A force on a row of masses."""
    config = nominal_rig("silverbox").config
    elements = dict(config.elements)
    for k in range(2, masses + 1):
        elements[f"mass_{k}"] = {"kind": "mass", "mass": "m"}
        elements[f"link_{k}"] = {"kind": "link", "between": [f"mass_{k - 1}", f"mass_{k}"], "stiffness": "k"}
    return build_rig(replace(config, elements=elements))


def test_a_long_chain_goes_on_in_a_second_row_and_nothing_leaves_the_paper():
    rig = long_chain()
    figure = draw_rig(
        rig, {"mass_9": 1.0}, [("link_9", "cubic stiffness\n1"), ("mass_9", "absorber"), ("sensor_y", "offset")]
    )
    ax = figure.axes[0]
    names = {text.get_text(): text.get_position() for text in ax.texts}
    assert set(rig.elements) <= set(names)
    assert len({round(names[name][1], 6) for name in rig.elements}) == 2
    assert all(0.2 < x < WIDTH - 0.2 and ax.get_ylim()[0] < y < 0 for x, y in names.values())


def test_labels_do_not_touch_each_other():
    size = "\n20.00 ± 0.05 mN m"
    places = ["motor_bearing", "gear", "mass_3", "sensor_q3", "motor_bearing"]
    labels = [(place, "constant force" + size) for place in places]
    figure = draw_rig(nominal_rig("lead_screw"), {}, labels)
    figure.canvas.draw()
    boxes = [t.get_bbox_patch().get_window_extent() for t in figure.axes[0].texts if t.get_bbox_patch() is not None]
    assert len(boxes) == 5
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0 for box in boxes)


def test_the_width_of_a_label_is_enough_for_its_box():
    text = "viscous friction\n0.3490 ± 0.0009 mN m s/rad"
    figure = draw_rig(nominal_rig("lead_screw"), {}, [("screw", text)])
    figure.canvas.draw()
    (box,) = (t.get_bbox_patch().get_window_extent() for t in figure.axes[0].texts if t.get_bbox_patch() is not None)
    assert box.width / figure.dpi <= label_width(text)


def test_a_chain_follows_its_neighbours_in_whatever_order_it_was_written():
    rig = long_chain(4)
    walk = ["amplifier", "source", "mass_1", "link_1", "link_2", "mass_2", "link_3", "mass_3", "link_4", "mass_4"]
    assert chain(rig) == walk
    assert chain(nominal_rig("lead_screw")) == list(nominal_rig("lead_screw").elements)
