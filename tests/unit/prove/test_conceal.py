"""Concealed recordings on disk: complete, telling nothing, and out of the diagnosis' reach."""

import gzip
import json

import numpy as np
import pytest

from dtbacklash.errors import UserError
from dtbacklash.prove import conceal as concealing
from dtbacklash.prove import seal
from dtbacklash.prove.conceal import conceal
from dtbacklash.prove.draw import record
from dtbacklash.recording import read_recording

pytestmark = pytest.mark.usefixtures("short")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "hidden"


def test_a_case_holds_the_recording_what_is_public_and_the_seal(lead_screw, folder):
    case = conceal(3, lead_screw, folder, effect="gear.backlash", instruments="rich")
    assert case.parent == folder
    assert sorted(p.name for p in case.iterdir()) == ["public.json", "recording.csv.gz", "sealed.json"]
    assert json.loads((case / "public.json").read_text()) == {
        "rig": "lead_screw", "channels": ["theta_m", "q3", "i_m", "q2"],
    }  # fmt: skip
    secret = seal.open_seal(case, folder.with_name("hidden.key"))
    assert [(e["location"], e["effect"]) for e in secret.effects] == [("gear", "backlash")]
    assert not list(folder.glob(".*"))


def test_what_is_read_is_what_the_sensors_saw(lead_screw, folder):
    case = conceal(3, lead_screw, folder, kind="nothing", instruments="minimal")
    read = read_recording(str(case / "recording.csv.gz"), rig=lead_screw)
    _, run = record(seal.open_seal(case, folder.with_name("hidden.key")), lead_screw)
    assert read.sample_time_s == pytest.approx(1e-3)
    assert read.samples == 3001
    assert set(read.channels) == {"r", "u", "theta_m", "q3"}
    assert np.allclose(read.channels["q3"], run.seen["q3"], rtol=0.0, atol=1e-12)
    assert np.allclose(read.channels["theta_m"], run.seen["theta_m"], rtol=1e-11)
    assert np.allclose(read.channels["u"], run.u, rtol=1e-11)


def test_neither_names_nor_contents_tell_what_is_hidden(lead_screw, folder):
    case = conceal(123456, lead_screw, folder, effect="gear.backlash")
    columns, *rows = gzip.decompress((case / "recording.csv.gz").read_bytes()).decode().splitlines()
    assert columns.split(",")[:3] == ["t", "r", "u"]
    assert len(rows) == 3001
    told = case.name + columns + (case / "public.json").read_text() + (case / "sealed.json").read_text()
    told = told.replace(seal.FORMAT, "")
    assert all(word not in told for word in ("backlash", "half_gap", "123456", "single", "excitation"))


def test_the_same_seed_and_key_give_the_same_case_and_bytes(lead_screw, folder, tmp_path):
    key = folder.with_name("hidden.key")
    one = conceal(5, lead_screw, folder, kind="nothing")
    two = conceal(5, lead_screw, tmp_path / "again", kind="nothing", key_file=key)
    other = conceal(5, lead_screw, tmp_path / "other", kind="nothing")
    assert one.name == two.name != other.name
    content = [(c / "recording.csv.gz").read_bytes() for c in (one, two, other)]
    assert content[0] == content[1] == content[2]


def test_a_case_that_is_there_is_not_made_again(lead_screw, folder, monkeypatch):
    case = conceal(5, lead_screw, folder, kind="nothing")
    before = (case / "sealed.json").read_bytes()
    with pytest.raises(UserError, match="seed=5: its recording is there already"):
        conceal(5, lead_screw, folder, kind="nothing")
    monkeypatch.setattr(concealing, "draw", None)
    assert conceal(5, lead_screw, folder, kind="nothing", keep=True) == case
    assert (case / "sealed.json").read_bytes() == before


def test_a_key_in_the_folder_and_wrong_choices_leave_nothing(lead_screw, folder, tmp_path):
    for choice, said in (({"key_file": folder / "key"}, "a file outside"), ({"kind": "odd"}, "kind=odd")):
        with pytest.raises(UserError, match=said):
            conceal(5, lead_screw, folder, **choice)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_left_when_it_fails_half_way(lead_screw, folder, monkeypatch):
    def fail(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(seal, "seal", fail)
    with pytest.raises(UserError, match="cannot be written: the disk is full"):
        conceal(5, lead_screw, folder, kind="nothing")
    assert list(folder.iterdir()) == []
