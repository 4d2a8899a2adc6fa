"""The example of docs/own_laws.md, as a user types it: a law in a folder is listed, simulated, named, and travels."""

import json
import re
import shlex
from pathlib import Path

import pytest
from commands import dtb

from dtbacklash import yaml_files

pytestmark = pytest.mark.check

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "own_laws.md").read_text(encoding="utf-8")
LAW = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)[0]
COMMANDS = re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL)[0].splitlines()
TRUE = 0.01


def typed_as(folder, command):
    """A command of the page; gives what it prints."""
    return dtb(folder, *shlex.split(command)[1:])


@pytest.fixture(scope="module")
def typed(tmp_path_factory):
    """The folder after all commands but the last, and what they printed."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "conf" / "effect").mkdir(parents=True)
    (folder / "conf" / "effect" / "cubic_drag.yaml").write_text(LAW)
    assert len(COMMANDS) == 4
    return folder, [typed_as(folder, command) for command in COMMANDS[:3]]


def test_it_is_listed_with_its_law(typed):
    assert "law     -drag * v ** 3" in typed[1][0]


def test_it_is_named_with_its_size(typed):
    found = json.loads((typed[0] / "found" / "diagnosis.json").read_text())
    assert found["verdict"] == "missing_physics"
    (finding,) = found["findings"]
    assert (finding["location"], finding["effect"], finding["confidence"]) == ("disk", "cubic_drag", "sure")
    low, high = finding["parameters"]["drag"]["ci95"]
    assert low < TRUE < high < 1.1 * TRUE
    assert finding["parameters"]["drag"]["unit"] == "N m s^3/rad^3"
    assert finding["sentence"].startswith("The brake drags on the disk with")


def test_its_law_is_drawn(typed):
    assert list((typed[0] / "found" / "figures").glob("law_1_disk.png"))


def test_the_extended_rig_has_the_law_with_it(typed, tmp_path):
    file = typed[0] / "found" / "rig.yaml"
    assert yaml_files.read(file.read_bytes())["laws"] == {"cubic_drag": yaml_files.read(LAW)}
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "rig.yaml").write_bytes(file.read_bytes())
    typed_as(tmp_path, COMMANDS[3] + " out=again figures=false")  # in a folder that knows nothing of it
    assert (tmp_path / "again" / "summary.json").is_file()


@pytest.mark.nightly
def test_presliding_is_named_where_the_rig_asks_for_it(tmp_path):
    law, true = "rig.laws.dahl_friction=packaged", {"level": 0.03, "reach": 0.02}
    hidden = " ".join(f"rig.effects.disk.dahl_friction.{name}={value}" for name, value in true.items())
    made = COMMANDS[1].replace("rig.effects.disk.cubic_drag.drag=0.01", f"{law} {hidden}")
    assert made != COMMANDS[1]
    typed_as(tmp_path, made + " figures=false")
    typed_as(tmp_path, f"dtb diagnose recording=fan.csv rig=pendulum {law} out=found")
    (finding,) = json.loads((tmp_path / "found" / "diagnosis.json").read_text())["findings"]
    assert (finding["location"], finding["effect"], finding["confidence"]) == ("disk", "dahl_friction", "sure")
    for name, value in true.items():
        low, high = finding["parameters"][name]["ci95"]
        assert low < value < high < 1.1 * value
