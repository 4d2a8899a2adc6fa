"""The benchmark from outside: made by the command line, read with numpy and pandas alone, scored."""

import base64
import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest

from dtbacklash import cli
from dtbacklash.benchmark import plan
from dtbacklash.benchmark.conceal import conceal
from dtbacklash.benchmark.files import nominal, truth_of
from dtbacklash.benchmark.machines import EQUATIONS, mjcf
from dtbacklash.benchmark.make import write_case
from dtbacklash.benchmark.score import score_folder
from dtbacklash.physics.simulate import simulate

MAIN = "import sys; from dtbacklash import cli; sys.exit(cli.main(sys.argv[1:]))"
KEY = base64.urlsafe_b64encode(bytes(32))
#: of a machine: everything that reads a benchmark without this package may import
ALONE = """
import sys
class Only:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"dtbacklash", "yaml", "scipy", "cryptography", "omegaconf", "hydra", "pyarrow"}:
            raise ImportError(name)
sys.meta_path.insert(0, Only())
import json, pathlib
import numpy, pandas
bench, count = pathlib.Path(sys.argv[1]), 0
for file in sorted(bench.rglob("*")):
    if file.suffix == ".csv":
        assert len(pandas.read_csv(file).columns) > 1
    elif file.suffix in (".yaml", ".json"):
        assert json.loads(file.read_text(encoding="utf-8"))
    count += file.suffix in (".csv", ".yaml", ".json")
print(count)
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A small benchmark: one machine, one case of each kind, both splits; and the real ones."""
    folder = tmp_path_factory.mktemp("benchmark")
    (folder / "bench.key").write_bytes(KEY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "MACHINES", ("pendulum",))
        assert cli.main(["benchmark", "make", f"out={folder / 'bench'}", "seed=48613", "per_machine=6", "jobs=2"]) == 0
    return folder / "bench"


def concealed(bench):
    """(folder, plan) of each case that hides something or nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "MACHINES", ("pendulum",))
        return [(bench / "cases" / one.number, one) for one in plan.plan_cases(48613, 6, KEY)]


@pytest.mark.check
def test_the_same_seed_and_key_give_the_same_case_to_the_byte(bench):
    folder, one = concealed(bench)[2]
    again, rig = bench.with_name("again"), nominal("pendulum")
    write_case(again, one, rig, conceal(one, rig), KEY)
    assert {f.name: f.read_bytes() for f in again.iterdir()} == {f.name: f.read_bytes() for f in folder.iterdir()}


@pytest.mark.check
def test_each_kind_is_concealed_sealed_and_scored(bench, tmp_path):
    key = bench.with_name("bench.key")
    truths = [truth_of(folder, key) for folder, _ in concealed(bench)]
    assert {t.kind for t in truths} == set(plan.TURNS)
    assert all(bool(t.hidden) == (t.kind != "nothing") for t in truths)
    rows = [
        {"case": t.case, "place": h.place, "effect": h.effect, "size": h.size, "unit": h.unit} for t in truths
        for h in t.hidden
    ]  # fmt: skip
    pd.DataFrame(rows).to_csv(tmp_path / "answers.csv", index=False)
    (tmp_path / "cases.txt").write_text(" ".join(t.case for t in truths))
    for t in truths:
        pd.DataFrame(t.test).to_csv(tmp_path / f"{t.case}.csv", index=False)
    found = score_folder(tmp_path, bench, key, "all", "perfect")
    assert found.problems == []
    named, false, size = (found.figure(name) for name in ("named", "false_names", "size"))
    assert (named.right, false.right, size.right) == (named.of, 0, size.of)
    assert named.of == len(rows) >= 6
    assert size.of >= 4
    assert {found.figure("named", t.kind).value for t in truths if t.hidden} == {1.0}
    assert found.figure("prediction").value == 0.0


@pytest.mark.check
def test_no_public_file_tells_what_is_hidden(bench):
    everywhere = "".join(f.read_text(encoding="utf-8") for f in sorted(bench.rglob("*")) if f.is_file())
    assert not re.search(r"(?<![\d.])48613(?!\d)", everywhere)
    assert KEY.decode() not in everywhere
    for folder, one in concealed(bench):
        truth = truth_of(folder, bench.with_name("bench.key"))
        names = {f.name for f in folder.iterdir()}
        public = "".join((folder / name).read_text() for name in names - {"answer.json", "test_output.csv"})
        assert str(one.seed) not in everywhere
        assert {"answer.json", "test_output.csv"} & names == (
            {"answer.json", "test_output.csv"} if one.split == "development" else set()
        )
        assert not [h for h in truth.hidden if h.effect in public or (h.size and f"{h.size:.6g}" in public)]


@pytest.mark.check
def test_numpy_and_pandas_alone_read_every_file(bench):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", ALONE, str(bench)], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 30


@pytest.mark.check
def test_an_entry_made_by_hand_scores(bench, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cases = [json.loads((folder / "case.yaml").read_text()) for folder, _ in concealed(bench)]
    entry = tmp_path / "hand"
    entry.mkdir()
    (entry / "answers.csv").write_text("Case;Place;Effect;Certainty\n1;Disk;gravity;0,4\n2;Disk;nonsense;1\n")
    for case in cases[:2]:
        samples = len(pd.read_csv(bench / "cases" / case["case"] / "test_input.csv"))
        zeros = pd.DataFrame(np.zeros((samples, len(case["predict"]))), columns=case["predict"])
        zeros.to_csv(entry / f"{case['case']}.csv", index=False)
    words = ["benchmark", "score", str(entry), str(bench), "split=all"]
    assert cli.main(words) == 2  # the second case is sealed
    assert "the scored cases are sealed; give key=FILE" in capsys.readouterr().err
    assert cli.main([*words, f"key={bench.with_name('bench.key')}"]) == 0
    said = capsys.readouterr()
    assert said.err.splitlines() == [
        "dtb: answers.csv, line 3: 'nonsense' is not in the vocabulary; the row is left out"
    ]
    (score,) = tmp_path.glob("outputs/*/*_score_hand")
    figures = pd.read_csv(score / "score.csv").set_index(["name", "group"])
    assert figures.loc[("prediction", "all"), ["of", "value"]].tolist() == [6, np.inf]  # two of six predicted
    assert 1.0 < figures.loc[("prediction", "all"), "low"] < np.inf
    assert figures.loc[("nothing", "all"), "right"] == 1  # of the one that lacks nothing, nothing was said
    assert (score / "report.html").is_file()
    assert {path.name for path in tmp_path.iterdir()} == {"hand", "outputs"}


@pytest.mark.check
def test_a_recording_that_was_changed_is_refused(bench, tmp_path, capsys):
    import shutil

    other = tmp_path / "bench"
    shutil.copytree(bench, other)
    sealed = next(other.glob("cases/*/sealed.json")).parent
    with (sealed / "train.csv").open("a") as file:
        file.write("0,0,0,0,0\n")
    (tmp_path / "answers.csv").write_text("case,place,effect\n")
    key = bench.with_name("bench.key")
    assert cli.main(["benchmark", "score", str(tmp_path), str(other), f"key={key}", "out=score"]) == 2
    assert "is not the one that was sealed" in capsys.readouterr().err


@pytest.mark.check
def test_ctrl_c_ends_it_also_with_one_job(tmp_path):
    words = [sys.executable, "-c", MAIN, "benchmark", "make", "out=bench", "per_machine=2", "jobs=1"]
    made = subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True)
    begin = time.monotonic()
    while made.poll() is None and not list(tmp_path.glob("bench/cases/[0-9]*")) and time.monotonic() < begin + 60.0:
        time.sleep(0.1)
    time.sleep(2.0)  # within the simulations of the next case
    os.killpg(made.pid, signal.SIGINT)
    said = made.communicate(timeout=120)[1]
    assert made.returncode == 130
    assert "of 10 cases are done and stay; the same command does the rest" in said
    assert "Exception ignored" not in said


@pytest.mark.parametrize(("words", "said"), [
    (["what"], "choose one of make, score"), (["make", "size=3"], "no such setting"),
    (["make", "jobs=0"], "at least 1"),
    (["make", "out=b", "key=b/key"], "must not get the key"),
    (["score", "a"], "write dtb benchmark score ANSWERS BENCH"),
    (["score", "a", "b"], "holds no case"), (["score", "a", "b", "split=some"], "choose one of all"),
])  # fmt: skip
def test_a_mistake_is_one_line(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["benchmark", *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_published_plan_has_its_cases_of_each_kind():
    every = plan.plan_cases()
    assert len(every) == 120
    assert sum(one.split == "development" for one in every) == 30
    assert len({one.seed for one in every}) == 120
    assert min(one.seed for one in every) >= 970_000


@pytest.mark.parametrize("name", plan.MACHINES)
def test_the_words_of_a_machine_name_each_parameter_and_sensor(name):
    rig = nominal(name)
    assert all(f"{one}" in EQUATIONS[name] for one in (*rig.config.parameters, *rig.sensors))


@pytest.mark.parametrize("name", ["two_mass_stage", "pendulum", "oscillator"])
def test_mujoco_moves_a_machine_as_the_simulator_does(name):
    mujoco = pytest.importorskip("mujoco")
    rig = nominal(name)
    model = mujoco.MjModel.from_xml_string(mjcf(rig))
    data = mujoco.MjData(model)
    step_s, n = 1e-3, 1000
    u = np.sin(2.0 * np.pi * 1.5 * step_s * np.arange(n))
    expected = simulate(rig, u, step_s).sensors
    shown = np.zeros((n, len(rig.sensors)))
    for k in range(n):
        mujoco.mj_forward(model, data)
        shown[k] = data.sensordata
        data.ctrl[0] = u[k]
        for _ in range(round(step_s / model.opt.timestep)):
            mujoco.mj_step(model, data)
    for j, channel in enumerate(rig.sensors):
        size = float(np.std(expected[channel][:n]))
        assert np.max(np.abs(shown[:, j] - expected[channel][:n])) < 0.01 * size
