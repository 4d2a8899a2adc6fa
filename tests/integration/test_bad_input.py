"""Whatever a user gets wrong: one line with key, value and what is allowed; exit code 2; nothing left.

A full disk is nobody's wrong input: exit code 1.
"""

import errno
import os
import resource
import signal
import subprocess
import sys
import time

import pytest
from told import one_line, without_progress

from dtbacklash.errors import Diverged

#: word -> what is allowed, or (what the line names, what is allowed) where that is not the key of the word
WRONG = {
    "controller=foo": "one of imc, lqg, mpc, nimc_fixed, nimc_novelty, nimc_twin, offset, open_loop, pid, state_space",
    "profile=foo": "choose one of constant, csv, ramp, s_curve, step, wear", "experiment=foo": "fig13",
    "hydra/launcher=foo": "joblib", "rig=foo": "silverbox, two_mass_stage, or the path of a YAML file",
    "rig=foo.yaml": "no such file", "twin=null": "choose one of cloud", "twin.dely_s=3": "did you mean twin.delay_s?",
    "+twin.dely_s=3": ("twin.dely_s", "did you mean twin.delay_s?"), "dealy_s=3": "did you mean twin.delay_s?",
    "xyzzy=3": "no such setting", "hydra.run.dri=x": "did you mean hydra.run.dir?",
    "twin.delay_s=abc": "must be a number", "twin.delay_s=4s": "must be a number",
    "twin.delay_s=null": "must be a number", "twin.delay_s=": "must be a number",
    "twin.delay_s=-1": "must be at least 0 s", "twin.buffer=1.5": "must be a whole number",
    "twin.buffer=1000000": "must not be longer than the run (200000 samples)",
    "twin.guard=perhaps": "must be true or false", "sensors.noise.q3_mm=abc": "must be a number",
    "sensors.noise.q9_mm=1": "lead_screw has theta_m, q3", "rig.parameters.zz.value=3": "the rig has no such parameter",
    "rig.parameters.m=9": ("rig.parameters.m=9", "write rig.parameters.m.value=9"),
    "rig.parameters.m.value=abc": "must be a finite number", "rig.effects.gear=3": "a mapping",
    "profile=csv": ("profile.path=", "columns t_s,gap_deg"), "reference=csv": ("reference.path=", "columns t_s,r_mm"),
    "sample_time_s=0.0003": ("duration_s=", "whole number of samples"), "seed=-1": "must be at least 0",
    "seed=${nope}": "nope", "optimizer.name=guess": "choose one of bfgs",
    "controller=imc,nimc_fixed": "give several with -m", "twin.delay_s=[1": "cannot be read",
    "~twin": ("twin", "cannot be removed"), "a b": ("argument=a b", "write key=value"),
    "=3": ("argument==3", "write key=value"), "--frobnicate": ("option=", "choose one of --cfg"),
    "hydra.run.dir=": "give a folder", "out=": "give a folder", "recording=emps": "is a recording to diagnose",
    "rig=a.yaml,b.yaml": "give several with -m",
}  # fmt: skip


def check(answer, key, said, exit_code=2):
    code, *rest = answer
    assert code == exit_code
    line = one_line((2, *rest))
    assert line.startswith(key)
    assert said in line


@pytest.mark.parametrize("word", WRONG)
def test_one_line_exit_2_nothing_left(dtb, tmp_path, word):
    wrong = WRONG[word]
    key, said = (word.partition("=")[0], wrong) if isinstance(wrong, str) else wrong
    check(dtb("run", word), key, said)
    assert list(tmp_path.iterdir()) == []


def test_open_loop_takes_no_model(dtb):
    check(dtb("run", "controller=open_loop", "model=lead_screw"), "model=lead_screw", "open loop uses no model")


def test_an_unknown_command(dtb):
    check(dtb("fly"), "command=fly", "choose one of run, paper")
    check(dtb("paper", "seed=1"), "seed=1", "no such setting")


def test_a_wrong_file_names_the_file_and_the_row(dtb, tmp_path):
    (tmp_path / "gap.csv").write_text("t_s,gap_deg\n0,0\n10,nan\n200,1\n")
    check(dtb("run", "profile=csv", "profile.path=gap.csv"), "profile.path=gap.csv", "row 2")
    (tmp_path / "r.csv").write_text("t_s,r_mm\n0,0\n10,1\n")
    check(dtb("run", "reference=csv", "reference.path=r.csv"), "reference.path=r.csv", "needs 0 to 200 s")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["gap.csv", "r.csv"]


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ("name: [oops\n", "rig=mine.yaml", "not valid YAML"),
        ("name: x\nmass: 3\n", "rig.mass=", "no such setting"),
        ("- 1\n- 2\n", "rig", ""),
        ("3\n", "rig", ""),
        ("parameters: {m: {value: heavy}}\n", "rig.parameters.m.value=heavy", "must be a finite number"),
        ("elements: {gear: 3}\n", "rig.elements.gear=3", "a mapping"),
        ("\x00\x01", "rig=mine.yaml", "not valid YAML"),
        ("name: ${oc.env:HOME}\n", "rig=mine.yaml", "is not resolved in a file"),
        ("a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *b]\nname: *b\nname: 3\n", "rig=mine.yaml", "gives the key name twice"),
    ],
)
def test_a_wrong_rig_file(dtb, tmp_path, text, key, said):
    (tmp_path / "mine.yaml").write_text(text)
    check(dtb("run", "rig=mine.yaml"), key, said)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"]


def test_a_wrong_file_in_the_users_conf(dtb, tmp_path):
    (tmp_path / "conf" / "twin").mkdir(parents=True)
    (tmp_path / "conf" / "twin" / "mine.yaml").write_text("delay_s: {\n")
    check(dtb("run", "twin=mine"), "twin=conf/twin/mine.yaml: ", "is not valid YAML: expected the node content")


def test_a_loop_that_diverges_says_when(dtb, scenario, tmp_path):
    def diverge(config, progress):
        raise Diverged("controller.k_theta_v_per_rad", config.controller.k_theta_v_per_rad, 1.25, "q3 = 1000 mm")

    scenario.run_scenario = diverge
    answer = dtb("run", "controller.k_theta_v_per_rad=900")
    check(answer, "controller.k_theta_v_per_rad=900", "diverged at t = 1.250 s")
    assert list(tmp_path.iterdir()) == []


def test_places_that_cannot_be_written(dtb, tmp_path):
    (tmp_path / "file").write_text("precious")
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("precious")
    for place, said in {
        "file": "file exists", "file/run": "not a directory", "thesis": "not an earlier run",
        "/proc/run": "cannot be written",
    }.items():  # fmt: skip
        check(dtb("run", "duration_s=2", f"hydra.run.dir={place}"), "hydra.run.dir=", said)
    left = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*"))
    assert left == ["file", "thesis", "thesis/chapter.tex"]


def test_a_full_disk(dtb, tmp_path, monkeypatch):
    def full(table, path, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("pyarrow.parquet.write_table", full)
    check(dtb("run", "duration_s=2", "figures=false"), "hydra.run.dir=", "the disk is full", 1)
    words = ("run", "duration_s=2", "figures=false", "recording.save=x.parquet")
    check(dtb(*words), "hydra.run.dir=", "the disk is full", 1)
    assert list(tmp_path.iterdir()) == []


def test_a_recording_that_cannot_be_written_leaves_no_run_either(dtb, tmp_path, monkeypatch):
    import pandas as pd

    original = pd.DataFrame.to_csv

    def full(self, path, **options):
        if "partial" in str(path) and "x" in path.name[:3]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(self, path, **options)

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    words = ("run", "duration_s=2", "figures=false", "recording.save=x.csv")
    check(dtb(*words), "recording.save=x.csv", "disk is full", 1)
    assert list(tmp_path.iterdir()) == []


def _small_files():
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)


def test_the_system_refusing_to_write_for_real(tmp_path):
    """A limit on the size of files stands in for a full disk: the write itself fails, in whatever library."""
    command = [sys.executable, "-m", "dtbacklash.cli", "run", "controller=imc", "duration_s=100", "figures=false"]
    told = {"cwd": tmp_path, "capture_output": True, "text": True, "check": False, "timeout": 300}
    answer = subprocess.run(command, preexec_fn=_small_files, **told)  # noqa: PLW1510 - check is among them
    assert answer.returncode == 1, answer.stderr
    (said,) = without_progress(answer.stderr).splitlines()
    assert said.startswith("dtb: error: hydra.run.dir=")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("interruptible")
@pytest.mark.check
def test_ctrl_c_is_one_line_and_leaves_nothing(tmp_path):
    words = ["run", "duration_s=3000", "figures=false"]
    process = subprocess.Popen(
        [sys.executable, "-m", "dtbacklash.cli", *words], cwd=tmp_path, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("outputs/*/.*.partial")) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert (out, without_progress(err)) == ("", "dtb: interrupted\n")
    assert list(tmp_path.iterdir()) == []
