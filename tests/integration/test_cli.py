"""``dtb`` as a person meets it."""

import json
import os
import re
import resource
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from told import without_progress

import dtbacklash

RUN_FILES = {"summary.json", "metrics.csv", "estimates.csv", "trace.parquet", "report.html"}


def test_help_and_version_are_quick(process):
    answer = process("--help")  # the first call may have to compile bytecode
    assert answer.returncode == 0
    assert "run" in answer.stdout
    assert process("--version").stdout == f"dtb {dtbacklash.__version__}\n"
    assert process("run", "--help").stdout.startswith("usage: dtb run")
    # by turns, and processor time: neither is longer where others use the machine
    took = [(processor_s("-m", "dtbacklash.cli", "--help"), processor_s("-c", "import argparse")) for _ in range(5)]
    assert min(ours for ours, _ in took) < 5.0 * min(plain for _, plain in took)


def processor_s(*words):
    """Processor time of a call of Python [s]."""
    begin = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *words], capture_output=True, check=True)
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    return end.ru_utime + end.ru_stime - begin.ru_utime - begin.ru_stime


def test_help_does_not_load_the_libraries(dtb):
    code = "from dtbacklash import cli; cli.main(['run', '--help']); import sys; print(sorted(sys.modules))"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = answer.stdout.splitlines()[-1]
    for heavy in ("numpy", "hydra", "pandas", "omegaconf", "rich"):
        assert f"'{heavy}'" not in loaded


@pytest.mark.nightly
def test_a_second_run_loads_no_library_that_designs(tmp_path):
    code = (
        "import sys; from dtbacklash import cli; cli.main(['run', 'duration_s=2', 'figures=false', 'out=run']); "
        "print(sorted({'control', 'scipy.signal', 'scipy.stats', 'joblib'} & set(sys.modules)))"
    )
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    for expected in ("['control'", "[]"):
        command = [sys.executable, "-c", code]
        options = {"capture_output": True, "text": True, "check": True, "env": environment, "cwd": tmp_path}
        answer = subprocess.run(command, **options)  # noqa: PLW1510 - check is among the options
        assert answer.stdout.splitlines()[-1].startswith(expected)


def test_no_words_print_the_help(dtb):
    assert dtb()[0] == 0
    assert "usage: dtb" in dtb()[1]


def test_a_run_writes_its_folder_and_says_where(dtb, tmp_path):
    code, out, err = dtb("run", "controller=imc", "duration_s=50", "hydra.run.dir=there")
    assert (code, err) == (0, "")
    assert {path.name for path in (tmp_path / "there").iterdir()} == RUN_FILES | {"figures"}
    assert out.splitlines()[-1] == "there/report.html"
    assert "overshoot [%]" in out
    assert "\x1b" not in out
    summary = json.loads((tmp_path / "there" / "summary.json").read_text())
    assert summary["config"]["duration_s"] == 50.0
    assert summary["command"] == "dtb run controller=imc duration_s=50"
    assert len(pd.read_csv(tmp_path / "there" / "metrics.csv")) == 3
    assert len(pd.read_parquet(tmp_path / "there" / "trace.parquet")) == 50_001


def test_the_default_folder_has_date_time_and_controller(dtb, tmp_path):
    dtb("run", "controller=nimc_fixed", "duration_s=2", "figures=false")
    (folder,) = (tmp_path / "outputs").glob("*/*")
    found = str(folder.relative_to(tmp_path))
    assert re.fullmatch(r"outputs/\d{4}-\d\d-\d\d/\d\d-\d\d-\d\d_run_nimc_fixed", found)


def test_no_figures_on_demand(dtb, tmp_path):
    dtb("run", "duration_s=2", "figures=false", "hydra.run.dir=there")
    assert {path.name for path in (tmp_path / "there").iterdir()} == RUN_FILES


def test_an_effect_is_set_plainly(dtb, scenario):
    seen = []
    original = scenario.run_scenario
    scenario.run_scenario = lambda config, progress: seen.append(config) or original(config)
    effect = "rig.effects.motor_bearing.coulomb_friction.torque=0.02"
    assert dtb("run", effect, "sensors.noise.q3_mm=0.01", "duration_s=2", "figures=false")[0] == 0
    assert seen[0].rig.effects == {"motor_bearing": {"coulomb_friction": {"torque": 0.02}}}
    assert seen[0].sensors.noise == {"q3_mm": 0.01}


RIG = "name: mine\nparameters: {m: {value: 2.0, unit: kg}}\nelements: {gear: {kind: gear}}\n"


@pytest.mark.parametrize("where", ["mine.yaml", "./mine.yaml", "{}/mine.yaml", "sub/mine.yml"])
def test_a_rig_from_a_file_replaces_the_packaged_one(dtb, scenario, tmp_path, where):
    seen = []
    original = scenario.run_scenario
    scenario.run_scenario = lambda config, progress: seen.append(config) or original(config)
    (tmp_path / "sub").mkdir()
    for name in ("mine.yaml", "sub/mine.yml"):
        (tmp_path / name).write_text(RIG)
    code, _, err = dtb("run", f"rig={where.format(tmp_path)}", "duration_s=2", "figures=false")
    assert (code, err) == (0, "")
    assert seen[0].rig.name == "mine"
    assert list(seen[0].rig.parameters) == ["m"]


def test_a_users_conf_folder_extends_ours_and_wins(dtb, tmp_path):
    for group, text in {"profile": "kind: constant\nstart_deg: 12\nend_deg: 12\n", "controller": "name: imc\n"}.items():
        (tmp_path / "conf" / group).mkdir(parents=True)
        (tmp_path / "conf" / group / "mine.yaml").write_text(text)
    (tmp_path / "conf" / "twin").mkdir()
    (tmp_path / "conf" / "twin" / "cloud.yaml").write_text("delay_s: 1.25\n")
    assert dtb("run", "profile=mine", "duration_s=2", "figures=false", "hydra.run.dir=there")[0] == 0
    config = json.loads((tmp_path / "there" / "summary.json").read_text())["config"]
    assert config["profile"]["start_deg"] == 12.0
    assert config["twin"]["delay_s"] == 1.25


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_recording_is_written_beside(dtb, tmp_path, files, suffix):
    code, _, _ = dtb("run", "duration_s=2", "figures=false", f"recording.save=seen.{suffix}", "hydra.run.dir=there")
    assert code == 0
    read = pd.read_csv if suffix == "csv" else pd.read_parquet
    table = read(tmp_path / f"seen.{suffix}")
    assert list(table.columns[:5]) == ["t", "r", "u", "theta_m", "q3"]
    assert np.allclose(np.diff(table["t"]), 0.001)
    assert [name for name in files(tmp_path) if "/" not in name] == [f"seen.{suffix}"]
    before = (tmp_path / f"seen.{suffix}").read_bytes()
    code, _, err = dtb("run", "duration_s=3", "figures=false", f"recording.save=seen.{suffix}", "hydra.run.dir=again")
    assert code == 2
    assert f"recording.save=seen.{suffix}: is there already; give another name, or remove it first" in err
    assert (tmp_path / f"seen.{suffix}").read_bytes() == before


def test_a_run_into_its_own_folder_again_replaces_it(dtb, tmp_path, files):
    for seed in (1, 2):
        assert dtb("run", f"seed={seed}", "duration_s=2", "figures=false", "hydra.run.dir=there")[0] == 0
    assert json.loads((tmp_path / "there" / "summary.json").read_text())["seed"] == 2
    assert {name.split("/")[0] for name in files(tmp_path)} == {"there"}


def test_the_configuration_can_be_shown_without_running(dtb, tmp_path):
    code, out, _ = dtb("run", "--cfg", "job", "experiment=fig10")
    assert code == 0
    assert "gap_hat_deg: 50.0" in out
    assert list(tmp_path.iterdir()) == []


def test_a_bug_of_ours_shows_its_traceback(dtb, scenario, tmp_path):
    def broken(config, progress):
        raise ZeroDivisionError("ours")

    scenario.run_scenario = broken
    with pytest.raises(ZeroDivisionError, match="ours"):
        dtb("run")
    assert list(tmp_path.iterdir()) == []


def test_the_paper_command_passes_on_whether_the_claims_hold(dtb, tmp_path, monkeypatch):
    from types import SimpleNamespace

    for verdict, expected in ((True, 0), (False, 1)):

        def run_paper(folder, progress, verdict=verdict):
            (folder / "claims.csv").write_text("claim\n")
            return verdict

        module = SimpleNamespace(run_paper=run_paper)
        monkeypatch.setitem(sys.modules, "dtbacklash.paper", module)
        monkeypatch.setattr("dtbacklash.paper", module, raising=False)
        code, out, _ = dtb("paper", "out=here")
        assert (code, out) == (expected, "here/claims.csv\n")
        assert (tmp_path / "here" / "claims.csv").exists()
    assert dtb("paper", "--help")[0] == 0


def test_the_real_thing_from_an_empty_folder(process, tmp_path):
    answer = process("run", "controller=nimc_twin", "duration_s=50", "hydra.run.dir=there")
    assert answer.returncode == 0, answer.stderr
    assert without_progress(answer.stderr) == ""
    summary = json.loads((tmp_path / "there" / "summary.json").read_text())
    assert summary["controller"] == "nimc_twin"
    assert summary["n_estimations"] == len(summary["estimates"]) > 0
    assert {"simulate", "estimate", "total"} <= set(summary["wall_s"])
    assert list((tmp_path / "there" / "figures").glob("*.png"))
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
