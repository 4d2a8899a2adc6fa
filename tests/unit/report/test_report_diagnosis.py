"""The report of a diagnosis: every verdict in words, whole files, numbers as an engineer writes them."""

import json
import math
import re
import warnings
from dataclasses import replace
from io import StringIO

import diagnosed
import numpy as np
import pytest
from nominal import nominal_rig
from page_reader import Reader

from dtbacklash.config.compose import compose
from dtbacklash.diagnosis.findings import Alternative, Blind, Calibration, Evidence, Ground, Recalibrated
from dtbacklash.diagnosis.plot_data import ModelErrors, RecordingUsed
from dtbacklash.physics.effects.declare import name_in_words
from dtbacklash.physics.rig import build_rig
from dtbacklash.report.components import tables
from dtbacklash.report.components.intervals import interval, scaled
from dtbacklash.report.components.numbers import percent
from dtbacklash.report.diagnosis import page as diagnosis_page
from dtbacklash.report.diagnosis.methods import methods
from dtbacklash.report.diagnosis.rig_drawing import draw_rig
from dtbacklash.report.diagnosis.text import lines
from dtbacklash.report.diagnosis.words import capital, causes, heading, left, next_command, percents, together


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


@pytest.fixture
def page_of(tmp_path, undrawn):
    """The page of a diagnosis, its figures not drawn."""

    def write(made):
        diagnosis_page.write(made, tmp_path)
        return (tmp_path / "report.html").read_text(encoding="utf-8")

    return write


def printed(made):
    """What the terminal shows."""
    out = StringIO()
    tables.show(*lines(made), file=out)
    return out.getvalue()


def test_there_is_no_empty_box_and_the_checks_come_after_the_answer(page_of):
    made = replace(diagnosed.missing(), next_experiment="Nothing is ambiguous.")
    made = replace(made, checks=tuple(replace(c, passed=False) for c in made.checks))
    page = page_of(made)
    assert re.search(r"<pre>\s*</pre>", page) is None
    assert page.index("What next") < page.index("checks pass. These checks fail")
    assert "checks pass" not in page.partition("<table")[0]


def test_causes_are_only_what_had_to_move():
    """A parameter that moved beside another one, and may well be as it was given, is none of them."""
    made = diagnosed.parameters()
    (name, row), *_ = made.recalibrated.items()
    beside = Recalibrated(0.02, 0.0206, "kg", (0.019, 0.0222))
    both = replace(made, recalibrated={name: row, "m": beside})
    assert heading(both) == heading(made)
    assert len(causes(both).rows) == len(causes(made).rows)
    alone = replace(made, recalibrated={name: replace(row, ci95=(8000.0, 11000.0))})
    assert len(causes(alone).rows) == len(causes(made).rows)  # where there is nothing else


def test_what_nobody_notices_is_not_given_in_powers_of_ten(page_of):
    made = diagnosed.parameters()
    (name, row), *_ = made.recalibrated.items()
    rows = {name: row, "m": Recalibrated(5.2, 5.2 * (1.0 - 2.03e-11), "kg", (5.1, 5.3))}
    made = replace(made, calibration=Calibration(rows, {n: {m: float(n == m) for m in rows} for n in rows}, ()))
    shown = page_of(made).partition("diagnosis.json</h2>")[0]
    assert "-2.03e-09 %" not in shown + printed(made)
    assert re.search(r"10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+ %|e-?\d+ %", shown + printed(made)) is None
    assert [percent(x) for x in (2e-11, 2e-4, 0.0, 1.0)] == ["< 0.001 %", "0.02 %", "0 %", "100 %"]


@pytest.mark.parametrize(("rig", "more"), [("lead_screw", ""), ("emps", " controller=open_loop")])
def test_the_next_command_is_complete(rig, more):
    made = replace(next(iter(diagnosed.EACH.values()))(), extended=nominal_rig(rig))
    assert next_command(made, "my found/rig.yaml") == f"dtb run 'rig=my found/rig.yaml'{more}"


def test_the_page_has_the_correlations_and_the_blind_directions(page_of):
    rows = {name: Recalibrated(1.0, 1.1, "kg", (1.0, 1.2)) for name in ("m", "k")}
    blind = Blind({"m": 1.0, "k": 1.0}, 9.0, "`m` and `k` can grow alike: the recording does not notice.")
    found = Calibration(rows, {"m": {"m": 1.0, "k": 0.97}, "k": {"m": 0.97, "k": 1.0}}, (blind,))
    made = replace(diagnosed.consistent(), calibration=found)
    page = page_of(made)
    assert "<code>m</code> and <code>k</code> can grow alike" in page
    assert re.search(r">m</span></td>\s*<td[^>]*><span>k</span></td>\s*<td[^>]*><span>0.97<", page)
    assert made.to_json()["calibration"]["blind"][0]["tolerances"] == 9.0
    assert "m and k can grow alike" in printed(made)
    assert "+0.97 with k" in printed(made)


def test_all_files_are_there_and_the_page_needs_none_of_them(written):
    made, folder, _, reader = written
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    figures = ["judged", "rig", *(f"curve_{c.name}" for c in made.shown.curves)]
    figures += [f"law_{i + 1}_{law.location}" for i, law in enumerate(made.shown.laws)]
    assert names == {"diagnosis.json", "report.html", "rig.yaml", *(f"figures/{name}.png" for name in figures)}
    images = reader.addresses
    assert len(images) == len(figures)
    assert all(address.startswith("data:image/png;base64,") for address in images)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "://" not in page
    assert len(page) < 1_900_000


def test_the_first_screen_answers_and_all_else_is_folded(written):
    made, folder, *_ = written
    assert json.loads((folder / "diagnosis.json").read_text(encoding="utf-8")) == made.to_json()
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count('<span class="good-one">') == len(made.shown.curves) + len(made.shown.laws)
    first = page[: page.index("<details")]
    marks = ["<h1>", '<table class="causes">', "<figure>", "What is left", "dtb run rig=rig.yaml"]
    there = [mark for mark in marks if mark in first]
    assert there == [mark for mark in marks if mark != marks[1] or causes(made).rows]
    assert [first.index(mark) for mark in there] == sorted(first.index(mark) for mark in there)
    assert page.count("<h2") == page.count("<summary><h2") + first.count("<h2")
    assert page.count("<summary><h2") >= 8
    assert "`" not in re.sub(r"<pre>.*?</pre>", "", page, flags=re.DOTALL)


def test_the_page_holds_what_was_found(written):
    made, _, text, _ = written
    assert heading(made) in text
    assert made.summary in text
    for finding in made.findings:
        for name, p in finding.parameters.items():
            assert f"{name_in_words(name)} {interval(p.value, p.ci95, p.unit)}" in text
    for row in (*causes(made).rows, *left(made).rows):
        assert all(" ".join(cell.split()) in text for cell in row)
    assert made.next_experiment in text
    assert text.count("low score") >= 1 or made.verdict == "parameters"
    assert all(note in text for note in made.notes)
    assert "nan" not in text.replace("nano", "").lower().split()
    checks = [
        "1 of 2 pass", "Residual of q3 is white 210 < 31.4 fail", "Biometrika 65 (1978) 297",
        "Residual of q3 is noise 1.03 < 1.2 pass Mean square; more is unexplained. (the recording)",
    ]  # fmt: skip
    assert [said for said in checks if said not in text] == []
    assert text.index(checks[1]) < text.index(checks[3])
    assert "held out, on its own over 1000 % runs away" in text
    assert "theta_m 290 220" in text


def test_a_cause_has_its_place_law_size_doubt_and_share():
    rows = causes(diagnosed.missing(), plain=True).rows
    assert rows == [
        ["motor bearing", "Coulomb friction", "torque 20.0 +/- 0.5 mN m",
         "open against dead zone at the amplifier", "45 %"],
        ["gear", "backlash", "half gap 0.3490 +/- 0.0009 rad", "sure", "30 %"],
        ["mass 1, link 1, link 2", "k, stiffness between two platforms",
         "9.020 +/- 0.019 kN/m\ninstead of 10 kN/m", "0.98 tolerances away", "5 %"],
        ["motor bearing", "J, motor inertia",
         "(5.10 +/- 0.08)e-6 kg m^2\ninstead of 5e-6 kg m^2", "0.4 tolerances away", "5 %"],
    ]  # fmt: skip
    assert causes(diagnosed.consistent()).rows == []
    ((place, law, size, sure, share),) = causes(diagnosed.unexplained()).rows
    assert (place, law, sure, share) == ("motor bearing", "unexplained", "open", "100 %")
    assert size == "2 mN m rms\n10 % of what acts on it"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, "sure"),
        ({"confidence": "partial"}, "open"),
        (
            {"confidence": "partial", "evidence": Evidence(Ground(True), Ground(True), Ground(True))},
            "open: much is left",
        ),
        (
            {"confidence": "one_of", "also_fits": (Alternative("gear", "compliance"),)},
            "sure as one of: backlash or compliance",
        ),
        (
            {"confidence": "partial", "evidence": Evidence(Ground(False), Ground(False), Ground(True))},
            "open: where and which law",
        ),
        ({"confidence": "partial", "evidence": Evidence(Ground(True), Ground(False), Ground(True))}, "open: which law"),
        (
            {"confidence": "partial", "evidence": Evidence(Ground(True), Ground(True), Ground(False))},
            "open: it may not be there",
        ),
        (
            {"confidence": "partial", "also_fits": (Alternative("gear", "backlash"),)},
            "open against backlash at the gear",
        ),
    ],
)
def test_what_is_open_of_a_name_is_said(change, said):
    made = diagnosed.missing()
    made = replace(made, findings=(replace(made.findings[1], **change),))
    assert causes(made).rows[0][3] == said


@pytest.mark.parametrize(
    ("read", "unit", "left_at_q3"), [("mm", "mm", 1.0), ("m", "m", 1e-3), ("m (assumed)", "mm", 1.0)]
)
def test_what_is_left_is_in_the_unit_that_was_read(read, unit, left_at_q3):
    made = replace(diagnosed.missing(), units={"q3": read})
    row = next(row for row in left(made, plain=True).rows if row[0].startswith("q3"))
    assert row[0] == f"q3 [{unit}]"
    assert float(row[2]) == pytest.approx(left_at_q3 * diagnosed.NOISE["q3"] * 1e3, rel=0.05)
    assert float(row[4]) == pytest.approx(left_at_q3 * diagnosed.NOISE["q3"] * 1e3)


def test_the_methods_hold_the_numbers_of_this_diagnosis_and_cite_in_order(written):
    made, _, page, _ = written
    text, works = methods(made)
    assert text in page
    for phrase in ("30000 samples of 1 ms", "fitted to 24000 samples", "judged on the other 6000 (20 %)", "67 effects",
                   "the mean of 2 samples", "the best 8 were fitted in full", "by 3 standard errors"):  # fmt: skip
        assert phrase in text
    cited = [int(number) for number in re.findall(r"\[(\d+)\]", text)]
    assert list(dict.fromkeys(cited)) == list(range(1, len(works) + 1))
    assert ("restoring force" in " ".join(works)) == bool(made.shown.laws)
    assert methods(replace(made, work=None)) == ("", [])


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


def test_several_recordings_have_a_row_each(page_of, tmp_path):
    zeros = {"q3": {"value": 2e-3, "unit": "m"}}
    used = (
        RecordingUsed("a.csv", 900, 1e-3, 700, 200, ModelErrors(0.5, 0.4, 0.01)),
        RecordingUsed("b.csv", 500, 2e-3, 500, 0, None, zeros),
    )
    made = replace(diagnosed.missing(), recordings=used, source="a.csv, b.csv")
    page = page_of(made)
    assert "Recordings a.csv, b.csv, compared" in page
    rows = [
        re.findall(r"<td[^>]*><span>(.*?)</span></td>", row) for row in re.findall(r"<tr>.*?</tr>", page, re.DOTALL)
    ]
    rows = [row for row in rows if row[1:2] and row[1].endswith(".csv")]
    assert rows == [
        ["1", "a.csv", "900", "1 ms", "50 %", "40 %", "1 %", "-"],
        ["2", "b.csv", "500", "2 ms", "-", "-", "-", "q3 2 mm"],
    ]
    assert "2 recordings, together" in methods(made)[0]
    found = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))["recordings"]
    assert "zeros" not in found[0]
    assert found[1]["zeros"] == zeros
    assert found[1]["held_out"] is None
    assert "recordings" not in diagnosed.missing().to_json()


def test_verdicts_in_words():
    said = {name: heading(make()) for name, make in diagnosed.EACH.items()}
    assert said == {
        "missing": "Missing: Coulomb friction at the motor bearing and backlash at the gear",
        "drifting": "Missing: Coulomb friction, viscous friction and constant force at the carriage",
        "parameters": "No physics is missing; recalibrate k",
        "consistent": "The model explains this recording",
        "unexplained": "Unexplained: more than noise is left at the motor bearing",
    }


@pytest.mark.parametrize(
    ("name", "enough", "said"),
    [
        ("parameters", None, "the calibrated rig, with other k, leaves noise"),
        ("parameters", True, "the calibrated rig, with other k, leaves what was called enough"),
        ("consistent", None, "the calibrated rig leaves noise"),
        ("unexplained", False, "the calibrated rig leaves more than noise"),
    ],
)
def test_a_calibration_alone_says_that_no_physics_was_looked_for(name, enough, said):
    made = diagnosed.EACH[name]()
    much = replace(made.explained, enough=enough)
    made = replace(made, work=replace(made.work, depth="none"), explained=much)
    assert heading(made) == f"No physics was looked for; {said}"
    assert "is missing" not in printed(made)


def test_an_unexplained_rest_beside_named_physics_is_placed():
    made = diagnosed.missing()
    rest = diagnosed.unexplained().located
    left = replace(made, verdict="unexplained", findings=made.findings[:1], located=replace(rest, location="link_1"))
    beside = "beside Coulomb friction at the motor bearing, more than noise is left at the link 1"
    assert heading(left) == f"Unexplained: {beside}"


def test_what_cannot_be_told_apart_and_the_chosen_candidates_stand_out(page_of):
    page = page_of(diagnosed.missing())
    assert "This recording cannot tell it from dead zone at the amplifier." in page
    assert page.count('<tr class="chosen">') == 2
    considered = page[page.index('id="tried"') :]
    rows = re.findall(r"<tr(?: class=\"chosen\")?>\s*<td[^>]*><span>([^<]*)</span>", considered)
    assert rows[:3] == ["Coulomb friction", "backlash", "dead zone"]
    assert "4 more" in re.sub(r"\s+", " ", page)


def test_text_from_outside_is_escaped_and_names_in_back_ticks_become_code(page_of):
    odd = replace(
        diagnosed.consistent(), source="<script>x</script>", notes=("a < b & c",), summary="`k` is <far> from nominal.",
    )  # fmt: skip
    page = page_of(odd)
    assert "<script>" not in page
    assert "a &lt; b &amp; c" in page
    assert "<code>k</code> is &lt;far&gt; from nominal." in page
    assert "k is <far>" in printed(odd)


def test_percentages_add_up_and_nothing_is_painted_where_there_is_no_evidence():
    thirds = percents({"a": 1 / 3, "b": 1 / 3, "c": 1 / 3})
    assert sorted(thirds.values()) == ["33 %", "33 %", "34 %"]
    assert percents({"a": 0.998, "b": 0.002}) == {"a": "100 %", "b": "< 1 %"}
    assert percents({}) == {}
    rig = nominal_rig("lead_screw")
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
    # values to be compared share their unit
    assert interval(9020.0, [9001.0, 9039.0], "N/m", size=10000.0) == "9.020 ± 0.019 kN/m"


@pytest.mark.parametrize(
    ("unit", "size", "found"),
    [("m", 4.0, (1.0, "m")), ("m", 4e4, (1.0, "m")), ("m", 5e-7, (1e-6, "µm")), ("N", 2e4, (1e3, "kN")),
     ("m^2", 1e-4, (1.0, "m^2")), ("kg", 1e-4, (1.0, "kg")), ("N", 0.0, (1.0, "N")), ("1", 0.3, (0.01, "%"))],
)  # fmt: skip
def test_prefixes(unit, size, found):
    assert scaled(unit, size) == found


def test_the_terminal_says_the_same_in_letters_that_it_has():
    text = printed(diagnosed.missing())
    assert text.startswith("missing_physics: Coulomb friction at the motor bearing and backlash at the gear")
    for phrase in (
        "torque 20.0 +/- 0.5", "open against dead", "9.020 +/- 0.019", "instead of 10 kN/m", "98 tolerances away",
        "1 of 2 checks pass. This check fails: residual of q3 is white. What",
        "To record next: Record the motor",
        "Together this explains 85 % of the mismatch.",
    ):  # fmt: skip
        assert phrase in text
    assert text.isascii()
    assert len(text.splitlines()) < 40


def test_where_much_stays_unknown_it_is_said_of_what_much_is_explained():
    """A force that is unknown brings predictions back to the readings, whatever the rig lacks."""
    made = replace(diagnosed.missing(), verdict="unexplained")
    assert re.search(r"Together this explains 85 % of the mismatch, (predicted|simulated) .*\.", together(made))
    assert together(diagnosed.missing()) == "Together this explains 85 % of the mismatch."


def test_what_has_to_be_known_first_stands_above_the_verdict(page_of):
    """Also where the model that was found does not stay finite."""
    made = diagnosed.missing()
    nowhere = [replace(curve, extended=np.full(len(curve.t_s), np.nan)) for curve in made.shown.curves]
    made = replace(made, first="The command u is 0.", shown=replace(made.shown, curves=tuple(nowhere), alone=()))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = printed(made)
    assert text.startswith("The command u is 0.\nmissing_physics: ")
    assert "The command u is 0. Recording" in re.sub(r"\s+", " ", page_of(made))


def test_an_effect_that_a_parameter_took_the_place_of_is_said(page_of):
    row = diagnosed.parameters().recalibrated["k"]
    other = Alternative("mass_3", "absorber")
    made = replace(diagnosed.parameters(), recalibrated={"k": replace(row, also_fits=(other,))})
    assert heading(made) == "No physics need be missing; recalibrate k"
    page = page_of(made)
    assert "k: This recording cannot tell it from absorber at the mass 3." in page
    assert "open against" in printed(made)


def test_a_sentence_does_not_capitalise_a_channel():
    assert capital("i_m does not clip", {"i_m", "u"}) == "i_m does not clip"
    assert capital("residual of q3 is noise", {"q3"}) == "Residual of q3 is noise"
