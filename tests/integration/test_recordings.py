"""`dtb recordings`, what `dtb run recording.save=` writes, and the public recordings where they are at hand."""

import socket

import numpy as np
import pytest
from nominal import nominal_rig
from told import refusal

from dtbacklash import cli
from dtbacklash.physics.simulate import simulate
from dtbacklash.recording import mapping_names, read_recording, refined


@pytest.fixture
def offline(monkeypatch, tmp_path):
    """No recordings, and no network."""
    monkeypatch.delenv("DTB_RECORDINGS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def refuse(*arguments, **options):
        raise OSError("no network in tests")

    monkeypatch.setattr(socket, "create_connection", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)


def test_the_list_names_every_recording_and_how_to_cite_it(offline, capsys):
    assert cli.main(["recordings"]) == 0
    text = capsys.readouterr().out
    for name in mapping_names():
        assert f"{name} (rig=" in text
    assert cli.main(["recordings", "--help"]) == 0
    assert "fetch NAME" in capsys.readouterr().out
    for word in ("missing", "DATA_EMPS.mat", "626 kB", "Janot", "CC BY-SA 4.0", "silverbox:test", "https://"):
        assert word in text


def test_the_list_says_where_they_were_found(public, capsys):
    assert cli.main(["recordings"]) == 0
    text = capsys.readouterr().out
    assert "missing" not in text
    assert any(line.endswith("SNLS80mV.csv.gz") for line in text.splitlines())  # whole, to be copied


def test_the_size_of_a_file_of_ones_own_is_that_of_the_file(offline, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "conf" / "recording"
    folder.mkdir(parents=True)
    names = ("large.csv", "small.csv", "absent.csv")
    (folder / "mine.yaml").write_text(f"files: [{', '.join(names)}]\nchannels: {{u: u, x1: x1}}\n")
    (folder / "large.csv").write_bytes(b"1" * 34_567)
    (folder / "small.csv").write_bytes(b"1" * 321)
    assert cli.main(["recordings"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    for said in ("large.csv 35 kB (the default)", "small.csv 321 B", "absent.csv -"):
        assert said in lines


def test_fetch_without_a_network_is_one_line(offline, capsys, tmp_path):
    said = refusal(capsys, "recordings", "fetch", "emps")
    assert said.startswith("recordings=emps: the source cannot be reached; get DATA_EMPS.mat")
    assert str(tmp_path / "cache" / "dtbacklash" / "recordings" / "emps") in said
    assert not (tmp_path / "cache").exists()


def test_fetch_of_what_is_here_needs_no_network(public, monkeypatch, capsys):
    monkeypatch.setattr(socket, "create_connection", None)
    assert cli.main(["recordings", "fetch", "brfd"]) == 0
    assert capsys.readouterr().out.count(".json.gz\n") == 4


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fetch", "nope"], "recordings=nope: choose one of anticogging, brfd, disk, emps, silverbox"),
        (["fetch", "emps", "nope.mat"], "recordings=nope.mat: choose one of DATA_EMPS.mat"),
        (["fetch"], "write dtb recordings fetch NAME"),
        (["remove", "emps"], "takes nothing, fetch NAME, or check FILE"),
    ],
)
def test_wrong_words_are_one_line(words, said, offline, capsys):
    assert said in refusal(capsys, "recordings", *words)


def rms_mm(values: np.ndarray) -> float:
    return 1e3 * float(np.sqrt(np.mean(values**2)))


def test_emps_drifts_away_without_friction_and_stays_with_the_published_one(public):
    """The published parameters leave 7 mm open loop, the bare mass metres."""
    rig = nominal_rig("emps")
    recording = read_recording("emps", rig=rig)
    assert (recording.samples, recording.notes, recording.rig) == (24841, [], "emps")
    measured = recording.channels["qm"] - recording.channels["qm"][0]
    u, _ = refined(recording)
    assert rms_mm(simulate(rig, u, recording.sample_time_s).sensors["qm"] - measured) > 1000
    for effect, values in (("coulomb_friction", {"force": 20.3935}), ("viscous_friction", {"coefficient": 203.5034}),
                           ("constant_force", {"force": 3.1648})):  # fmt: skip
        rig = rig.with_effect("carriage", effect, values)
    assert rms_mm(simulate(rig, u, recording.sample_time_s).sensors["qm"] - measured) < 10


def test_silverbox_is_nearly_linear_and_a_cubic_spring_predicts_the_arrow(public):
    """With the values that a least-squares fit to the multisine gives, the arrow is predicted to below 1 mV."""
    rig = nominal_rig("silverbox")
    train, arrow = read_recording("silverbox", rig=rig), read_recording("silverbox:test", rig=rig)
    assert (train.samples, arrow.samples, train.command) == (65062, 40475, "band_limited")
    cubic = rig.with_parameters({"m": 5.3697e-6, "c": 2.2493e-4, "k": 0.98918})
    cubic = cubic.with_effect("link_1", "cubic_stiffness", {"k3": 3.9137})
    for recording, model, offset, low, high in (
        (train, rig, -0.00523, 6.0, 7.5), (train, cubic, -0.00521, 0.5, 0.7), (arrow, cubic, -0.00521, 0.5, 1.0)
    ):  # fmt: skip
        u, parts = refined(recording)
        y = simulate(model, u, recording.sample_time_s / parts).sensors["y"][::parts] + offset
        assert low < rms_mm((y - recording.channels["y"])[300:]) < high


@pytest.mark.parametrize("file", ["", "dataset-1_1Hz_35lb.json", "dataset-2_0.25Hz_30lb_0.5in.json"])
def test_brfd_is_read_in_si(file, public):
    recording = read_recording("brfd", path=file or None)
    assert recording.sample_time_s == 1 / 1024
    assert recording.notes == []
    assert recording.licence == "CC BY-SA 4.0"
    u, force = recording.channels["u"], recording.channels["force"]
    assert 10.0 < np.ptp(u) / 2 < 40.0  # 0.5 to 1.5 in; 1 V stands for 1 mm
    assert 5e3 < np.abs(force).max() < 3e4  # a 20 kN device
    # the friction force follows the direction of motion
    assert np.corrcoef(np.sign(np.gradient(u)), force)[0, 1] > 0.5


def test_the_disk_swings_with_its_off_centre_mass_and_not_without(public):
    """Gravity of 136.3 1/s^2, dry friction of 6.51 rad/s^2 and one sample of delay, as fitted by hand, over 875 s."""
    rig = nominal_rig("disk")
    recording = read_recording("disk", rig=rig)
    assert (recording.samples, recording.sample_time_s, recording.rig) == (35000, 0.025, "disk")
    u, _ = refined(recording)
    assert rms_rad(simulate(rig, u, 0.025).sensors["th"] - recording.channels["th"]) > 0.3
    inertia = rig.config.parameters["J"].value
    rig = rig.with_parameters({"gain": 28.7 * inertia})
    for place, effect, values in (
        ("disk", "viscous_friction", {"coefficient": 1.10 * inertia}),
        ("disk", "gravity", {"torque": 136.3 * inertia, "phase": np.pi - 0.034}),
        ("disk", "coulomb_friction", {"torque": 6.51 * inertia}),
        ("amplifier", "delay", {"time": 0.025}),
    ):
        rig = rig.with_effect(place, effect, values)
    assert rms_rad(simulate(rig, u, 0.025).sensors["th"] - recording.channels["th"]) < 0.025


def rms_rad(error):
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize(("part", "first_s", "ripple"), [("off", 0.0, 3.31), ("on", 15.002, 0.81)])
def test_compensation_steadies_the_motor(part, first_s, ripple, public):
    recording = read_recording(f"anticogging:{part}", rig=nominal_rig("anticogging"))
    assert recording.t_s[0] == pytest.approx(first_s)
    assert recording.samples == pytest.approx(15000, abs=5)
    assert recording.sample_time_s == pytest.approx(1e-3, rel=1e-3)
    assert any("resampled linearly" in note for note in recording.notes)
    assert recording.units == {"u": "V", "r": "rad/s", "theta": "rad", "omega": "rad/s"}
    omega = recording.channels["omega"]
    assert omega.std() == pytest.approx(ripple, rel=0.02)
    slope = np.polyfit(recording.t_s, recording.channels["theta"], 1)[0]
    assert slope == pytest.approx(omega.mean(), rel=0.02)  # angle and speed agree
