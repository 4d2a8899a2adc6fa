"""`dtb conceal`: recordings in a new folder, sealed, complete or not there; every mistake is one line."""

import json

import pytest
from told import refusal

from dtbacklash import cli
from dtbacklash.physics.rig_file import rig_yaml
from dtbacklash.prove import conceal as concealing
from dtbacklash.prove import draw as drawing
from dtbacklash.prove.conceal import nominal_rig
from dtbacklash.prove.seal import open_seal
from dtbacklash.recording import read_recording


@pytest.fixture(autouse=True)
def here(monkeypatch, tmp_path):
    """An empty folder to work in, and recordings of 3 s, so that the tests are quick."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(drawing, "DURATION_S", (3, 3))
    return tmp_path


@pytest.mark.check
def test_recordings_are_made_sealed_and_can_be_diagnosed_next(here, capsys):
    assert cli.main(["conceal", "out=hidden", "n=3", "seed=7", "kind=nothing"]) == 0
    shown = capsys.readouterr().out.splitlines()
    cases = sorted((here / "hidden").glob("*/"))
    assert len(cases) == 3
    assert shown[0] == "3 concealed recordings in hidden"
    assert "hidden.key" in shown[1]
    secrets = [open_seal(case, here / "hidden.key") for case in cases]
    assert sorted(s.seed for s in secrets) == [7, 8, 9]
    assert {s.kind for s in secrets} == {"nothing"}
    for line in shown[2:]:
        command, recording, rig = line.rsplit(" ", 2)
        assert (command, rig) == ("dtb diagnose", "rig=lead_screw")
        assert read_recording(recording.removeprefix("recording=")).samples == 3001
    assert sorted(p.name for p in here.iterdir()) == ["hidden", "hidden.key"]


def test_one_effect_and_instruments_can_be_chosen_and_the_key_put_elsewhere(here, capsys):
    words = ["out=a/play", "seed=3", "effect=gear.backlash", "instruments=rich", "key=keys/mine"]
    assert cli.main(["conceal", *words]) == 0
    (case,) = (here / "a" / "play").glob("*/")
    assert json.loads((case / "public.json").read_text())["channels"] == ["theta_m", "q3", "i_m", "q2"]
    secret = open_seal(case, here / "keys" / "mine")
    assert [e["effect"] for e in secret.effects] == ["backlash"]
    assert "backlash" not in capsys.readouterr().out


@pytest.mark.parametrize(("words", "parameters"), [
    (["rig=mine.yaml"], {"m": 2.0, "p": 1e-3}), (["rig.parameters.k.value=9500"], {"k": 9500.0}),
])  # fmt: skip
def test_a_rig_of_the_users_own_or_one_that_is_changed_is_kept_with_the_recordings(here, capsys, words, parameters):
    (here / "mine.yaml").write_text(rig_yaml(nominal_rig("lead_screw").with_parameters({"m": 2.0, "p": 1e-3})))
    assert cli.main(["conceal", "out=hidden", *words, "kind=nothing"]) == 0
    (case,) = (here / "hidden").glob("*/")
    assert json.loads((case / "public.json").read_text())["rig"] == "../rig.yaml"
    assert "rig=hidden/rig.yaml" in capsys.readouterr().out
    kept = nominal_rig("hidden/rig.yaml").config.parameters
    assert {name: kept[name].value for name in parameters} == parameters


def test_strange_names_of_files_work(here, capsys):
    assert cli.main(["conceal", "out=hidden ä, b", "key=my keys/it's", "kind=nothing"]) == 0
    (case,) = (here / "hidden ä, b").glob("*/")
    assert open_seal(case, here / "my keys" / "it's").kind == "nothing"
    line = capsys.readouterr().out.splitlines()[2]
    assert line == f"dtb diagnose 'recording=hidden ä, b/{case.name}/recording.csv.gz' rig=lead_screw"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["out"], "argument=out: write key=value"),
        (["out="], "out=: give a folder"),
        (["out=x", "out=y"], "out=y: is given twice; the first is x"),
        (["-q", "out=x"], "option=-q: choose one of --cfg"),
        (["out=x", "size=3"], "size=3: no such setting; choose one of effect, instruments, key, kind"),
        (["out=/"], "out=/: give a folder of its own"),
        (["out=x", "n=0"], "n=0: must be at least 1 and at most 100000"),
        (["out=x", "n=many"], "n=many: must be a whole number"),
        (["out=x", "seed=-1"], "seed=-1: must be at least 0"),
        (["out=x", "kind=odd"], "kind=odd: choose one of nothing, parameters, single, several, unknown"),
        (["out=x", "effect=sensor_q2.delay", "instruments=minimal"], "instruments=minimal: rich, or sensor_q2 is not"),
        (["out=x", "effect=mass_1.absorber"], "effect=mass_1.absorber: write location.effect; locations: amplifier"),
        (["out=x", "effect=backlash"], "effect=backlash: write location.effect"),
        (["out=x", "effect=gear.slip"], "effect=gear.slip: at gear choose one of backlash"),
        (["out=x", "effect=gear.backlash", "kind=nothing"], "kind=nothing: effect= hides a single one"),
        (["out=x", "instruments=all"], "instruments=all: choose one of minimal, rich"),
        (["out=x", "rig=emps", "effect=gear.backlash"], "effect=gear.backlash: write location.effect; locations"),
        (["out=x", "rig=nowhere"], "rig=nowhere: choose one of"),
        (["out=x", "key=x/key"], "key=x/key: a file outside the folder of the recordings"),
        (["out=file/x"], "cannot be written"),
        (["out=x", "key=file"], "key=file: holds no key"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(here, capsys, words, line):
    (here / "file").write_text("something")
    assert line in refusal(capsys, "conceal", *words).replace(f"{here}/", "")
    assert [p.name for p in here.iterdir()] == ["file"]


def test_a_folder_with_something_in_it_is_not_overwritten(here, capsys):
    assert cli.main(["conceal", "out=hidden", "kind=nothing"]) == 0
    before = sorted(here.rglob("*"))
    assert cli.main(["conceal", "out=hidden", "kind=nothing"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("dtb: error: out=")
    assert "holds recordings of an earlier dtb conceal" in said
    assert "give a new folder (out=FOLDER), or remove this one first" in said
    assert sorted(here.rglob("*")) == before


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt(), 130), (OSError(28, "No space left"), 1)])
def test_nothing_is_left_when_it_is_interrupted_or_the_disk_is_full(here, capsys, monkeypatch, error, code):
    write, made = concealing.write_case, []

    def second_fails(case, *arguments):
        if made:
            raise error
        write(case, *arguments)
        made.append(case)

    monkeypatch.setattr(concealing, "write_case", second_fails)
    assert cli.main(["conceal", "out=deep/hidden", "n=3", "kind=nothing"]) == code
    assert capsys.readouterr().err.count("\n") == 1
    assert len(made) == 1
    assert list(here.iterdir()) == []


def test_a_key_that_was_there_stays_when_it_fails(here, capsys):
    assert cli.main(["conceal", "out=one", "kind=nothing", "key=k"]) == 0
    key = (here / "k").read_bytes()
    assert cli.main(["conceal", "out=one", "kind=nothing", "key=k"]) == 2
    assert cli.main(["conceal", "out=two", "kind=nothing", "key=k"]) == 0
    assert (here / "k").read_bytes() == key
    assert [c.name for c in (here / "one").glob("*/")] == [c.name for c in (here / "two").glob("*/")]
