"""``dtb rig``: what it writes runs, and what it says of a rig is true."""

import math
import re

import pytest
from PIL import Image
from told import refusal

from dtbacklash import cli
from dtbacklash.api.rigs import load_rig
from dtbacklash.commands import rig as command
from dtbacklash.config.groups import MACHINES
from dtbacklash.report.diagnosis.rig_drawing import draw_rig


@pytest.mark.parametrize("machine", MACHINES)
def test_a_new_rig_is_one_and_is_told_in_full(machine, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["rig", "new", machine, "mine.yaml"]) == 0
    assert cli.main(["rig", "new", machine, "mine.yaml"]) == 2
    capsys.readouterr()
    assert cli.main(["rig", "check", "mine.yaml"]) == 0
    said = capsys.readouterr().out
    rig = load_rig("mine.yaml")
    assert all(f"  {name} = " in said for name in rig.config.parameters)
    assert all(name in said for name in rig.sensors)
    assert "look at this" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"]
    assert "coulomb_friction" in said or "ground_friction" in said
    more = "" if rig.only("gear") else " controller=open_loop"
    assert said.endswith(f"dtb run rig=mine.yaml{more}\n")
    assert f"#   dtb run rig=mine.yaml{more}\n" in (tmp_path / "mine.yaml").read_text()


def test_the_mode_of_an_oscillator(tmp_path, monkeypatch, capsys):
    """sqrt(900/0.8)/2 pi = 5.34 Hz; 1.2/(2 sqrt(900 0.8)) = 2.2 %."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(["rig", "new", "oscillator", "mine.yaml"]) == 0
    capsys.readouterr()
    assert cli.main(["rig", "check", "mine.yaml", "rig.parameters.k_f.value=3"]) == 0
    said = capsys.readouterr().out
    assert "  5.34 Hz, damping 2.2 %" in said
    assert re.search(r"k_f = 3 \+/- 2 %, of shaker", said)


def test_the_drawing_goes_into_a_folder_and_shows_every_element_and_sensor(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["rig", "check", "lead_screw", "out=drawn/here"]) == 0
    assert "drawn in drawn/here/lead_screw_rig.png" in capsys.readouterr().out
    assert Image.open(tmp_path / "drawn" / "here" / "lead_screw_rig.png").width == 1440
    rig = load_rig("lead_screw")
    told = {text.get_text().replace("\n", "") for text in draw_rig(rig, {}, []).axes[0].texts}
    assert {*rig.elements, *rig.sensors} <= told


@pytest.mark.parametrize(("old", "new", "said"), [
    ("  table: {", "  loose: {kind: mass, mass: 1 kg}\n  table: {",
     "rig.elements.loose is connected to nothing that the command moves"),
    ("{of: table,", "{of: loose,", "moves, and x shows nothing"),
    ("tolerance: 0.05, description: winding", "tolerance: 5, description: winding",
     "rig.parameters.R.tolerance=5 is 500 %: as good as unknown; 0.05 would be 5 %"),
    ("elements:", "  spare: {value: 1 kg}\n\nelements:", "rig.parameters.spare is used by no element"),
])  # fmt: skip
def test_what_is_hardly_meant_is_said_first(old, new, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["rig", "new", "screw", "mine.yaml"]) == 0
    text = (tmp_path / "mine.yaml").read_text().replace(old, new)
    if "of: loose" in text:
        text = text.replace("  table: {", "  loose: {kind: mass, mass: 1 kg}\n  table: {")
    (tmp_path / "mine.yaml").write_text(text)
    capsys.readouterr()
    assert cli.main(["rig", "check", "mine.yaml"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("look at this: ")
    assert said in first


@pytest.mark.parametrize(("phase", "angle"), [("180 deg", 0), ("0 deg", 180), ("90 deg", 90)])
def test_gravity_holds_a_pendulum_that_hangs(phase, angle):
    gravity = "rig.effects.disk.gravity"
    told = command.check(["pendulum", f"{gravity}.torque=0.5 N m", f"{gravity}.phase={phase}"])
    at = told.index("modes:") + 1
    hertz = math.sqrt(0.5 / 0.02) / (2.0 * math.pi)
    assert told[at : at + 2] == [
        f"  gravity holds disk at {angle}°, about which it swings:", f"  {hertz:.3g} Hz, damping 0 %",
    ]  # fmt: skip
    assert "free to drift" in "".join(command.check(["pendulum"]))


@pytest.mark.parametrize(("written", "meant"), [("1,2 ohm", "1.2 ohm"), ("0,05", "0.05"), ("-4,5 kg", "-4.5 kg")])
def test_a_decimal_comma_is_told(written, meant, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(f"name: mine\nparameters:\n  R: {{value: {written}, tolerance: 0.1}}\n")
    line = refusal(capsys, "rig", "check", "mine.yaml")
    assert f"holds a decimal comma in 'value: {written}' (line 3); write {meant}" in line


@pytest.mark.parametrize(("value", "meant"), [("0,03", "0.03"), ("-1,5", "-1.5"), ("0,03 N m", "0.03 N m")])
def test_a_decimal_comma_in_an_override_is_told(value, meant, capsys):
    key = "rig.effects.disk.coulomb_friction.torque"
    line = refusal(capsys, "rig", "check", "pendulum", f"{key}={value}")
    assert line.startswith(f"{key}={value}: write a decimal point ({meant})")


def test_a_rig_without_sensors_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["rig", "new", "drive", "mine.yaml"]) == 0
    file = tmp_path / "mine.yaml"
    file.write_text(file.read_text().partition("\nsensors:")[0])
    assert refusal(capsys, "rig", "check", "mine.yaml").startswith("rig.sensors={}: at least one")


@pytest.mark.parametrize(("words", "said"), [
    (["check", "lead_screw", "out="], "out=(empty): give a folder"),
    (["check", "lead_screw", "out=a", "out=b"], "out=b: is given twice"),
    (["nw"], "rig=nw: choose one of new, check"), (["new", "screw"], "argument=screw: write dtb rig new MACHINE FILE"),
    (["new", "car", "x.yaml"], "machine=car: choose one of screw, belt"), (["new", "belt", "x.yml.txt"], "must end in"),
    (["check", "nothing.yaml"], "rig=nothing.yaml: no such file"), (["check"], "write dtb rig check FILE.yaml"),
])  # fmt: skip
def test_a_mistake_is_one_line(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert said in refusal(capsys, "rig", *words)
    assert not list(tmp_path.iterdir())
