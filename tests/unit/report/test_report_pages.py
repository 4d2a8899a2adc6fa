"""The pages: everything in one file, nothing from outside, nothing unescaped, in words that are right."""

import re
from dataclasses import fields

import numpy as np
import pytest
import synthetic
import yaml
from drawn import overlapping
from page_reader import Reader

from dtbacklash.config import choices
from dtbacklash.config.compose import compose
from dtbacklash.config.run import ReferenceConfig, RunConfig
from dtbacklash.experiment.metrics import move_table
from dtbacklash.experiment.run import run_scenario
from dtbacklash.report.paper import page as paper_page
from dtbacklash.report.run import page as run_report
from dtbacklash.report.run.loop import loop_figure
from dtbacklash.report.run.methods import methods
from dtbacklash.report.run.overview import open_overview
from dtbacklash.report.run.words import as_yaml, describe, effect_sentences


def read(path):
    reader = Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    assert reader.open == []
    return re.sub(r"\s+", " ", " ".join(reader.text)), reader.addresses


@pytest.fixture(scope="module")
def result():
    result = synthetic.run_result()
    result.summary["command"] = "dtb run controller=nimc_twin 'reference.path=<a b>'"
    return result


@pytest.fixture(scope="module")
def written(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    run_report.write(result, move_table(result.trace), folder)
    return folder


def test_a_run_gets_its_figures_and_one_self_contained_page(written):
    assert sorted(p.name for p in written.rglob("*") if p.is_file()) == ["moves.png", "overview.png", "report.html"]
    _, addresses = read(written / "report.html")
    assert len(addresses) == 2
    assert all(address.startswith("data:image/png;base64,") for address in addresses)
    page = (written / "report.html").read_text(encoding="utf-8")
    assert "http" not in page
    assert "@import" not in page
    assert (written / "report.html").stat().st_size < 700_000


def test_a_closed_loop_shows_its_margins(tmp_path):
    run = run_scenario(compose("controller=nimc_twin", "controller.internal_model=inner_loop", "duration_s=3"))
    run_report.write(run, move_table(run.trace), tmp_path)
    text, addresses = read(tmp_path / "report.html")
    assert "gain margin 14.3" in text
    assert "limit cycle 1.2 half-gaps at 42.1 rad/s" in text
    assert len(addresses) == 3
    assert overlapping(loop_figure(run.design)) == []


def test_what_happened_comes_first_and_how_it_was_made_is_folded(written):
    reader = Reader()
    reader.feed((written / "report.html").read_text(encoding="utf-8"))
    folded = ["setup", "methods", "repeat", "configuration-resolved", "versions-seed-and-times"]
    assert reader.ids == ["figures", "moves", "estimates", *folded]
    page = (written / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'<summary><h2 id="([\w-]+)"', page) == folded
    assert page.count('<span class="good-one">') == 2
    assert "`" not in re.sub(r"<pre>.*?</pre>", "", page, flags=re.DOTALL)
    assert "<b>&amp; so on" not in page  # text from outside is escaped
    assert "&lt;b&gt;&amp; so on&lt;/b&gt;" in page


def test_the_page_says_what_was_run_and_what_came_out(written):
    text, _ = read(written / "report.html")
    for phrase in (
        "nimc_twin on lead_screw", "7 of 9", "Dry (Coulomb) friction of 0.02 N m", "Square wave of ±1 mm, period 40 s.",
        "Grows from 0° to 100° along an S-curve between 25 and 175 s.", "k_theta_v_per_rad: 15.0", "numpy: 2.4.6",
        "432.1 deg lies outside the physical bounds [0, 180] deg",
        "dtb run controller=nimc_twin 'reference.path=<a b>'",
    ):  # fmt: skip
        assert phrase in text
    assert text.count("rejected") == 2 + 1  # and the words on the guard
    assert text.count("accepted") == 7 + 1  # and the tile


def test_a_run_without_moves_and_estimates_tells_its_tracking_error(result, tmp_path):
    still = synthetic.run_result(figures=False)
    still.trace["r_mm"] = still.trace["q3_mm"] + 0.25
    still.summary["tracking_rms_mm"] = 0.25
    still.estimates = still.estimates.iloc[:0]
    run_report.write(still, move_table(still.trace), tmp_path)
    text, addresses = read(tmp_path / "report.html")
    assert ([p.name for p in tmp_path.iterdir()], addresses) == (["report.html"], [])
    assert "What happened" not in text
    assert "0.25 mm tracking error, rms" in text
    assert "no move to measure" in text
    assert "Estimates of the digital twin" not in text


def test_moves_that_do_not_settle_are_named(result, tmp_path):
    moves = move_table(result.trace)
    moves.loc[[1, 3], "settling_time_s"] = np.nan
    result = synthetic.run_result(figures=False)
    run_report.write(result, moves, tmp_path)
    text, _ = read(tmp_path / "report.html")
    assert "2 of 10 moves that do not settle" in text
    assert text.count("not settled") == 2


def configured(tmp_path, section, name, choice):
    """A configuration with one choice made, or None where it is refused with others."""
    if choice == "csv":
        (tmp_path / "signal.csv").write_text("t_s,x\n0,0\n", encoding="utf-8")
    more = {"path": str(tmp_path / "signal.csv")} if choice == "csv" else {}
    if (section, choice) == ("profile", "constant"):
        more = {"end_deg": 0.0}
    if section == "controller":
        nimc = choice not in ("imc", "open_loop", "exact", "pid", "lqg", "offset", "mpc", "state_space")
        more = {"structure": "nimc" if nimc else "imc", "reconfigure": "novelty" if nimc else "never"}
    section_type = type(getattr(RunConfig(), section))
    return synthetic.config(**{section: section_type(**(more | {name: choice}))})


@pytest.mark.parametrize(
    ("section", "name", "choice"),
    [
        (section, name, choice)
        for section, name, found in (
            ("controller", "structure", choices.STRUCTURES),
            ("controller", "reconfigure", choices.TRIGGERS),
            ("controller", "prefilter", choices.PREFILTERS),
            ("controller", "internal_model", choices.INTERNAL_MODELS),
            ("profile", "kind", choices.PROFILES),
            ("reference", "kind", choices.REFERENCES),
            ("reference", "interpolation", choices.INTERPOLATIONS),
            ("twin", "novelty_filter", choices.NOVELTY_FILTERS),
            ("optimizer", "name", choices.OPTIMIZERS),
        )
        for choice in found
    ],
)
def test_every_choice_of_the_schema_has_its_words_and_its_methods(section, name, choice, tmp_path):
    config = configured(tmp_path, section, name, choice)
    told = [text for _, texts in describe(config) for text in texts] + methods(config)
    assert all(text.strip().endswith(".") for text in told)
    assert not any(re.search(r"[{}]|\bNone\b|\bnan\b", text) for text in told)


@pytest.mark.parametrize("kind", ["square", "step", "staircase", "multisine"])
def test_a_reference_has_its_offset_in_its_unit(kind):
    config = RunConfig(reference=ReferenceConfig(kind=kind, offset_mm=0.25))
    words = dict(describe(config))
    assert kind in words["Reference"][0].lower()
    assert "offset 0.25 mm" in words["Reference"][0]
    config.controller.structure = "open_loop"
    assert "offset 0.25 V" in dict(describe(config))["Command"][0]


@pytest.mark.parametrize("rig", ["lead_screw", "emps", "silverbox", "brfd"])
def test_an_open_loop_run_is_told_as_one(rig, tmp_path):
    words = ("controller=open_loop", "reference=multisine", "duration_s=1", "profile=constant", f"rig={rig}")
    result = run_scenario(compose(*words))
    run_report.write(result, result.moves, tmp_path)
    text, _ = read(tmp_path / "report.html")
    assert f"open loop on {rig} One open-loop run" in text
    assert "Command Multisine of 0.5 V rms" in text
    for wrong in ("closed-loop", "tracking error", "reference [mm]", "Moves"):
        assert wrong not in text
    assert ("Gap 50° throughout." in text) == (rig == "lead_screw")
    assert all(f"{sensor['quantity']} of {sensor['of']}" in text for sensor in result.config.rig.sensors.values())


def test_the_panels_of_an_open_loop_run_are_its_signals():
    result = run_scenario(compose("controller=open_loop", "reference=step", "duration_s=1", "profile.start_deg=0"))
    figure = open_overview(result.trace, result.summary["signals"])
    assert [ax.get_title(loc="left") for ax in figure.axes] == [
        "(a)  command u", "(b)  theta_m: position of motor_bearing", "(c)  q3: position of mass_3",
        "(d)  i_m: current of motor_circuit", "(e)  q2: position of mass_2",
    ]  # fmt: skip
    assert [ax.get_ylabel() for ax in figure.axes] == ["[V]", "[rad]", "[mm]", "[mA]", "[mm]"]
    command = figure.axes[0].lines[0]
    assert command.get_ydata().max() == pytest.approx(result.trace["u_v"].max())


def test_a_controller_that_is_never_reconfigured_has_no_twin():
    config = synthetic.config()
    config.controller.reconfigure, config.controller.gap_hat_deg = "never", 50.0
    words = dict(describe(config))
    assert "Digital twin" not in words
    assert "its gap estimate stays at 50°" in words["Controller"][0]


def test_effects_at_their_neutral_value_are_not_told():
    rig = synthetic.config().rig
    assert effect_sentences(rig) == ["Dry (Coulomb) friction of 0.02 N m acts at the motor_bearing."]
    rig.effects = {"motor_bearing": {"coulomb_friction": {"torque": 0.0}}}
    assert effect_sentences(rig) == ["No effect beyond the nominal model"]
    rig.effects = {"sensor_q3": {"offset": {"offset": 2e-5}}}
    assert "sensor_q3" in effect_sentences(rig)[0]
    rig.effects = {"motor_bearing": {"asymmetric_friction": {"coulomb_difference": 2e-3}}}
    assert effect_sentences(rig)[0].startswith("Dry (Coulomb) friction at the motor_bearing is higher by 0.002 N m in ")


def test_a_config_becomes_yaml_with_its_keys_in_order():
    data = yaml.safe_load(as_yaml(RunConfig(seed=3)))
    assert list(data) == [field.name for field in fields(RunConfig)]
    assert data["seed"] == 3
    assert data["twin"]["buffer"] == 1000
    assert as_yaml({"b": (np.float64(1.5), [np.int64(2)]), "a": "2 µm"}) == "b:\n- 1.5\n- - 2\na: 2 µm\n"


def test_the_paper_page_lists_every_claim_and_figure(written, tmp_path):
    picture = written / "figures" / "moves.png"
    figures = {"fig04": picture, "figure_14": picture, "what wear does": picture}
    paper_page.write(synthetic.claims_table(), figures, tmp_path)
    text, addresses = read(tmp_path / "report.html")
    assert len(addresses) == 3
    assert "5 of 6 claims reproduced" in text
    assert "estimates are unbiased: the paper says “0°”. It is 0.62 here; the tolerance is ±0.5°" in text
    assert text.count(" pass ") == 5
    assert text.count(" fail ") == 1
    assert "Figure 4 Response to a 1 mm step without dynamical prefilter" in text
    assert "Figure 14 NIMC reconfigured" in text
    assert "what wear does" in text
    assert "<script>alert(1)</script>" in text  # as text: a tag would not be in the text
