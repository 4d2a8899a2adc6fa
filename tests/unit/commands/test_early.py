"""What is wrong with a command line is told at once: before Hydra, pandas and matplotlib are loaded."""

import subprocess
import sys

import pytest

from dtbacklash.commands import early
from dtbacklash.config.grammar import GRAMMARS
from dtbacklash.errors import UserError

SCRIPT = """
import sys, time
from dtbacklash.cli import main
code = main(["diagnose", *sys.argv[1:]])
heavy = {"numpy", "hydra", "omegaconf", "pandas", "matplotlib"} & set(sys.modules)
print(code, sorted(heavy), time.process_time() < 1.0)
"""

WRONG = [
    (["recording=nowhere.csv"], "recording=nowhere.csv: no such file; give the path of a file or one of"),
    (["recording=lab.yaml"], "recording=lab.yaml: no such file: give the path of a mapping, or one of"),
    (["recording=[bench.csv,nowhere.csv]"], "recording=nowhere.csv: no such file"),
    (["recording=*.parquet"], "recording=*.parquet: no file has such a name"),
    (["recordin=bench.csv"], "recordin=bench.csv: no such setting; did you mean recording?"),
    (["recording=bench.csv", "serch=none"], "serch=none: no such setting; did you mean search?"),
    (["recording=bench.csv", "rig=nowhere"], "rig=nowhere: choose one of"),
    (["recording=mine.yaml"], "recording=mine.yaml: gone.csv is not here"),
    (["recording=mine.yaml:test"], "recording=mine.yaml:test: mine.yaml has no parts"),
]


WRONG_RUNS = [
    (["controller=nimc_twinn"], "controller=nimc_twinn: choose one of imc, "),
    (["twin.dealy_s=1"], "twin.dealy_s=1: no such setting; did you mean twin.delay_s?"),
    (["twin.delay_s=long"], "twin.delay_s=long: must be a number"),
    (["duration_s=-1"], "duration_s=-1.0: must be positive"),
    (["solver=rk4"], "solver=rk4: choose one of default, fine"),
]
RIGHT_RUNS = [
    ["controller=nimc_twin", "profile=step", "twin.delay_s=0", "duration_s=20 s"], ["twin.delay_s=${duration_s}"],
    ["reference.amplitude_v=2", "controller=open_loop"], ["rig.effects.motor_bearing.coulomb_friction.torque=0.02"],
    ["seed=null"], ["-m", "controller=imc,nimc_twin"], ["experiment=null"],
    ["model=emps", "model.parameters.k.value=3"], ["hydra.searchpath=[file:///tmp/x]", "controller=mine"],
    ["controller.compensate=[cogging]", "controller.compensate.0=constant_load"],
]  # fmt: skip


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DTB_RECORDINGS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "bench.csv").write_text("t,u\n")
    (tmp_path / "mine.yaml").write_text("files: [gone.csv]\nchannels: {u: u}\n")


@pytest.mark.parametrize(("words", "said"), WRONG)
def test_a_wrong_word_is_refused(words, said):
    with pytest.raises(UserError) as caught:
        early.check(GRAMMARS["diagnose"], words)
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize("words", [
    ["recording=bench.csv"], ["recording=bench.csv", "rig=emps", "out=x", "-v", "own.a=[k]", "hydra.verbose=true"],
    ["-m", "recording=a.csv,b.csv"], ["recording=nowhere.csv", "--cfg", "job"], ["recording='no, such'"],
    ["+recording=bench.csv"], ["recording=bench.csv", "rig=mine.yaml", "rig.parameters.k.value=3"],
])  # fmt: skip
def test_what_may_be_right_passes(words):
    early.check(GRAMMARS["diagnose"], words)


@pytest.mark.parametrize(("words", "said"), WRONG_RUNS)
def test_a_wrong_setting_of_a_run_is_refused(words, said):
    with pytest.raises(UserError) as caught:
        early.check(GRAMMARS["run"], words)
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize("words", RIGHT_RUNS)
def test_what_may_be_a_run_passes(words):
    early.check(GRAMMARS["run"], words)


@pytest.mark.parametrize("name", list(GRAMMARS))
def test_every_setting_passes_with_its_default(name):
    grammar = GRAMMARS[name]
    early.check(grammar, [f"{one.word}={one.shown()}" for one in grammar.settings.values() if not one.about.shown])


def test_a_run_loads_what_designs_a_controller_only_where_none_is_kept():
    code = "import sys, dtbacklash.experiment.run; print(sorted(set(sys.argv) & set(sys.modules)))"
    heavy = [f"scipy.{name}" for name in ("linalg", "optimize", "signal", "special", "stats")]
    done = subprocess.run([sys.executable, "-c", code, *heavy, "control", "matplotlib", "joblib"], capture_output=True,
                          text=True, check=True)  # fmt: skip
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("words", [WRONG[0][0], WRONG[1][0], WRONG[4][0], WRONG[6][0]])
def test_nothing_heavy_is_loaded_before(words):
    done = subprocess.run([sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "2 [] True"
