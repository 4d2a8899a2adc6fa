"""A run in Python: the same as on the command line."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from told import refused

import dtbacklash as dtb
from dtbacklash import cli
from dtbacklash.api import run_files
from dtbacklash.config.run import RunConfig

WORDS = ("controller=nimc_twin", "sensors=encoder", "duration_s=45")


@pytest.fixture(scope="module")
def result():
    return dtb.run(*WORDS)


@pytest.mark.check
def test_the_command_line_computes_and_writes_the_same(result, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["run", *WORDS, "recording.save=seen.csv", "hydra.run.dir=by_command"]) == 0
    assert result.save("by_python") == result.save(tmp_path / "by_python").relative_to(tmp_path)
    for name in ("metrics.csv", "trace.parquet"):
        assert (tmp_path / "by_python" / name).read_bytes() == (tmp_path / "by_command" / name).read_bytes()
    names = [sorted(str(p.relative_to(tmp_path / here)) for p in (tmp_path / here).rglob("*")) for here in
             ("by_command", "by_python")]  # fmt: skip
    assert names[0] == names[1]
    summaries = [json.loads((tmp_path / here / "summary.json").read_text()) for here in ("by_command", "by_python")]
    assert list(summaries[0]) == list(summaries[1])
    assert summaries[1]["command"] == "dtb run controller=nimc_twin sensors=encoder duration_s=45"
    read = dtb.read_recording("seen.csv", rig="lead_screw")
    for name, values in result.recording.channels.items():
        assert np.allclose(read.channels[name], values, rtol=1e-12, atol=0.0)
        assert read.units[name] == result.recording.units[name]


def test_it_prints_what_the_command_line_prints(result, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["run", *WORDS, "figures=false"]) == 0
    told = [line for line in capsys.readouterr().out.splitlines() if line and "report.html" not in line]
    printed = [line for line in str(result).splitlines() if line]
    assert printed[:-1] == told[:-1]
    assert printed[-1].partition("simulated")[0] == told[-1].partition("simulated")[0]
    assert repr(result) == "<Run: nimc_twin on lead_screw, 45001 samples, 3 moves>"


def test_a_recording_that_is_asked_for_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = dtb.run("controller=imc", "duration_s=6", "recording.save=x.csv")
    assert len(pd.read_csv("x.csv")) == len(run.trace)
    assert [path.name for path in tmp_path.iterdir()] == ["x.csv"]


def test_a_machine_that_runs_away_in_open_loop_is_no_result():
    with pytest.raises(dtb.Diverged, match=r"above 1000 times solver.divergence_mm=1000 mm.*the machine runs away"):
        dtb.run("controller=open_loop", "profile=constant", "rig.parameters.k.value=1e20", "duration_s=6")


def test_tables_figures_and_recording(result):
    assert isinstance(result.trace, pd.DataFrame)
    assert isinstance(result.plot(), Figure)
    recording = result.recording
    assert recording.samples == len(result.trace) == 45_001
    assert recording.sample_time_s == 1e-3
    assert recording.units["q3"] == "m"
    assert np.shares_memory(recording.channels["q3"], result.data.seen["q3"])


def test_progress_is_silent_unless_asked_for(capsys):
    told = []
    dtb.run("controller=imc", "duration_s=6")
    assert capsys.readouterr() == ("", "")
    dtb.run("controller=imc", "duration_s=6", progress=lambda share, what: told.append((share, what)))
    assert told[0] == (0.0, "simulating")
    assert told[-1] == (1.0, "simulating")
    assert capsys.readouterr() == ("", "")


def test_advice_is_printed():
    words = ("experiment=fig8", "rig.effects.motor_bearing.coulomb_friction.torque=0.05", "duration_s=25")
    printed = " ".join(str(dtb.run(*words)).split())
    assert "not every move settles" in printed
    assert "controller.internal_model=inner_loop takes it out" in printed


def test_mistakes_are_one_line_and_name_the_key(tmp_path):
    with refused("did you mean twin.delay_s"):
        dtb.run("twin.delay=3")
    for model in ("nobody.yaml", 3):
        with refused(key="model"):
            dtb.run(model=model)
    with pytest.raises(dtb.Diverged, match="leaves a margin"):
        dtb.run("controller=imc", "controller.k_theta_v_per_rad=400", "duration_s=5")
    (tmp_path / "other.txt").write_text("mine")
    with refused("holds files that are not an earlier run"):
        dtb.run("controller=imc", "duration_s=1", "figures=false").save(tmp_path)


def test_the_command_that_repeats_a_run(tmp_path):
    rig = dtb.load_rig("lead_screw")
    assert dtb.run("duration_s=2", rig="lead_screw").summary["command"] == "dtb run rig=lead_screw duration_s=2"
    assert dtb.run("duration_s=2", rig=rig).summary["command"] is None
    found = run_files.provenance(RunConfig(seed=5))
    assert (found["seed"], found["config"]["controller"]["k_theta_v_per_rad"]) == (5, 15.0)
    assert {"python", "dtbacklash", "numpy", "control"} <= set(found["versions"])
    assert str(Path.cwd()) not in json.dumps(found)


@pytest.mark.check
def test_what_is_believed_is_given_as_a_rig_a_name_or_a_file(tmp_path):
    words = ("duration_s=2", "twin.buffer=200", "twin.settle=100")
    softer = dtb.load_rig("lead_screw").with_parameters({"k": 9000.0})
    dtb.save_rig(softer, tmp_path / "softer.yaml")
    runs = [dtb.run(*words, model=model) for model in (softer, tmp_path / "softer.yaml", "lead_screw", None)]
    outputs = [run.trace["q3_mm"].to_numpy() for run in runs]
    assert np.array_equal(outputs[0], outputs[1])
    assert np.array_equal(outputs[2], outputs[3])
    assert not np.array_equal(outputs[0], outputs[2])
    assert runs[0].rig.config.parameters["k"].value == 1e4
