"""Accelerometers in g, and friction that grows with the load of a servo: concealed, and named."""

import json
from pathlib import Path

import pytest
from commands import dtb

from dtbacklash import conf, yaml_files

pytestmark = pytest.mark.check


def diagnosed(folder, *words):
    """What a diagnosis of a concealed recording says; ``words`` : of ``dtb conceal``."""
    rig = next(word for word in words if word.startswith("rig="))
    dtb(folder, "conceal", "out=hidden", *words)
    said = dtb(folder, "diagnose", "recording=hidden/*/recording.csv.gz", rig, "out=f")
    return json.loads((folder / "f" / "diagnosis.json").read_text()), " ".join(said.split())


def named(diagnosis):
    return [(f["location"], f["effect"], f["confidence"]) for f in diagnosis["findings"]]


def test_a_cubic_spring_is_named_from_an_accelerometer_alone(tmp_path):
    rig = yaml_files.read((Path(conf.__file__).parent / "rig" / "oscillator.yaml").read_bytes())
    rig["sensors"] = {"a": {"of": "mass", "quantity": "acceleration", "recorded_in": "g"}}
    (tmp_path / "shaken.yaml").write_text(json.dumps(rig))
    diagnosis, _ = diagnosed(tmp_path, "rig=shaken.yaml", "effect=spring.cubic_stiffness", "seed=1302")
    assert named(diagnosis) == [("spring", "cubic_stiffness", "sure")]
    assert diagnosis["notes"][-1].startswith("Accelerations alone do not show where the machine stands")


def test_friction_by_load_is_named_at_a_servo(tmp_path):
    diagnosis, said = diagnosed(tmp_path, "rig=servo_arm", "effect=servo.load_friction", "seed=1601")
    assert named(diagnosis) == [("servo", "load_friction", "sure")]
    assert "load friction at the servo" in said


def test_half_a_sample_of_a_held_command_is_no_late_sensor(tmp_path):
    """With its friction missing the command looked smooth, and then the encoder half a sample late: sure, and false."""
    diagnosis, _ = diagnosed(tmp_path, "rig=pendulum", "seed=82000")
    assert named(diagnosis) == [("disk", "viscous_friction", "sure")]
