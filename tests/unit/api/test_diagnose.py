"""A diagnosis in Python, that of the page's examples; the search itself is tested elsewhere."""

import contextlib
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import pandas as pd
import pytest
from matplotlib.figure import Figure
from told import refused

import dtbacklash as dtb
from dtbacklash.api.diagnose import Found

pytestmark = pytest.mark.check

PAGE = Path(__file__).resolve().parents[3] / "docs" / "python.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
MOTION = ("controller=open_loop", "reference=multisine", "reference.rms_v=2", "reference.f_max_hz=10",
          "profile=constant", "profile.start_deg=0", "sensors=encoder", "duration_s=15")  # fmt: skip


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Every example of the page on Python, in its order, as a reader would type them: (names, printed, folder)."""
    folder, printed, told = tmp_path_factory.mktemp("examples"), io.StringIO(), []
    before = dict(mpl.rcParams)
    plain, watched = "dtb.diagnose(recording, rig)", "dtb.diagnose(recording, rig, progress=tell)"
    names = {"tell": lambda share, what: told.append((share, what))}
    assert len(BLOCKS) >= 7
    assert sum(plain in block for block in BLOCKS) == 1
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        for number, block in enumerate(BLOCKS):
            code = block.replace(plain, watched)
            exec(compile(code, f"{PAGE.name}, example {number + 1}", "exec"), names)
    assert dict(mpl.rcParams) == before
    assert all(0.0 <= share <= 1.0 and isinstance(what, str) for share, what in told)
    assert len({what for _, what in told}) > 1
    return names, printed.getvalue(), folder


@pytest.fixture
def found(examples):
    return examples[0]["found"]


def test_the_examples_run(examples):
    names, printed, folder = examples
    for said in ("Moves of the reference", "controller.internal_model=inner_loop takes it out.", "missing_physics"):
        assert said in printed
    written = {"summary.json", "metrics.csv", "estimates.csv", "trace.parquet", "report.html", "figures"}
    assert {path.name for path in (folder / "my_run").iterdir()} == written
    found = {path.name for path in (folder / "found").iterdir()}
    assert found == {"diagnosis.json", "rig.yaml", "report.html", "figures"}
    assert not names["drifting"].summary["settles"]
    assert names["again"].summary["settles"]


def test_tables(found):
    assert found.verdict == "missing_physics"
    row = found.findings.iloc[0]
    assert (row.location, row.effect, row.parameter, row.unit) == ("motor_bearing", "coulomb_friction", "torque", "N m")
    assert row.low < 0.02 < row.high
    assert list(found.fit.index) == ["nominal", "recalibrated", "extended", "noise_floor"]
    assert found.fit.loc["extended", "held_out"] < 0.1 * found.fit.loc["nominal", "held_out"]
    assert isinstance(found.recalibrated, pd.DataFrame)
    assert found.candidates.iloc[0].tolist()[:2] == ["motor_bearing", "coulomb_friction"]
    assert "0.02 N m" in found.summary


def test_how_sure_a_finding_is_stands_in_its_rows(found):
    # a delay of 24 us may stand beside it, never sure: what an encoder's counts and two integrators leave (KNOWN_GAPS)
    first, *others = found.findings.confidence.tolist()
    assert first == "sure"
    assert set(others) <= {"partial"}
    partial = tuple(replace(f, confidence="partial") for f in found.diagnosis.findings)
    assert set(Found(replace(found.diagnosis, findings=partial)).findings.confidence) == {"partial"}


def test_as_much_is_held_out_as_from_the_command_line(found):
    # what `dtb diagnose --help` says of `validation`
    said = "80 % of it are fitted to, and the last 20 % judge."
    assert any(note.endswith(said) for note in found.diagnosis.notes)


def test_the_rig_can_be_run_and_saved(found, tmp_path):
    assert found.rig.effect("motor_bearing", "coulomb_friction")["torque"] == pytest.approx(0.02, rel=0.02)
    result = dtb.run("controller.internal_model=inner_loop", "duration_s=2", rig=found.rig)
    assert result.rig.effects == found.rig.effects
    assert dtb.load_rig(dtb.save_rig(found.rig, tmp_path / "rig.yaml")).effects == found.rig.effects


def test_figures_files_and_text(found, tmp_path):
    for what in ("rig", "q3", "motor_bearing"):
        assert isinstance(found.plot(what), Figure)
    with pytest.raises(dtb.UserError, match="plot=nope: choose one of rig, "):
        found.plot("nope")
    folder = found.save(tmp_path / "found")
    assert {path.name for path in folder.iterdir()} == {"diagnosis.json", "rig.yaml", "report.html", "figures"}
    assert json.loads((folder / "diagnosis.json").read_text())["verdict"] == "missing_physics"
    assert "Coulomb friction" in str(found)
    assert repr(found).startswith("<Found: missing_physics, coulomb_friction at motor_bearing")


def test_mistakes(found):
    recording = dtb.run("controller=open_loop", "duration_s=1").recording
    for given, rig, more, said in (
        (recording, "lead_screw", {"held_out": 1.5}, "held_out=1.5"), ("nope.csv", None, {}, "no such file"),
        (recording, "lead_screw", {"held_out": 0.0005}, "held_out=0.0005: leaves 1 samples to judge on, and at least"),
        (recording, "nope", {}, "choose one of"),
    ):  # fmt: skip
        with refused(said):
            dtb.diagnose(given, rig, **more)


def test_what_judges_is_recorded_as_what_is_fitted_to(found):
    recording = dtb.run(*MOTION, "seed=1").recording
    other = dtb.run(*MOTION, "seed=2").recording
    channels = {name: values for name, values in other.channels.items() if name != "q3"}
    lacking, slower = replace(other, channels=channels), replace(other, sample_time_s=2e-3)
    for spoilt, said in ((lacking, "lacks the recording's channel q3"), (slower, "must have .* sample time 0.001 s")):
        with pytest.raises(dtb.UserError, match=said) as caught:
            dtb.diagnose(recording, "lead_screw", spoilt)
        assert caught.value.key == "validation"
