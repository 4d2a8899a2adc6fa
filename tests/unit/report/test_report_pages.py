"""The pages: everything in one file, nothing from outside, nothing unescaped, in words that are right."""

import re

import numpy as np
import pytest
import synthetic
from page_reader import Reader

from dtbacklash.config.run import ProfileConfig, ReferenceConfig, RunConfig
from dtbacklash.metrics import move_table
from dtbacklash.report import paper_page, run_report
from dtbacklash.report.words import describe, effect_sentences, plain


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
    assert sorted(p.name for p in written.rglob("*") if p.is_file()) == [
        "moves.png",
        "overview.png",
        "report.html",
    ]
    _, addresses = read(written / "report.html")
    assert len(addresses) == 2
    assert all(address.startswith("data:image/png;base64,") for address in addresses)
    page = (written / "report.html").read_text(encoding="utf-8")
    assert "http" not in page
    assert "@import" not in page
    assert (written / "report.html").stat().st_size < 700_000


def test_the_page_says_what_was_run_and_what_came_out(written):
    text, _ = read(written / "report.html")
    for phrase in (
        "nimc_twin on lead_screw",
        "7 of 9",
        "Dry (Coulomb) friction of 0.02 N m",
        "Square wave of ±1 mm, period 40 s.",
        "Grows from 0° to 100° along an S-curve between 50 and 150 s.",
        "432.1 deg lies outside the physical bounds [0, 180] deg",
        "dtb run controller=nimc_twin 'reference.path=<a b>'",
        "numpy: 2.4.6",
        "k_theta_v_per_rad: 15.0",
    ):
        assert phrase in text
    assert text.count("rejected") == 2 + 1  # and the words on the guard
    assert text.count("accepted") == 7 + 1  # and the tile


def test_text_from_outside_is_escaped(written):
    page = (written / "report.html").read_text(encoding="utf-8")
    assert "<b>&amp; so on" not in page
    assert "&lt;b&gt;&amp; so on&lt;/b&gt;" in page


def test_without_figures_there_is_a_page_without_figures(result, tmp_path):
    bare = synthetic.run_result(figures=False)
    run_report.write(bare, move_table(bare.trace), tmp_path)
    text, addresses = read(tmp_path / "report.html")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    assert addresses == []
    assert "What happened" not in text


def test_a_run_without_moves_and_estimates_tells_its_tracking_error(result, tmp_path):
    still = synthetic.run_result(figures=False)
    still.trace["r_mm"] = still.trace["q3_mm"] + 0.25
    still.estimates = still.estimates.iloc[:0]
    run_report.write(still, move_table(still.trace), tmp_path)
    text, _ = read(tmp_path / "report.html")
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


@pytest.mark.parametrize("kind", ["s_curve", "constant", "ramp", "step", "wear"])
def test_every_profile_has_its_words(kind):
    words = dict(describe(RunConfig(profile=ProfileConfig(kind=kind, end_deg=0.0 if kind == "constant" else 90))))
    assert words["Gap"][0].endswith(".")
    assert ("90°" in words["Gap"][0]) == (kind != "constant")


@pytest.mark.parametrize("kind", ["square", "step", "staircase", "multisine"])
def test_every_reference_has_its_words(kind):
    words = dict(describe(RunConfig(reference=ReferenceConfig(kind=kind, offset_mm=0.25))))
    assert kind in words["Reference"][0].lower()
    assert "offset 0.25 mm" in words["Reference"][0]


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


def test_a_config_becomes_plain_data():
    data = plain(RunConfig(seed=3))
    assert data["seed"] == 3
    assert data["twin"]["buffer"] == 1000
    assert plain({"a": (np.float64(1.5), [np.int64(2)])}) == {"a": [1.5, [2]]}
    assert type(plain(np.float64(1.5))) is float


def test_the_paper_page_lists_every_claim_and_figure(written, tmp_path):
    picture = written / "figures" / "moves.png"
    figures = {"fig04": picture, "figure_14": picture, "what wear does": picture}
    paper_page.write(synthetic.claims_table(), figures, tmp_path)
    text, addresses = read(tmp_path / "report.html")
    assert len(addresses) == 3
    assert "5 of 6 claims reproduced" in text
    assert "Not reproduced: estimates are unbiased." in text
    assert text.count(" pass ") == 5
    assert text.count(" fail ") == 1
    assert "Figure 4 Response to a 1 mm step without dynamical prefilter" in text
    assert "Figure 14 NIMC reconfigured" in text
    assert "what wear does" in text
    assert "<script>alert(1)</script>" in text  # as text: a tag would not be in the text


def test_claims_without_reasons_still_make_a_page(tmp_path):
    paper_page.write(synthetic.claims_table().drop(columns="reason"), {}, tmp_path)
    assert "47.12" in read(tmp_path / "report.html")[0]
