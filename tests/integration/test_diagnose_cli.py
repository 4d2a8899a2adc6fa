"""``dtb diagnose`` from the command line, with a stand-in for the diagnosis itself."""

import errno
import json
import logging
from dataclasses import replace
from functools import partial

import diagnosed
import numpy as np
import pandas as pd
import pytest
import yaml
from told import one_line

from dtbacklash.commands import diagnose as command
from dtbacklash.diagnosis.explain.sentences import notes_of
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.diagnosis.several import source_of
from dtbacklash.errors import UserError
from dtbacklash.report.diagnosis import page

pytestmark = pytest.mark.check


@pytest.fixture
def asked(monkeypatch, undrawn):
    """What reached the diagnosis; it answers with a made-up one."""
    seen = {}
    made_up = diagnosed.missing()

    def pretend(train, held_out, rig, jobs, progress, config, keep):
        seen.update(
            keep=keep, train=train, held_out=held_out, rig=rig, jobs=jobs, enough=config.enough, search=config.search
        )
        for fraction, text in ((0.0, "comparing"), (0.2, "comparing"), (0.5, "naming")):
            progress(fraction, text)
        if keep and seen.get("stopped"):  # as if Ctrl-C came
            return replace(made_up, stopped="naming")
        return replace(made_up, source=source_of(train), notes=notes_of(train, held_out, SETTINGS.held_out_share))

    monkeypatch.setattr(command, "run_diagnosis", pretend)
    return seen


@pytest.fixture
def dtb(typed, tmp_path_factory, monkeypatch, asked):
    """Run ``dtb diagnose`` here in an empty folder that holds bench.csv: words -> (exit code, stdout, stderr)."""
    monkeypatch.delenv("DTB_RECORDINGS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    t = np.arange(4000) * 1e-3
    slow = np.sin(7 * t) + 0.3 * np.sin(23 * t)
    table = pd.DataFrame({"t": t, "u": 2 * slow, "theta_m": 3 * slow, "q3": slow, "lab": 1.0 + t})
    table.to_csv("bench.csv", index=False)
    return partial(typed, "diagnose")


def test_what_was_known_when_it_was_stopped_is_written_and_marked(dtb, asked, tmp_path):
    asked["stopped"] = True
    code, out, _ = dtb("recording=bench.csv", "out=found")
    assert code == 130
    assert out.startswith("stopped early; so far missing_physics: Coulomb")
    assert json.loads((tmp_path / "found" / "diagnosis.json").read_text())["stopped_early"] == "naming"
    assert ">stopped early</div>" in (tmp_path / "found" / "report.html").read_text(encoding="utf-8")
    asked["stopped"] = False
    code, out, _ = dtb("recording=bench.csv", "out=found")  # takes its place
    assert code == 0
    assert "stopped" not in out + (tmp_path / "found" / "diagnosis.json").read_text()
    assert asked["keep"] is True
    dtb("-m", "recording=bench.csv", "search=full,quick", "out=jobs", "hydra/launcher=basic")
    assert asked["keep"] is False  # a job of a sweep that was stopped is not done


@pytest.mark.parametrize(("stopped", "times"), [(False, 1), (False, 2), (True, 1)])
def test_what_was_found_is_written_though_ctrl_c_comes_meanwhile(dtb, asked, tmp_path, monkeypatch, stopped, times):
    """The first one; a second ends it."""
    left = [times]
    write = page.write

    def interrupted(*words):
        if left[0]:
            left[0] -= 1
            raise KeyboardInterrupt
        return write(*words)

    monkeypatch.setattr("dtbacklash.report.diagnosis.page.write", interrupted)
    asked["stopped"] = stopped
    code, _, err = dtb("recording=bench.csv", "out=found")
    ended = stopped or times == 2
    assert code == (130 if ended else 0)
    assert ("dtb: interrupted" in err, (tmp_path / "found").exists()) == (ended, not ended)


def test_a_full_disk_does_not_lose_what_was_found(dtb, asked, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("dtbacklash.report.diagnosis.page.write", full)
    code, out, err = dtb("recording=bench.csv", "out=found")
    assert code == 1
    assert err.count("the disk is full") == 1
    assert "missing_physics: Coulomb" in out
    rig = yaml.safe_load(out.partition("could not be written:")[2])
    assert rig["effects"]["motor_bearing"]["coulomb_friction"]["torque"] == 0.02
    assert not (tmp_path / "found").exists()


def test_it_writes_everything_and_says_what_it_found(dtb, asked, tmp_path, files):
    code, out, err = dtb("recording=bench.csv", "out=found")
    assert code == 0
    assert all(line.startswith("dtb: ") for line in err.splitlines())  # notes on the recording, and nothing else
    assert files(tmp_path / "found") == [
        "diagnosis.json", "figures/curve_q3.png", "figures/curve_theta_m.png", "figures/judged.png",
        "figures/law_1_motor_bearing.png", "figures/rig.png", "report.html", "rig.yaml",
    ]  # fmt: skip
    for phrase in ("missing_physics: Coulomb", "torque 20.0 +/- 0.5", "open against dead", "85 % of the mismatch",
                   "What is left where", "dtb run rig=found/rig.yaml\n", "found/report.html"):  # fmt: skip
        assert phrase in out
    page = (tmp_path / "found" / "report.html").read_text(encoding="utf-8")
    assert "Columns that are no channels of the rig are not used: lab." in page
    assert (
        "The recording is bench.csv, 0 to 3.999 s (4000 samples): 80 % of it are fitted to, and the last 20 % judge."
        in page
    )
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
    assert one_line(dtb("recording=bench.csv", "out=found")).startswith("out=")


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


def test_the_rig_of_a_mapping_is_taken_unless_another_is_chosen(dtb):
    assert "  name: emps" in dtb("--cfg", "job", "recording=emps")[1]
    assert "  name: silverbox" in dtb("--cfg", "job", "recording=silverbox:arrow")[1]
    assert "  name: lead_screw" in dtb("--cfg", "job", "recording=emps", "rig=lead_screw")[1]
    assert "  name: lead_screw" in dtb("--cfg", "job", "recording=bench.csv")[1]


def test_units_and_trust_reach_the_reader(dtb, monkeypatch):
    seen = {}

    def read(source, validation, **how):
        seen.update(how, source=source)
        raise UserError("recording", source, "enough")

    monkeypatch.setattr("dtbacklash.recording.read_together", read)
    dtb("recording=bench.csv", "units={q3: m, theta_m: deg}", "recording.trust_units=true")
    assert seen["units"] == {"q3": "m", "theta_m": "deg"}
    assert seen["trust_units"] is True


def test_strange_names_of_files_work(dtb, asked, tmp_path):
    folder = tmp_path / "a b, ä"
    folder.mkdir()
    (tmp_path / "bench.csv").rename(folder / "it's (1).csv")
    code, out, err = dtb("recording=a b, ä/it's (1).csv", "out=out ü, b", "validation=a b, ä/it's (1).csv")
    assert code == 0
    assert all(line.startswith("dtb: ") for line in err.splitlines())  # notes on the recording, and nothing else
    assert out.splitlines()[-1] == "out ü, b/report.html"
    assert asked["train"].samples == 4000


def test_a_sweep_over_recordings_ends_with_one_table(dtb, asked, tmp_path):
    (tmp_path / "bench.csv").rename(tmp_path / "my bench.csv")
    pd.read_csv(tmp_path / "my bench.csv").iloc[:900].to_csv(tmp_path / "b.csv", index=False)
    words = ("-m", "recording=my bench.csv,b.csv,gone.csv", "hydra/launcher=basic", "out=all")
    code, out, err = dtb(*words)
    assert code == 1
    assert "no such file" in err
    table = pd.read_csv(tmp_path / "all" / "diagnose.csv")
    assert table["recording"].tolist() == ["my bench.csv", "b.csv", "gone.csv"]
    assert table["verdict"].tolist()[:2] == ["missing_physics"] * 2
    assert table["findings"][0] == "motor_bearing.coulomb_friction, gear.backlash"
    assert (table["held_out_extended"] < table["held_out_nominal"])[:2].all()
    assert "missing_physics" in out
    page = (tmp_path / "all" / "report.html").read_text(encoding="utf-8")
    assert page.count("report.html") >= 2
    asked.clear()
    assert "2 of them from before" in dtb(*words)[1]
    assert not asked


def test_recordings_of_different_mappings_get_their_own_rigs():
    assert command.with_rig(["recording.source=emps"]) == ["recording.source=emps", "rig=emps"]
    assert command.with_rig(["recording.source='silverbox:arrow'"])[-1] == "rig=silverbox"
    assert command.with_rig(["recording=emps", "rig=lead_screw"])[-1] == "rig=lead_screw"
    assert command.with_rig(["recording.source=bench.csv"]) == ["recording.source=bench.csv"]


def test_verbose_says_what_it_is_doing_once_each_and_leaves_logging_alone(dtb):
    before = list(logging.getLogger("dtbacklash").handlers)
    _, _, err = dtb("recording=bench.csv", "out=a", "-v")
    lines = [line for line in err.splitlines() if line.startswith("dtb: ")]
    assert sum("comparing" in line for line in lines) == 1
    assert any("naming" in line for line in lines)
    assert any("the last 20 % judge" in line for line in lines)
    assert logging.getLogger("dtbacklash").handlers == before


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["recording=nowhere.csv"], "recording=nowhere.csv: no such file"),
        (["recording=emps"], "recording=emps: DATA_EMPS.mat is not here"),
        ([], "recording=(missing): give a file or one of"),
        (["recording=bench.csv", "recording=bench.csv"], "recording=bench.csv: is given twice"),
        (["recording=bench.csv,b.csv"], "recording=bench.csv,b.csv: takes one value here; give several with -m"),
        (["recording=u:"], "recording=u:: "),
        (["recording="], "recording=: give a value"),
        (["recording=bench.csv", "rig=nosuch"], "rig=nosuch: choose one of"),
        (["recording=bench.csv", "rig=emps"], "recording=bench.csv: holds none of the sensors of emps"),
        (["recording=bench.csv", "rig.parameters.k.value=soft"], "rig.parameters.k.value=soft: must be a finite"),
        (["recording=bench.csv", "rig.effects.gear.rust.size=1"], "rig.effects.gear.rust=rust: an element of kind"),
        (["recording=bench.csv", "jobs=-1"], "jobs=-1: must be at least 1 and at most 256"),
        (["recording=bench.csv", "validation=gone.csv"], "validation=gone.csv: no such file"),
        (
            ["recording=bench.csv", "colour=red"],
            "colour=red: no such setting; choose one of compare, enough, given, hold_out, jobs, out",
        ),
        (["recording=bench.csv", "-x"], "option=-x: choose one of"),
        (["bench.csv"], "argument=bench.csv: write key=value"),
        (["recording=bench.csv", "out=bench.csv"], "out="),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(dtb, tmp_path, words, line):
    assert one_line(dtb(*words)).startswith(line)
    assert [path.name for path in tmp_path.iterdir()] == ["bench.csv"]


def test_what_goes_wrong_inside_leaves_no_folder(dtb, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise UserError("recording", "bench.csv", "cannot be explained")

    monkeypatch.setattr(command, "run_diagnosis", fail)
    assert one_line(dtb("recording=bench.csv", "out=deep/found")) == "recording=bench.csv: cannot be explained\n"
    assert [path.name for path in tmp_path.iterdir()] == ["bench.csv"]
