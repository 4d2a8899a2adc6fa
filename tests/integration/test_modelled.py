"""Physics that the catalogue lacks: concealed, modelled as a formula, and simulated by the rig's file."""

import json

import pytest
from commands import dtb

from dtbacklash import yaml_files

pytestmark = pytest.mark.check


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The folder, and what the diagnosis printed: a damping of a pendulum that grows with the square of the angle."""
    folder = tmp_path_factory.mktemp("modelled")
    dtb(folder, "conceal", "out=hidden", "seed=1101", "kind=unknown", "rig=pendulum")
    (recording,) = (folder / "hidden").glob("*/recording.csv.gz")
    return folder, dtb(folder, "diagnose", f"recording={recording}", "rig=pendulum", "out=found")


def test_no_name_is_given_and_what_is_left_is_modelled_down_to_the_noise(found):
    diagnosis = json.loads((found[0] / "found" / "diagnosis.json").read_text())
    assert diagnosis["verdict"] == "unexplained"
    assert not [f for f in diagnosis["findings"] if f["confidence"] == "sure"]
    modelled, fit = diagnosis["modelled"], diagnosis["fit"]
    assert (modelled["location"], modelled["state"], modelled["times"]) == ("disk", "position", "speed")
    assert modelled["effect"] == "found_1"
    assert fit["held_out"]["modelled"] < 1.1 * fit["noise_floor"] < 0.5 * fit["held_out"]["extended"]
    assert diagnosis["explained"]["modelled"]["compared"] > 0.99 > diagnosis["explained"]["compared"]
    (chosen,) = [one for one in modelled["formulas"] if one["chosen"]]
    assert chosen["family"] == "an even power"
    low, high = chosen["parameters"]["n"]["ci95"]
    assert low < 2.0 < high < 2.1
    assert "found_1: (a + b*abs(q)**n)*v" in found[1]
    assert "over the position, times the speed, like an even power" in diagnosis["summary"]


def test_its_rig_has_the_formula_and_runs(found):
    folder = found[0]
    rig = yaml_files.read((folder / "found" / "rig.yaml").read_bytes())
    assert rig["laws"]["found_1"]["law"] == "(a + b*abs(q)**n)*v"
    assert set(rig["effects"]["disk"]["found_1"]) == {"a", "b", "n"}
    dtb(folder, "run", "rig=found/rig.yaml", "controller=open_loop", "out=again")
    assert (folder / "again" / "summary.json").is_file()


def test_the_page_shows_it(found):
    page = (found[0] / "found" / "report.html").read_text()
    assert "Unexplained, but modelled: an effort over the position of disk" in page
    assert "family" in page
    assert ">chosen<" in page
    assert list((found[0] / "found" / "figures").glob("law_*_disk.png"))
