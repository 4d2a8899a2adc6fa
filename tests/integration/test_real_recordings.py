"""The public recordings diagnosed: what is named, how large, and how well the extended rig predicts unseen data.

Their sensors are better than any catalogue of laws: more than noise is left of all of them, beside names that are sure
or open. Parts of the records, so that each takes a minute at most;
docs/real-recordings.md has the figures of them all.
"""

import re

import numpy as np
import pandas as pd
import pytest
import yaml
from nominal import nominal_rig
from told import refusal

import dtbacklash as dtb
from dtbacklash import cli
from dtbacklash.diagnosis import Diagnosis, diagnose
from dtbacklash.diagnosis.findings import Alternative
from dtbacklash.diagnosis.records import held_equivalent
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.rig_file import rig_yaml
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording import Recording, read_recording

pytestmark = [pytest.mark.check, pytest.mark.usefixtures("public")]


def named(found: Diagnosis) -> dict[tuple[str, str], dict[str, dict]]:
    return {(f["location"], f["effect"]): f["parameters"] for f in found.to_json()["findings"]}


def confidence(found: Diagnosis) -> dict[tuple[str, str], str]:
    return {(f.location, f.effect): f.confidence for f in found.findings}


def near(parameter: dict, published: float, slack: float) -> bool:
    """Whether a published value lies in the interval, or no further from it than ``slack`` of itself."""
    low, high = parameter["ci95"]
    return low - slack * abs(published) <= published <= high + slack * abs(published)


def emps_error_m(rig: Rig, recording: Recording) -> float:
    """Rms error of the position over the whole record, force in, nothing measured coming to help."""
    q = recording.channels["qm"]
    shown = simulate(rig, recording.channels["u"][:-1], recording.sample_time_s).sensors["qm"]
    return float(np.sqrt(np.mean((shown + q[0] - q) ** 2)))


@pytest.mark.nightly
def test_emps_has_viscous_coulomb_and_asymmetric_friction() -> None:
    rig = nominal_rig("emps")
    recording = read_recording("emps", rig=rig)
    found = diagnose(recording.section(0, 12000), rig)
    parameters = named(found)
    # ten times the encoder's noise is left, a thousandth of the mismatch: friction that is not quite Coulomb's, a
    # ripple of the screw
    assert found.verdict == "missing_physics"
    assert confidence(found)["carriage", "viscous_friction"] == "sure"
    # half of the record does not tell Coulomb from Stribeck friction
    dry, other = ("carriage", "coulomb_friction"), Alternative("carriage", "stribeck_friction")
    assert set(parameters) == {("carriage", "viscous_friction"), dry, ("carriage", "asymmetric_friction")}
    assert confidence(found)[dry] == "partial"
    assert other in next(f.also_fits for f in found.findings if f.effect == "coulomb_friction")
    # Janot, Gautier, Brunot (2019), with friction that differs between the directions: Fv+ 166.7, Fv- 240.4 N s/m,
    # Fc+ 20.14, Fc- 20.63 N
    assert near(parameters["carriage", "viscous_friction"]["coefficient"], 203.55, 0.05)
    assert near(parameters[dry]["force"], 20.39, 0.05)
    assert near(parameters["carriage", "asymmetric_friction"]["viscous_difference"], -36.85, 0.1)
    held = found.to_json()["fit"]["held_out"]
    assert held["extended"] < 0.05 * held["recalibrated"]
    assert emps_error_m(found.extended, recording) < 9e-3  # 7.1 mm from half of the record, 2.9 mm from all of it


@pytest.mark.nightly
def test_silverbox_has_a_cubic_spring_and_the_arrow_is_predicted() -> None:
    rig = nominal_rig("silverbox")
    arrow = read_recording("silverbox", part="arrow", rig=rig)
    train = read_recording("silverbox", rig=rig).section(0, 12000)
    found = diagnose(train, rig, arrow.section(32000, 40000))
    parameters = named(found)
    # the oscillator is an electronic circuit, measured to one part in ten thousand: thirty times that is left
    assert found.verdict == "missing_physics"
    assert confidence(found)["link_1", "cubic_stiffness"] == "sure"
    assert ("link_1", "cubic_stiffness") in parameters
    assert ("link_1", "bumper") not in parameters
    assert 3.7 < parameters["link_1", "cubic_stiffness"]["k3"]["value"] < 4.1
    u, y = (arrow.channels[name] for name in ("u", "y"))
    held = held_equivalent(u)[:-1]
    errors = [y - simulate(r, held, arrow.sample_time_s).sensors["y"] for r in (rig, found.extended)]
    before, after = (float(np.sqrt(np.mean(e**2))) for e in errors)
    assert before > 10e-3
    assert after < 1e-3


@pytest.mark.nightly
def test_the_damper_has_lost_motion_at_its_reversals(tmp_path, capsys) -> None:
    rig = nominal_rig("brfd")
    found = diagnose(read_recording("brfd", rig=rig), rig)
    parameters, document = named(found), found.to_json()
    # the band energises itself as it takes hold, which no law of the catalogue does: that is left beside the backlash
    assert found.verdict == "missing_physics"
    assert confidence(found) == {("joint", "backlash"): "sure"}
    lost = parameters["joint", "backlash"]["lost_motion"]
    assert 4.5e-3 < lost["value"] < 5.5e-3  # the force stays under 10 % of its plateau for 5.0 to 5.8 mm
    assert lost["ci95"][1] - lost["ci95"][0] < 1e-3
    assert "mm at each reversal" in document["findings"][0]["sentence"]
    # where the band takes hold again, some 0.2 s after each reversal
    said = r"(\d+) % of the mismatch lies within (\d+) ms of a velocity reversal"
    share = re.fullmatch(said, document["findings"][0]["when"])
    assert share is not None
    assert int(share[1]) >= 50
    assert int(share[2]) <= 400
    assert document["fit"]["held_out"]["extended"] < 0.4 * document["fit"]["held_out"]["recalibrated"]
    file = tmp_path / "rig.yaml"
    file.write_text(rig_yaml(found.extended))
    assert yaml.safe_load(file.read_text())["effects"]["joint"]["backlash"]["lost_motion"]["value"] == pytest.approx(
        lost["value"]
    )
    words = ["reference.amplitude_mm=25", "duration_s=3", "figures=false", f"hydra.run.dir={tmp_path / 'run'}"]
    assert cli.main(["run", "controller=open_loop", f"rig={file}", *words]) == 0
    assert (tmp_path / "run" / "summary.json").is_file()
    capsys.readouterr()


@pytest.mark.nightly
def test_another_frequency_and_amplitude_of_the_damper_is_predicted() -> None:
    rig = nominal_rig("brfd")
    other = read_recording("brfd", path="dataset-2_0.25Hz_30lb_0.5in.json", rig=rig)
    found = diagnose(read_recording("brfd", rig=rig), rig, other.section(0, 9500))
    assert ("joint", "backlash") in named(found)
    held = found.to_json()["fit"]["held_out"]
    assert held["extended"] < 0.4 * held["recalibrated"]


@pytest.mark.nightly
def test_the_disk_has_gravity_dry_friction_and_a_delay() -> None:
    rig = nominal_rig("disk")
    recording = read_recording("disk", rig=rig)
    found = diagnose(recording.section(0, 4000), rig)
    parameters = named(found)
    # a tenth of the recording says that dry friction holds the disk, and hardly whether it falls off with the speed
    friction = {("disk", "coulomb_friction"), ("disk", "stribeck_friction")} & set(parameters)
    assert len(friction) == 1
    assert {("disk", "gravity"), ("amplifier", "delay")} == set(parameters) - friction
    inertia = rig.config.parameters["J"].value
    # fitted by hand to all of it: gravity over inertia 136.3 1/s^2, a tilt of -0.034 rad, Coulomb friction over inertia
    # 6.51 rad/s^2, one sample of delay
    assert near(parameters["disk", "gravity"]["torque"], 136.3 * inertia, 0.02)
    assert near(parameters["disk", "gravity"]["phase"], np.pi - 0.034, 0.01)
    assert near(parameters[friction.pop()]["torque"], 6.51 * inertia, 0.1)
    assert near(parameters["amplifier", "delay"]["time"], 0.025, 0.05)
    shown = simulate(found.extended, recording.channels["u"][:-1], recording.sample_time_s).sensors["th"]
    later = slice(24500, None)
    rest = float(np.sqrt(np.mean((shown - recording.channels["th"])[later] ** 2)))
    assert rest < 0.05  # rad; 0.03 from all of it, the nominal rig 1.0, the best published network 0.027 elsewhere


@pytest.mark.parametrize("part", ["off", "on"])
@pytest.mark.nightly
def test_a_motor_that_snaps_from_tooth_to_tooth_has_no_dead_zone(part: str) -> None:
    rig = nominal_rig("anticogging")
    found = diagnose(read_recording(f"anticogging:{part}", rig=rig).section(0, 8000), rig)
    assert ("amplifier", "dead_zone") not in named(found)
    assert found.verdict != "missing_physics" or ("rotor", "cogging") in named(found)


@pytest.mark.nightly
def test_a_compensated_cogging_is_what_changed_from_what_the_speed_controller_asks_for() -> None:
    """The controller is proportional, two samples late; what is added to its current takes the cogging away."""
    seen = read_recording("anticogging", rig=nominal_rig("anticogging")).channels
    frame = pd.DataFrame({
        "t": 1e-3 * np.arange(len(seen["u"])), "u": 0.0871 * (seen["r"] - np.roll(seen["omega"], 2)),
        "theta": seen["theta"], "omega": seen["omega"],
    })  # fmt: skip
    parts = [frame[100:6100], frame[15301:21301]]
    found = dtb.diagnose(parts, nominal_rig("anticogging"), compare="change").diagnosis
    (cogging,) = (one for one in found.changes or () if one.title == "rotor.cogging.torque")
    assert cogging.before.value > 5.0 * cogging.after.value
    assert near(found.extended.effects["rotor"]["cogging"]["periods"], 72.0, 0.005)


def test_a_run_says_that_a_public_recording_is_for_a_diagnosis(capsys) -> None:
    said = "recording=emps: is a recording to diagnose (dtb diagnose recording=emps)"
    assert refusal(capsys, "run", "recording=emps").startswith(said)
