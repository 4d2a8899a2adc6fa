"""`dtb export fmu`: the file passes FMPy's checks and moves as `dtb run`; every mistake is one line."""

import json
import subprocess
import sys

import pytest

from dtbacklash import cli

pytest.importorskip("fmpy")

from fmpy.validation import validate_fmu
from told import refusal

from dtbacklash.config.groups import packaged_options

pytestmark = pytest.mark.check

#: in a process of its own, as an importer is: feeds the voltage and the gap of a trace, prints the largest differences
IMPORTER = """
import json, sys
import numpy as np
import pandas as pd
from fmpy import simulate_fmu

fmu, file = sys.argv[1:]
trace = pd.read_parquet(file)
gap = np.append(trace.gap_deg[1:], trace.gap_deg.iloc[-1])
given = np.rec.fromarrays([trace.t_s, trace.u_v, gap], names="time,u_v,gap_deg")
found = simulate_fmu(fmu, stop_time=trace.t_s.iloc[-1], step_size=1e-3, output_interval=1e-3, input=given)
names = ("q3_mm", "theta_m_rad", "theta_d_rad")
print(json.dumps({n: [float(np.abs(found[n] - trace[n]).max()), float(np.abs(trace[n]).max())] for n in names}))
"""
FRICTION = "rig.effects.motor_bearing.coulomb_friction.torque=0.02"
RUN = (
    "controller=nimc_fixed", "controller.internal_model=inner_loop", "duration_s=20", "profile=ramp",
    "profile.t_start_s=2", "profile.t_end_s=18", "profile.end_deg=60", "figures=false", "out=run",
)  # fmt: skip


@pytest.mark.parametrize("fmi", [2, 3])
def test_it_moves_as_the_run_over_20_s_with_effects_and_a_growing_gap(process, tmp_path, fmi):
    assert process("run", *RUN, FRICTION).returncode == 0
    exported = process("export", "fmu", FRICTION, f"fmi={fmi}", "out=rig.fmu")
    assert exported.returncode == 0, exported.stderr
    assert exported.stdout.splitlines()[-1] == "rig.fmu"
    assert "effects.motor_bearing.coulomb_friction.torque" in exported.stdout
    assert validate_fmu(str(tmp_path / "rig.fmu")) == []
    command = [sys.executable, "-c", IMPORTER, tmp_path / "rig.fmu", tmp_path / "run" / "trace.parquet"]
    found = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert found.returncode == 0, found.stderr
    differences = json.loads(found.stdout)
    assert differences["q3_mm"][1] > 0.9
    assert all(difference == 0.0 for difference, _ in differences.values()), differences


@pytest.mark.parametrize("name", packaged_options("rig"))
def test_every_rig_can_be_exported_and_passes_the_checks(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["export", "fmu", f"rig={name}"]) == 0
    file = tmp_path / capsys.readouterr().out.splitlines()[-1]
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
    assert validate_fmu(str(file)) == []


WRONG = {
    "": ("argument=(missing)", "write dtb export fmu"),
    "foo": ("argument=foo", "write dtb export fmu"),
    "fmu rig=foo": ("rig=foo", "choose one of anticogging"),
    "fmu rig=foo.yaml": ("rig=foo.yaml", "no such file"),
    "fmu rig.parameters.m.value=-1": ("rig.parameters.m.value", "above 0 kg"),
    "fmu rig.effects.gear.wobble.size=1": ("rig.effects.gear.wobble", "takes backlash"),
    "fmu out=no/such/rig.fmu": ("out=no/such/rig.fmu", "must lie in a folder that exists"),
    "fmu out=rig.zip": ("out=rig.zip", "must end in .fmu"),
    "fmu out=.": ("out=.", "is a folder"),
    "fmu out=": ("out=", "give a value"),
    "fmu sample_time_s=0": ("sample_time_s", "must be positive"),
    "fmu fmi=1": ("fmi=1", "at least 2"),
    "fmu sample_tme_s=0.1": ("sample_tme_s=0.1", "did you mean sample_time_s?"),
    "fmu hydra.run.dir=x": ("hydra.run.dir=x", "no such setting"),
    "fmu -m": ("option=-m", "settings as key=value"),
}


@pytest.mark.parametrize("words", WRONG)
def test_wrong_input_is_one_line(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    key, allowed = WRONG[words]
    line = refusal(capsys, "export", *words.split())
    assert line.startswith(key)
    assert allowed in line
    assert list(tmp_path.iterdir()) == []


def test_without_a_compiler_it_is_said_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dtbacklash.core.build.compiler", list)
    assert "needs a C compiler: cc, or `pip install ziglang`" in refusal(capsys, "export", "fmu", "out=rig.fmu")
    assert list(tmp_path.iterdir()) == []


def test_the_help_names_settings_and_examples(capsys):
    assert cli.main(["export", "--help"]) == 0
    text = capsys.readouterr().out
    assert "usage: dtb export fmu" in text
    assert all(f"  {name}=" in text for name in ("out", "sample_time_s", "fmi", "substeps", "event_levels"))
    assert max(map(len, text.splitlines())) <= 120
