"""The report of a diagnosis: every verdict in words, whole files, numbers as an engineer writes them."""

import json
import math
import re
from dataclasses import asdict, replace
from io import StringIO

import diagnosed
import numpy as np
import pytest
from page_reader import Reader

from dtbacklash.config.compose import compose
from dtbacklash.diagnose.result import Curve, LawShown
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.drawing import drawing_of, law_curve
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.rig_file import rig_yaml
from dtbacklash.report.diagnosis import page as diagnosis_page
from dtbacklash.report.diagnosis.figures import curve_figure, law_figure, zoom
from dtbacklash.report.diagnosis.methods import methods
from dtbacklash.report.diagnosis.rig_drawing import GLYPHS, chain, draw_rig, label_width, percents
from dtbacklash.report.diagnosis.text import lines
from dtbacklash.report.diagnosis.words import heading
from dtbacklash.report.kit import tables
from dtbacklash.report.kit.intervals import interval, scaled, unit_in_signs
from dtbacklash.report.kit.style import WIDTH


@pytest.fixture(scope="module", params=list(diagnosed.EACH))
def written(request, tmp_path_factory):
    """(diagnosis, folder, text of the page, its reader) for each verdict."""
    made = diagnosed.EACH[request.param]()
    folder = tmp_path_factory.mktemp(request.param)
    diagnosis_page.write(made, folder)
    reader = Reader()
    reader.feed((folder / "report.html").read_text(encoding="utf-8"))
    assert reader.open == []
    return made, folder, re.sub(r"\s+", " ", " ".join(reader.text)), reader


def test_all_files_are_there_and_the_page_needs_none_of_them(written):
    made, folder, _, reader = written
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    figures = ["rig", *(f"curve_{c.name}" for c in made.shown.curves)]
    figures += [f"law_{i + 1}_{law.location}" for i, law in enumerate(made.shown.laws)]
    assert names == {"diagnosis.json", "report.html", "rig.yaml", *(f"figures/{name}.png" for name in figures)}
    images = reader.addresses
    assert len(images) == len(figures)
    assert all(address.startswith("data:image/png;base64,") for address in images)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "http" not in page
    assert len(page) < 1_500_000


def test_the_contents_name_every_section_once(written):
    _, folder, _, reader = written
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert reader.anchors == re.findall(r'<h2 id="(\w+)">', page)
    assert len(reader.anchors) == page.count("<h2")


def test_the_page_holds_what_was_found(written):
    made, _, text, _ = written
    assert heading(made) in text
    assert made.summary in text
    for finding in made.findings:
        assert finding.sentence in text
        for name, p in finding.parameters.items():
            assert f"{name_in_words(name)} {interval(p.value, p.ci95, p.unit)}" in text
    assert text.count("What was found") == 2 * bool(made.findings)
    assert text.count("Recalibrated parameters") == 2 * bool(made.recalibrated)
    assert text.count("What to record next") == 2 * bool(made.next_experiment)
    assert text.count("low score") >= 1 or made.verdict == "parameters"
    assert all(note in text for note in made.notes)
    assert "nan" not in text.replace("nano", "").lower().split()


def test_every_figure_says_what_a_good_one_looks_like(written):
    made, _, text, _ = written
    assert text.count("A good one:") == 1 + len(made.shown.curves) + len(made.shown.laws)


def test_checks_stand_with_statistic_threshold_and_source(written):
    _, _, text, _ = written
    assert "1 of 2 pass" in text
    assert "Residual of q3 is noise 1.03 < 1.2 pass Mean square; more is unexplained. the recording" in text
    assert "Residual of q3 is white 210 < 31.4 fail" in text
    assert "Biometrika 65 (1978) 297" in text


def test_free_running_errors_and_those_of_each_channel_are_said(written):
    _, _, text, _ = written
    assert "held out, on its own 65 times the signal runs away" in text
    assert "theta_m 290 220" in text


def test_the_methods_hold_the_numbers_of_this_diagnosis_and_cite_in_order(written):
    made, _, page, _ = written
    text, works = methods(made)
    assert text in page
    for phrase in ("30000 samples of 1 ms", "fitted to 21000 samples", "judged on the other 9000 (30 %)", "67 effects",
                   "q3 simulated from the measured theta_m"):  # fmt: skip
        assert phrase in text
    cited = [int(number) for number in re.findall(r"\[(\d+)\]", text)]
    assert list(dict.fromkeys(cited)) == list(range(1, len(works) + 1))
    assert ("restoring force" in " ".join(works)) == bool(made.shown.laws)
    assert methods(replace(made, work=None)) == ("", [])


def test_the_json_is_the_diagnosis(written):
    made, folder, _, _ = written
    assert json.loads((folder / "diagnosis.json").read_text(encoding="utf-8")) == made.to_json()


def test_the_rig_runs_from_its_file(written):
    made, folder, text, _ = written
    again = build_rig(compose("controller=open_loop", f"rig={folder / 'rig.yaml'}").rig)
    assert again.elements == made.extended.elements
    assert again.effects == made.extended.effects
    assert again.sensors == made.extended.sensors
    assert again.config.parameters == made.extended.config.parameters
    command = re.search(r"dtb run rig=rig.yaml(?: controller=open_loop)?", text)
    words = [w.replace("rig.yaml", str(folder / "rig.yaml")) for w in command.group().split()[2:]]
    assert compose(*words).rig.name == made.nominal.config.name  # what the page says is accepted as it stands


def test_verdicts_in_words():
    said = {name: heading(make()) for name, make in diagnosed.EACH.items()}
    assert said == {
        "missing": "Missing: Coulomb friction at the motor bearing and backlash at the gear",
        "drifting": "Missing: Coulomb friction, viscous friction and constant force at the carriage",
        "parameters": "No physics is missing; recalibrate k",
        "consistent": "The model explains this recording",
        "unexplained": "Unexplained: something acts at the motor bearing that the catalogue does not hold",
    }


def test_an_unexplained_rest_beside_named_physics_is_placed():
    made = diagnosed.missing()
    rest = diagnosed.unexplained().located
    left = replace(made, verdict="unexplained", findings=made.findings[:1], located=replace(rest, location="link_1"))
    assert heading(left) == (
        "Unexplained: beside Coulomb friction at the motor bearing, something acts at the link 1 that the "
        "catalogue does not hold"
    )


def test_what_cannot_be_told_apart_and_the_chosen_candidates_stand_out(tmp_path):
    diagnosis_page.write(diagnosed.missing(), tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "This recording cannot tell it from:</b> dead zone at the amplifier." in page
    assert page.count('<tr class="chosen">') == 2
    rows = re.findall(r"<tr(?: class=\"chosen\")?><td>([^<]*)</td><td>", page)
    assert rows[:3] == ["Coulomb friction", "backlash", "dead zone"]
    assert "4 more" in re.sub(r"\s+", " ", page)


def test_text_from_outside_is_escaped(tmp_path):
    odd = replace(diagnosed.consistent(), source="<script>x</script>", notes=("a < b & c",))
    diagnosis_page.write(odd, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script>" not in page
    assert "a &lt; b &amp; c" in page


def test_percentages_add_up_and_nothing_is_painted_where_there_is_no_evidence():
    thirds = percents({"a": 1 / 3, "b": 1 / 3, "c": 1 / 3})
    assert sorted(thirds.values()) == ["33 %", "33 %", "34 %"]
    assert percents({"a": 0.998, "b": 0.002}) == {"a": "100 %", "b": "< 1 %"}
    assert percents({}) == {}
    rig = diagnosed.rig("lead_screw")
    words = [text.get_text() for text in draw_rig(rig, {}, []).axes[0].texts]
    assert not any("%" in word for word in words)
    words = [text.get_text() for text in draw_rig(rig, {"gear": 0.6, "sensor_q3": 0.4}, []).axes[0].texts]
    assert [word for word in words if "%" in word] == ["60 %", "q3  40 %"]


@pytest.mark.parametrize(
    ("value", "ci95", "unit", "text"),
    [
        (0.02, [0.0195, 0.0205], "N m", "20.0 ± 0.5 mN m"),
        (0.02, [0.0198, 0.0202], "N m", "20.00 ± 0.20 mN m"),
        (9020.0, [9001.0, 9039.0], "N/m", "9020 ± 19 N/m"),
        (1.02e10, [0.99e10, 1.05e10], "N/m^3", "10200 ± 300 MN/m³"),
        (5.1e-6, [5.02e-6, 5.18e-6], "kg m^2", "(5.10 ± 0.08) \N{MULTIPLICATION SIGN} 10⁻⁶ kg m²"),
        (0.05, [0.04, 0.06], "1", "(5.0 ± 1.0) %"),
        (-3.16, [-3.3, -3.02], "N", "-3.16 ± 0.14 N"),
        (20.3, [19.8, 21.4], "N", "20.3 (19.8 to 21.4) N"),
        (1.3e-3, [1.29e-3, 1.31e-3], "s", "1.300 ± 0.010 ms"),
        (12.0, [None, 14.0], "ohm", "12, at most 14 Ω"),
        (12.0, [11.0, math.inf], "ohm", "12, at least 11 Ω"),
        (12.0, None, "ohm", "12 Ω"),
        (0.0, [-0.1, 0.1], "N", "0.00 ± 0.10 N"),
        (24.0, [24.0, 24.0], "1/rev", "24.00 ± 0.00 1/rev"),
    ],
)
def test_intervals(value, ci95, unit, text):
    assert interval(value, ci95, unit) == text


def test_an_interval_for_a_plain_terminal_is_ascii():
    assert interval(5.1e-6, [5.02e-6, 5.18e-6], "kg m^2", plain=True) == "(5.10 +/- 0.08)e-6 kg m^2"
    assert interval(2e-5, [1e-5, 3e-5], "m", plain=True) == "20 +/- 10 um"


def test_values_to_be_compared_share_their_unit():
    assert interval(9020.0, [9001.0, 9039.0], "N/m", size=10000.0) == "9.020 ± 0.019 kN/m"


@pytest.mark.parametrize(
    ("unit", "size", "found"),
    [("m", 4.0, (1.0, "m")), ("m", 4e4, (1.0, "m")), ("m", 5e-7, (1e-6, "µm")), ("N", 2e4, (1e3, "kN")),
     ("m^2", 1e-4, (1.0, "m^2")), ("kg", 1e-4, (1.0, "kg")), ("N", 0.0, (1.0, "N")), ("1", 0.3, (0.01, "%"))],
)  # fmt: skip
def test_prefixes(unit, size, found):
    assert scaled(unit, size) == found


def test_units_in_signs():
    assert unit_in_signs("N s^2/m^2") == "N s²/m²"
    assert unit_in_signs("ohm") == "Ω"


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


def test_residuals_are_measured_minus_model_each_in_its_own_scale():
    figure = curve_figure(curve(extended=np.sin(9 * np.arange(2000) * 1e-3) - 2e-6))
    assert [ax.get_ylabel() for ax in figure.axes[::2]] == [
        "q3 [m]",
        "measured \N{MINUS SIGN}\nnominal [m]",
        "measured \N{MINUS SIGN}\nextended [µm]",
    ]
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
    from dtbacklash.physics.kinds import KINDS

    missing = set(KINDS) - set(GLYPHS)
    assert missing <= {"base"}, f"elements drawn without a picture: {missing}"


def long_chain(masses=9):
    """A force on a row of masses."""
    config = diagnosed.rig("silverbox").config
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
    figure = draw_rig(diagnosed.rig("lead_screw"), {}, labels)
    figure.canvas.draw()
    boxes = [t.get_bbox_patch().get_window_extent() for t in figure.axes[0].texts if t.get_bbox_patch() is not None]
    assert len(boxes) == 5
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0 for box in boxes)


def test_the_width_of_a_label_is_enough_for_its_box():
    text = "viscous friction\n0.3490 ± 0.0009 mN m s/rad"
    figure = draw_rig(diagnosed.rig("lead_screw"), {}, [("screw", text)])
    figure.canvas.draw()
    (box,) = (t.get_bbox_patch().get_window_extent() for t in figure.axes[0].texts if t.get_bbox_patch() is not None)
    assert box.width / figure.dpi <= label_width(text)


def test_a_chain_follows_its_neighbours_in_whatever_order_it_was_written():
    rig = long_chain(4)
    walk = ["amplifier", "source", "mass_1", "link_1", "link_2", "mass_2", "link_3", "mass_3", "link_4", "mass_4"]
    assert chain(rig) == walk
    assert chain(diagnosed.rig("lead_screw")) == list(diagnosed.rig("lead_screw").elements)


def test_the_terminal_says_the_same_in_letters_that_it_has():
    text = "\n".join(line.plain for line in lines(diagnosed.missing()))
    assert text.startswith("missing_physics: Missing: Coulomb friction at the motor bearing and backlash at the gear")
    for phrase in (
        "  torque = 20.0 +/- 0.5 mN m",
        "  this recording cannot tell it from dead zone at the amplifier",
        "  k = 9.020 +/- 0.019 kN/m (nominal 10 kN/m)",
        "Checks: 1 of 2 pass; it fails that residual of q3 is white.",
        "To record next: Record the motor current i_m",
    ):
        assert phrase in text
    assert text.isascii()


def test_the_table_of_errors():
    out = StringIO()
    tables.show(tables.fit(asdict(diagnosed.missing().fit)), file=out)
    assert re.search(r"held out\s*\|\s*12 %\s*\|\s*9.1 %\s*\|\s*0.042 %\s*\|\s*0.041 %", out.getvalue())
    out = StringIO()
    tables.show(tables.fit(asdict(diagnosed.consistent().fit)), file=out)
    assert "extended" not in out.getvalue()


@pytest.mark.parametrize("name", ["lead_screw", "emps", "silverbox"])
def test_a_rig_written_and_read_again_is_the_same(name, tmp_path):
    rig = diagnosed.rig(name)
    file = tmp_path / "again.yaml"
    file.write_text(rig_yaml(rig), encoding="utf-8")
    assert build_rig(compose("controller=open_loop", f"rig={file}").rig) == rig


def test_odd_values_survive_the_file(tmp_path):
    rig = diagnosed.rig("lead_screw").with_effect("link_1", "cubic_stiffness", {"k3": 1e10 / 3})
    rig = rig.with_effect("sensor_q3", "offset", {"offset": np.float64(1e-7)}).with_parameters({"J": 1e-5 / 3})
    file = tmp_path / "odd.yaml"
    file.write_text(rig_yaml(rig), encoding="utf-8")
    again = build_rig(compose("controller=open_loop", f"rig={file}").rig)
    assert again.effects == rig.effects
    assert again.elements == rig.elements
