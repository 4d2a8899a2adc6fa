"""``dtb diagnose`` from the command line, with a stand-in for the diagnosis itself."""

import logging
from dataclasses import replace

import diagnosed
import numpy as np
import pandas as pd
import pytest
from hydra.core.global_hydra import GlobalHydra

from dtbacklash import cli
from dtbacklash.commands import diagnose as command
from dtbacklash.errors import UserError


@pytest.fixture
def asked(monkeypatch):
    """What reached the diagnosis; it answers with a made-up one."""
    seen = {}
    view = diagnosed.missing()

    def pretend(train, held_out, rig, jobs, progress):
        seen.update(train=train, held_out=held_out, rig=rig, jobs=jobs)
        for fraction, text in ((0.0, "comparing"), (0.2, "comparing"), (0.5, "naming")):
            progress(fraction, text)
        return replace(view, source=command._source(train), notes=command._notes(train, held_out))

    monkeypatch.setattr(command, "run_diagnosis", pretend)
    return seen


@pytest.fixture
def dtb(tmp_path, monkeypatch, capsys, asked):
    """Run ``dtb`` here in an empty folder that holds bench.csv: words -> (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DTB_RECORDINGS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("dtbacklash.compiled.is_cold", lambda: False)
    t = np.arange(4000) * 1e-3
    slow = np.sin(7 * t) + 0.3 * np.sin(23 * t)
    table = pd.DataFrame({"t": t, "u": 2 * slow, "theta_m": 3 * slow, "q3": slow, "lab": 1.0 + t})
    table.to_csv("bench.csv", index=False)

    def call(*words):
        GlobalHydra.instance().clear()
        code = cli.main(["diagnose", *map(str, words)])
        out, err = capsys.readouterr()
        return code, out, err

    yield call
    GlobalHydra.instance().clear()


def test_it_writes_everything_and_says_what_it_found(dtb, asked, tmp_path, files):
    code, out, err = dtb("recording=bench.csv", "out=found")
    assert (code, err) == (0, "")
    assert files(tmp_path / "found") == [
        "diagnosis.json", "figures/curve_q3.png", "figures/curve_theta_m.png", "figures/force_1_motor_bearing.png",
        "figures/rig.png", "report.html", "rig.yaml",
    ]  # fmt: skip
    for phrase in ("missing_physics: Missing: Coulomb", "torque = 20.0 +/- 0.5 mN m", "cannot tell it from dead zone",
                   "held out", "0.042 %", "found/report.html"):  # fmt: skip
        assert phrase in out
    page = (tmp_path / "found" / "report.html").read_text(encoding="utf-8")
    assert "Columns that are no channels of the rig are not used: lab." in page
    assert "Fitted to the beginning of bench.csv, 0 to 3.999 s (4000 samples); its last 30 % judge." in page
    assert asked["jobs"] >= 1
    assert (asked["train"].samples, asked["held_out"]) == (4000, None)


def test_the_default_folder_is_named_after_the_recording(dtb, tmp_path):
    assert dtb("recording=bench.csv")[0] == 0
    (report,) = tmp_path.glob("outputs/*/*_diagnose_bench/report.html")
    assert report.is_file()


def test_an_earlier_diagnosis_is_replaced_but_nothing_else(dtb, tmp_path):
    assert dtb("recording=bench.csv", "out=found")[0] == 0
    assert dtb("recording=bench.csv", "out=found")[0] == 0
    (tmp_path / "found" / "notes.txt").write_text("mine")
    code, _, err = dtb("recording=bench.csv", "out=found")
    assert code == 2
    assert err.startswith("dtb: error: out=")


def test_rig_names_files_and_changes_work_as_in_a_run(dtb, asked, tmp_path):
    dtb("recording=bench.csv", "rig=lead_screw", "rig.parameters.k.value=9500", "jobs=7",
        "rig.effects.motor_bearing.coulomb_friction.torque=0.01", "out=a")  # fmt: skip
    assert asked["jobs"] == 7
    assert asked["rig"].elements["link_1"].values["stiffness"] == 9500.0
    assert asked["rig"].effect("motor_bearing", "coulomb_friction") == {"torque": 0.01}
    assert dtb("recording=bench.csv", "rig=a/rig.yaml", "out=b")[0] == 0
    assert asked["rig"].effect("gear", "backlash") == {"half_gap": 0.349}


def test_another_recording_may_judge(dtb, asked, tmp_path):
    pd.read_csv("bench.csv").iloc[:900].to_csv("other.csv", index=False)
    assert dtb("recording=bench.csv", "validation=other.csv", "out=a")[0] == 0
    assert (asked["train"].samples, asked["held_out"].samples) == (4000, 900)


def test_the_rig_of_a_mapping_is_taken(monkeypatch):
    assert command.nominal_rig(command.parse(["recording=emps"])).config.name == "emps"
    assert command.nominal_rig(command.parse(["recording=silverbox:arrow"])).config.name == "silverbox"


def test_verbose_says_what_it_is_doing_once_each_and_leaves_logging_alone(dtb):
    before = list(logging.getLogger("dtbacklash").handlers)
    _, _, err = dtb("recording=bench.csv", "out=a", "-v")
    lines = [line for line in err.splitlines() if line.startswith("dtb: ")]
    assert sum("comparing" in line for line in lines) == 1
    assert any("naming" in line for line in lines)
    assert any("its last 30 % judge" in line for line in lines)
    assert logging.getLogger("dtbacklash").handlers == before


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["recording=nowhere.csv"], "recording=nowhere.csv: no such file"),
        (["recording=emps"], "recording=emps: DATA_EMPS.mat is not here"),
        ([], "recording=(missing): give a file or one of"),
        (["recording=bench.csv", "recording=bench.csv"], "recording=bench.csv: is given twice"),
        (["recording="], "recording=: give a value"),
        (["recording=bench.csv", "rig=nosuch"], "rig=nosuch: choose one of"),
        (["recording=bench.csv", "rig=emps"], "recording=bench.csv: holds none of the sensors of emps"),
        (["recording=bench.csv", "rig.parameters.k.value=soft"], "rig.parameters.k.value=soft: must be a number"),
        (["recording=bench.csv", "rig.effects.gear.rust.size=1"], "rig.effects.gear.rust=rust: an element of kind"),
        (["recording=bench.csv", "jobs=-1"], "jobs=-1: must be a whole number from 1"),
        (["recording=bench.csv", "validation=gone.csv"], "validation=gone.csv: no such file"),
        (["recording=bench.csv", "colour=red"], "colour=red: no such setting; choose one of recording"),
        (["recording=bench.csv", "-x"], "option=-x: choose one of -v"),
        (["bench.csv"], "argument=bench.csv: write key=value"),
        (["recording=bench.csv", "out=bench.csv"], "out="),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(dtb, tmp_path, words, line):
    code, out, err = dtb(*words)
    assert code == 2
    assert err.startswith(f"dtb: error: {line}"), err
    assert err.count("\n") == 1
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["bench.csv"]


def test_what_goes_wrong_inside_leaves_no_folder(dtb, tmp_path, monkeypatch):
    def fail(*_):
        raise UserError("recording", "bench.csv", "cannot be explained")

    monkeypatch.setattr(command, "run_diagnosis", fail)
    code, _, err = dtb("recording=bench.csv", "out=deep/found")
    assert (code, err) == (2, "dtb: error: recording=bench.csv: cannot be explained\n")
    assert [path.name for path in tmp_path.iterdir()] == ["bench.csv"]


def test_help_needs_no_recording(dtb):
    code, out, _ = dtb("--help")
    assert code == 0
    assert all(key in out for key in ("recording=FILE", "validation=", "rig=NAME|FILE", "out=FOLDER", "-v"))
    assert max(map(len, out.splitlines())) <= 120
    assert "diagnose" in cli.usage()
