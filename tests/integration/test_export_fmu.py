"""`dtb export fmu`: the file passes FMPy's checks and moves as `dtb run`; every mistake is one line."""

import json
import os
import shutil
import subprocess
import sys
import zipfile

import pytest

from dtbacklash import cli

pytest.importorskip("pythonfmu")
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

fmu, file, rounds = sys.argv[1], sys.argv[2], int(sys.argv[3])
trace = pd.read_parquet(file)
gap = np.append(trace.gap_deg[1:], trace.gap_deg.iloc[-1])
given = np.rec.fromarrays([trace.t_s, trace.u_v, gap], names="time,u_v,gap_deg")
for _ in range(rounds):
    found = simulate_fmu(fmu, stop_time=trace.t_s.iloc[-1], step_size=1e-3, output_interval=1e-3, input=given)
names = ("q3_mm", "theta_m_rad", "theta_d_rad")
print(json.dumps({n: [float(np.abs(found[n] - trace[n]).max()), float(np.abs(trace[n]).max())] for n in names}))
"""
FRICTION = "rig.effects.motor_bearing.coulomb_friction.torque=0.02"
RUN = (
    "controller=nimc_fixed", "controller.internal_model=inner_loop", "duration_s=20", "profile=ramp",
    "profile.t_start_s=2", "profile.t_end_s=18", "profile.end_deg=60", "figures=false", "out=run",
)  # fmt: skip


def importer(script, *arguments, **environment):
    command = [sys.executable, "-c", script, *map(str, arguments)]
    whole = os.environ | environment
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=whole)


def test_it_moves_as_the_run_over_20_s_with_effects_and_a_growing_gap(process, tmp_path):
    assert process("run", *RUN, FRICTION).returncode == 0
    exported = process("export", "fmu", FRICTION, "out=rig.fmu")
    assert exported.returncode == 0, exported.stderr
    assert exported.stdout.splitlines()[-1] == "rig.fmu"
    assert "effects.motor_bearing.coulomb_friction.torque" in exported.stdout
    assert validate_fmu(str(tmp_path / "rig.fmu")) == []
    # twice in one process: the library of pythonfmu once crashed there
    found = importer(IMPORTER, tmp_path / "rig.fmu", tmp_path / "run" / "trace.parquet", 2)
    assert found.returncode == 0, found.stderr
    differences = json.loads(found.stdout)
    assert differences["q3_mm"][1] > 0.9
    assert all(difference < 1e-9 for difference, _ in differences.values()), differences


@pytest.mark.parametrize("name", packaged_options("rig"))
def test_every_rig_can_be_exported_and_passes_the_checks(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    assert cli.main(["export", "fmu", f"rig={name}"]) == 0
    file = tmp_path / capsys.readouterr().out.splitlines()[-1]
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
    assert validate_fmu(str(file)) == []
    assert sys.path == before


SIMULATE = """
import sys
{before}
from fmpy import simulate_fmu
for said in ("first", "second"):
    try:
        simulate_fmu(sys.argv[1], stop_time=0.01, step_size=2e-3, output_interval=2e-3, {more})
        print(said, "ran")
    except Exception as error:
        print(said, error)
"""


MISTAKES = [
    ("", {"version": "0.0.9"}, "", "the FMU was exported by 0.0.9: pip install dtbacklash==0.0.9"),
    ("sys.modules['dtbacklash'] = None", {}, "", "this FMU needs the Python package dtbacklash"),
    ("", {"sample_time_s": 0.0015}, "", "must be a multiple of the sample time 0.0015 s"),
    ("", {}, "start_values={'parameters.J': -1.0}", "rig.parameters.J.value=-1.0: above 0"),
    ("", {}, "start_values={'u_v': float('nan')}", "u_v=nan: must be finite"),
]


def edited(edit):
    assert cli.main(["export", "fmu", "rig=disk"]) == 0
    with zipfile.ZipFile("disk.fmu") as whole, zipfile.ZipFile("other.fmu", "w") as other:
        for name in whole.namelist():
            content = whole.read(name)
            if name.endswith("rig.json"):
                content = json.dumps(json.loads(content) | edit).encode()
            other.writestr(name, content)
    return os.path.abspath("other.fmu")


#: C++'s delete that gives nothing back and leaves ones: who gives up a pointer once more, in memory that it has already
#: freed, finds a count of one there and calls into nowhere, each time and not only where the memory has a new owner
DELETE = """
#include <stddef.h>
void _ZdlPvm(void *block, size_t size)
{
    for (size_t i = 0; block && i < size / sizeof(int); i++) ((volatile int *)block)[i] = 1;
}
"""


@pytest.mark.parametrize(("before", "edit", "more", "said"), [*MISTAKES, ("", {}, "", "")])
def test_what_is_wrong_where_it_is_imported_is_said_and_leaves_the_process_alive(
    tmp_path, monkeypatch, before, edit, more, said
):
    """Nor is anything given up twice when the process ends, with a mistake or without."""
    monkeypatch.chdir(tmp_path)
    checked = {}
    if sys.platform == "linux" and shutil.which("cc"):
        (tmp_path / "delete.c").write_text(DELETE)
        subprocess.run(["cc", "-shared", "-fPIC", "-o", "delete.so", "delete.c"], check=True)
        checked["LD_PRELOAD"] = str(tmp_path / "delete.so")
    found = importer(SIMULATE.format(before=before, more=more), edited(edit), **checked)
    assert found.returncode == 0, found.stderr
    assert [line.split()[0] for line in found.stdout.splitlines()] == ["first", "second"]
    assert ("ran" in found.stdout) == (said == "")
    assert not said or found.stderr.count(said) == 2


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


def test_without_pythonfmu_the_extra_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert cli.main(["export", "fmu"]) == 2
    assert "pip install 'dtbacklash[fmu]'" in capsys.readouterr().err


def test_the_help_names_settings_and_examples(capsys):
    assert cli.main(["export", "--help"]) == 0
    text = capsys.readouterr().out
    assert "usage: dtb export fmu" in text
    assert all(f"  {name}=" in text for name in ("out", "sample_time_s", "substeps", "event_levels"))
    assert max(map(len, text.splitlines())) <= 120
