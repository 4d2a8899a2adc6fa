"""Rigs in and out of Python."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from told import refused

import dtbacklash as dtb

LEAD_SCREW = Path(dtb.__file__).parent / "conf" / "rig" / "lead_screw.yaml"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "a rig of mine.yaml"  # with blanks
    path.write_text(LEAD_SCREW.read_text().replace("name: lead_screw", "name: mine"))
    return path


def test_a_name_a_file_a_mapping_and_a_rig(file):
    content = yaml.safe_load(file.read_text())
    rigs = [dtb.load_rig(source) for source in (file, str(file), content)]
    assert [rig.config.name for rig in rigs] == ["mine"] * 3
    assert rigs[0] == rigs[1] == rigs[2]
    assert dtb.load_rig(rigs[0]) is rigs[0]
    assert dtb.load_rig("lead_screw").elements == rigs[0].elements


def test_a_parameter_may_be_its_value_alone(tmp_path):
    short = {"k1": "3 N/mm", "k2": "= k1", "g": 2.0}
    rig = {
        "parameters": short, "sensors": {"x": {"of": "b", "quantity": "position"}},
        "elements": {
            "drive": {"kind": "actuator", "gain": "g", "drives": "a"}, "a": {"kind": "mass", "mass": 1.0},
            "b": {"kind": "mass", "mass": "2 kg"}, "one": {"kind": "link", "between": ["a", "b"], "stiffness": "k1"},
            "two": {"kind": "link", "between": ["b", "ground"], "stiffness": "k2"},
        },
    }  # fmt: skip
    file = tmp_path / "short.yaml"
    file.write_text(yaml.safe_dump(rig))
    longer = {**rig, "parameters": {name: {"value": value} for name, value in short.items()}}
    assert dtb.load_rig(rig) == dtb.load_rig(file) == dtb.load_rig(longer)
    assert [dtb.load_rig(file).elements[link].values["stiffness"] for link in ("one", "two")] == [3e3, 3e3]


def test_a_parameter_that_is_a_list_or_a_truth_value_is_refused():
    for wrong in ([3.0], True):
        with pytest.raises(
            dtb.UserError, match=r"must give parameters\.k as a number, a text with a unit, or a mapping"
        ):
            dtb.load_rig({"parameters": {"k": wrong}, "elements": {}})


@pytest.mark.parametrize("kind", ["name", "file", "mapping", "rig"])
def test_changes_go_on_top(kind, file):
    source = {
        "name": "lead_screw", "file": file, "mapping": yaml.safe_load(file.read_text()), "rig": dtb.load_rig(file),
    }[kind]  # fmt: skip
    words = ("rig.parameters.k.value=9000", "rig.effects.motor_bearing.coulomb_friction.torque=0.02")
    rig = dtb.load_rig(source, *words)
    assert rig.config.parameters["k"].value == 9000.0
    assert rig.effects == {"motor_bearing": {"coulomb_friction": {"torque": 0.02}}}
    result = dtb.run("controller=imc", "duration_s=1", *words, rig=source)
    assert result.rig.effects == rig.effects


def test_a_rig_survives_its_file(tmp_path):
    rig = dtb.load_rig("lead_screw").with_effect("link_1", "cubic_stiffness", {"k3": np.float64(1e10) / 3.0})
    rig = rig.with_parameters({"k": 9000.1})
    path = dtb.save_rig(rig, tmp_path / "rig.yaml")
    again = dtb.load_rig(path)
    assert again.effects == rig.effects
    assert again.config.parameters == rig.config.parameters
    assert [entry.name for entry in tmp_path.iterdir()] == ["rig.yaml"]


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("nope", "rig=nope: choose one of"),
        ("nope.yaml", "rig=nope.yaml: no such file"),
        (3, "rig=3: must be a rig, a name"),
        ({"name": "x", "elements": {"a": {"kind": "geer"}}}, "rig.elements.a.kind=geer"),
        ({"nam": "x"}, "rig.nam"),
    ],
)
def test_mistakes_are_one_line(source, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with refused(start=said):
        dtb.load_rig(source)


@pytest.mark.parametrize(("call", "said"), [
    (lambda: dtb.run("rig=emps", rig="lead_screw"), "given twice"),
    (lambda: dtb.load_rig("lead_screw", "duration_s=3"), "write rig.KEY=VALUE"),
    (lambda: dtb.save_rig(dtb.load_rig("lead_screw"), "rig.txt"), "must end in .yaml"),
    (lambda: dtb.save_rig(dtb.load_rig("lead_screw"), "nowhere/rig.yaml"), "cannot be written"),
    *((lambda word=word: dtb.run(word, "duration_s=2"), "call save(folder)") for word in ("out=x", "hydra.run.dir=x")),
])  # fmt: skip
def test_what_does_not_go_together_or_there_is_one_line(call, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with refused(said):
        call()
