"""Sweeps: one table, one figure, nothing twice, nothing lost."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pyarrow.parquet
import pytest
from told import one_line

import dtbacklash
from dtbacklash.errors import Diverged

pytestmark = [pytest.mark.check, pytest.mark.usefixtures("undrawn")]

# the launcher that stays in this process, where the stand-in is; the real launchers have their own tests
HERE = "hydra/launcher=basic"
QUICK = ("duration_s=2", "figures=false", HERE, "hydra.sweep.dir=here")


@pytest.fixture
def counted(scenario):
    """Count the simulations, by seed; seed 7 diverges, seed 8 meets a bug of ours."""
    seen = []
    original = scenario.run_scenario

    def count(config, progress):
        seen.append(config.seed)
        if config.seed == 7:
            raise Diverged("controller", config.controller.name, 1.5, "q3 = 1000 mm")
        if config.seed == 8:
            raise RuntimeError("a bug\nof ours")
        return original(config, progress)

    scenario.run_scenario = count
    return seen


def table(tmp_path):
    return pd.read_csv(tmp_path / "here" / "sweep.csv")


def test_every_combination_is_a_row_and_a_folder(dtb, tmp_path):
    code, out, err = dtb("run", "-m", "controller=imc,nimc_fixed", "twin.delay_s=0,4", *QUICK)
    assert code == 0
    rows = table(tmp_path)
    assert list(rows.columns[:3]) == ["controller", "twin.delay_s", "overshoot_pct_max"]
    assert rows[["controller", "twin.delay_s"]].to_numpy().tolist() == [
        ["imc", 0], ["imc", 4], ["nimc_fixed", 0], ["nimc_fixed", 4],
    ]  # fmt: skip
    assert rows["overshoot_pct_max"].tolist() == [0.0, 4.0, 0.0, 4.0]  # the stand-in's
    assert (rows["status"] == "done").all()
    assert (tmp_path / "here" / "controller=imc,twin.delay_s=4" / "summary.json").exists()
    assert (tmp_path / "here" / "sweep.png").exists()
    assert "4 of 4 jobs done" in out
    assert "4 of 4 jobs finished" in err
    assert "\x1b" not in out + err


def test_the_same_command_again_does_nothing_twice(dtb, tmp_path, counted):
    for _ in range(2):
        assert dtb("run", "-m", "seed=1,2", *QUICK)[0] == 0
    assert counted == [1, 2]
    shutil.rmtree(tmp_path / "here" / "seed=2")
    out = dtb("run", "-m", "seed=1,2,3", *QUICK)[1]
    assert counted == [1, 2, 2, 3]
    assert "3 of 3 jobs done, 1 of them from before" in out


def test_what_is_believed_may_be_swept_with_nothing_among_the_choices(dtb, tmp_path, scenario):
    """`null` takes back what an experiment believes, in a sweep as in a single run."""
    believed, original = [], scenario.run_scenario

    def note(config, progress):
        believed.append(config.model and config.model.name)
        return original(config, progress)

    scenario.run_scenario = note
    assert dtb("run", "-m", "model=null,lead_screw", *QUICK)[0] == 0
    assert (table(tmp_path)["status"] == "done").all()
    assert believed == [None, "lead_screw"]


def test_jobs_that_would_save_one_recording_are_refused_in_a_line(dtb, tmp_path, counted):
    code, _, err = dtb("run", "-m", "seed=1,2", "recording.save=seen.csv", *QUICK)
    assert code == 2
    assert err == (
        "dtb: error: recording.save=seen.csv: seed=1 and seed=2 would both write it; give each job a file of its own: "
        "'recording.save=seen_${seed}.csv'\n"
    )
    assert (counted, list(tmp_path.iterdir())) == ([], [])
    err = dtb("run", "-m", "controller=imc,nimc_fixed", f"recording.save={tmp_path}/seen.csv", *QUICK)[2]
    assert err.endswith(
        "controller=imc and controller=nimc_fixed would both write it; give each job a file of its own\n"
    )


def test_each_job_saves_its_recording_and_one_whose_file_is_gone_runs_again(dtb, tmp_path, counted):
    words = ("run", "-m", "seed=1,2", "recording.save=seen_${seed}.csv", *QUICK)
    for _ in range(2):
        assert dtb(*words)[0] == 0
        assert counted == [1, 2]
    (tmp_path / "seen_2.csv").unlink()
    assert dtb(*words)[0] == 0
    assert counted == [1, 2, 2]
    assert {path.name for path in tmp_path.glob("*.csv")} == {"seen_1.csv", "seen_2.csv"}


def test_failing_jobs_stop_nobody_and_say_why(dtb, tmp_path, counted):
    code, _, err = dtb("run", "-m", "seed=7,-1,8,1", *QUICK)
    assert code == 1
    rows = table(tmp_path)
    assert rows["status"].tolist() == ["failed", "failed", "failed", "done"]
    assert "diverged at t = 1.500 s" in rows["error"][0]
    assert rows["error"][1] == "seed=-1: must be at least 0 and at most 9223372036854775807"
    assert rows["error"][2] == "RuntimeError: a bug of ours"
    lines = [line for line in err.splitlines() if line.startswith("dtb: ")]
    assert len(lines) == 3
    assert "Traceback" not in err
    folders = sorted(path.name for path in (tmp_path / "here").iterdir() if path.is_dir())
    assert folders == ["seed=1", "status"]
    dtb("run", "-m", "seed=1,8", *QUICK)
    assert counted == [7, 8, 1, 8]  # what failed is tried again
    assert dtb("run", "-m", "seed=7,-1", *QUICK)[0] == 2  # all by wrong input


def test_if_no_job_can_be_set_up_it_is_one_line_and_no_folder(dtb, tmp_path):
    for words, said in ((("twin.dely_s=0,4"), "did you mean twin.delay_s?"), (("twin.delay_s=-1,-2"), "at least 0 s")):
        assert said in one_line(dtb("run", "-m", words, *QUICK))
        assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written(dtb, tmp_path):
    (tmp_path / "file").write_text("")
    line = one_line(dtb("run", "-m", "seed=1,2", "duration_s=2", HERE, "hydra.sweep.dir=file/x"))
    assert line.startswith("hydra.sweep.dir=")


def test_effects_and_rig_files_can_be_swept(dtb, tmp_path):
    packaged = Path(dtbacklash.__file__).parent / "conf" / "rig" / "lead_screw.yaml"
    (tmp_path / "mine.yaml").write_text(packaged.read_text().replace("name: lead_screw", "name: mine"))
    effect = "rig.effects.motor_bearing.coulomb_friction.torque=0,0.01"
    assert dtb("run", "-m", effect, "rig=lead_screw,mine.yaml", *QUICK)[0] == 0
    rows = table(tmp_path)
    assert list(rows.columns[:2]) == ["rig.effects.motor_bearing.coulomb_friction.torque", "rig"]
    assert len(rows) == 4


@pytest.mark.nightly
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_the_launchers_run_the_real_thing(process, tmp_path, launcher):
    if launcher == "submitit_local":
        pytest.importorskip("submitit")
    words = ("-m", "controller=imc,nimc_twin", "duration_s=30", "figures=false", "hydra.sweep.dir=here")
    answer = process("run", *words, f"hydra/launcher={launcher}")
    assert answer.returncode == 0, answer.stderr
    assert "Traceback" not in answer.stderr
    rows = table(tmp_path)
    assert rows["status"].tolist() == ["done", "done"]
    assert rows["overshoot_pct_max"].notna().all()


@pytest.mark.parametrize(
    ("end", "number"),
    [(os.killpg, signal.SIGINT), pytest.param(os.kill, signal.SIGTERM, marks=pytest.mark.nightly)],
    ids=["ctrl-c", "term"],
)
@pytest.mark.usefixtures("interruptible")
def test_an_end_keeps_finished_jobs_and_the_same_command_does_the_rest(process, tmp_path, end, number):
    """Ctrl-C goes to all processes of a terminal, what ends a batch job to the first one only."""
    words = ["run", "-m", "seed=1,2,3,4,5,6", "duration_s=400", "figures=false", "hydra.sweep.dir=here"]
    running = subprocess.Popen(
        [sys.executable, "-m", "dtbacklash.cli", *words], cwd=tmp_path, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    deadline = time.monotonic() + 200
    while not list(tmp_path.glob("here/status/*.json")) and running.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    end(running.pid, number)
    _, err = running.communicate(timeout=60)  # ends when the last worker has closed its end of the pipe
    assert running.returncode == 130
    assert "Traceback" not in err
    kept = {path.parent.name: path.stat().st_mtime_ns for path in tmp_path.glob("here/*/summary.json")}
    assert 1 <= len(kept) < 6
    assert f"{len(kept)} of 6 jobs are done and stay" in err
    assert not list(tmp_path.rglob(".*"))
    answer = process(*words)
    assert answer.returncode == 0, answer.stderr
    assert f"6 of 6 jobs done, {len(kept)} of them from before" in answer.stdout
    for name, stamp in kept.items():
        assert (tmp_path / "here" / name / "summary.json").stat().st_mtime_ns == stamp


def test_a_full_disk_is_one_line(dtb, tmp_path, monkeypatch):
    def full(self, path, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    code, _, err = dtb("run", "-m", "seed=1,2", *QUICK)
    assert code == 1
    assert err.splitlines()[-1].startswith("dtb: error: hydra.sweep.dir=")
    assert "the disk is full; 0 of 2 jobs are done and stay" in err.splitlines()[-1]
    assert not list(tmp_path.rglob("*.partial"))


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_in_this_process_reaches_the_job(dtb, scenario, tmp_path):
    original = scenario.run_scenario

    def interrupted(config, progress):
        if config.seed == 2:
            signal.raise_signal(signal.SIGINT)
        return original(config, progress)

    scenario.run_scenario = interrupted
    code, _, err = dtb("run", "-m", "seed=1,2,3", *QUICK)
    assert code == 130
    assert "1 of 3 jobs are done and stay" in err
    assert sorted(path.name for path in (tmp_path / "here").iterdir()) == ["seed=1", "status"]


@pytest.mark.nightly
def test_two_sweeps_into_one_folder_at_once_share_the_jobs(tmp_path):
    words = ["run", "-m", "seed=1,2,3,4,5,6", "duration_s=100", "figures=false", "hydra.sweep.dir=here"]
    command = [sys.executable, "-m", "dtbacklash.cli", *words]
    both = [
        subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    for one in both:
        out, err = one.communicate(timeout=300)
        assert one.returncode == 0, err
        assert "6 of 6 jobs done" in out
        assert "Traceback" not in err
        assert "failed" not in err
    assert (table(tmp_path)["status"] == "done").all()
    assert not list(tmp_path.rglob(".*"))
    assert sorted(path.name for path in (tmp_path / "here" / "status").iterdir()) == [
        f"seed={j}.json" for j in range(1, 7)
    ]


def test_a_disk_that_is_full_from_some_job_on_is_no_wrong_input(dtb, tmp_path, monkeypatch):
    original = pyarrow.parquet.write_table

    def full(table, path, **options):
        if "seed=2" in str(path):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(table, path, **options)

    monkeypatch.setattr("pyarrow.parquet.write_table", full)
    assert dtb("run", "-m", "seed=2,2", *QUICK)[0] == 1
    code, _, err = dtb("run", "-m", "seed=1,2", *QUICK)
    assert code == 1
    assert "seed=2 failed: hydra.run.dir=" in err
    assert "the disk is full" in err
