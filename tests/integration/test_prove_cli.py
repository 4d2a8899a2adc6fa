"""``dtb prove`` from the command line: two short concealed recordings end to end, resumption, one-line errors."""

import json
import shutil
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pandas as pd
import proved
import pytest
from nominal import nominal_rig
from told import one_line

from dtbacklash.errors import UserError
from dtbacklash.prove import conceal, seal
from dtbacklash.prove.draw import draw, draw_kind
from dtbacklash.prove.quick import quick_seeds
from dtbacklash.prove.score import Score
from dtbacklash.report.proof.page import BEGIN, END

pytestmark = pytest.mark.check

LEAD_SCREW = nominal_rig("lead_screw")
FILES = [
    "confusion.csv", "figures/confusion.png", "figures/errors.png", "figures/shares.png", "figures/visibility.png",
    "plan.json", "report.html", "score.csv", "score.json", "table.md",
]  # fmt: skip


@pytest.fixture(scope="module")
def concealed(tmp_path_factory):
    """Two sealed recordings of six seconds: nothing, and backlash."""
    folder = tmp_path_factory.mktemp("given") / "bench"
    key = seal.read_or_make_key(seal.key_path(folder))
    for name, kind, effect in (("a1", "nothing", None), ("b2", "single", "gear.backlash")):
        secret = draw(3, LEAD_SCREW, kind, effect, "minimal")
        conceal.write_case(folder / name, replace(secret, duration_s=6.0), LEAD_SCREW, key)
    return folder


@pytest.fixture
def dtb(typed, tmp_path, monkeypatch, concealed):
    """Run ``dtb prove`` in an empty folder beside a copy of the recordings: words -> (exit code, stdout, stderr)."""
    shutil.copytree(concealed, tmp_path / "bench")
    shutil.copy(seal.key_path(concealed), tmp_path / "bench.key")
    return partial(typed, "prove")


@pytest.fixture
def short(monkeypatch):
    """Recordings of 3 s."""
    monkeypatch.setattr("dtbacklash.prove.draw.DURATION_S", (3, 3))


@pytest.fixture
def pretended(monkeypatch, undrawn):
    """A diagnosis that names backlash in every recording, and counts how often it is asked; an oracle that sees all."""
    asked = []

    def pretend(recording, rig):
        asked.append(recording.source.parent.name)
        found = proved.diagnosis(proved.finding(proved.BACKLASH))
        extended = rig.with_effect(*proved.BACKLASH, proved.VALUES[proved.BACKLASH])
        return SimpleNamespace(to_json=lambda: found, extended=extended)

    def look(folder, rig_name, secret, extended):
        return proved.oracle(*((hidden["location"], hidden["effect"]) for hidden in secret["effects"]))

    monkeypatch.setattr("dtbacklash.diagnosis.diagnose", pretend)
    monkeypatch.setattr("dtbacklash.prove.work.oracle_folder", look)
    return asked


@pytest.mark.nightly
def test_two_recordings_end_to_end(dtb, tmp_path):
    """CI runs the quick proof instead."""
    code, out, err = dtb("folder=bench", "out=proof", "jobs=1")
    assert code == 0, err
    document = json.loads((tmp_path / "proof" / "score.json").read_text())
    assert (document["cases"], document["failed"], document["oracle_failed"]) == (2, 0, 0)
    assert document["clear"]["single"] == 1
    assert document["notes"]["command"] == "dtb prove folder=bench"
    assert "exactly the hidden" in out
    assert out.rstrip().endswith("proof/report.html")
    assert "asking the oracle: 2 of 2" in err


def test_started_again_it_only_scores(dtb, pretended, tmp_path, files):
    assert dtb("folder=bench", "out=proof", "jobs=1")[0] == 0
    assert [name for name in files(tmp_path / "proof") if not name.startswith("cases")] == FILES
    assert sorted(pretended) == ["a1", "b2"]
    first = (tmp_path / "proof" / "score.json").read_bytes()
    (tmp_path / "proof" / "cases" / "b2.json").unlink()
    assert dtb("folder=bench", "out=proof", "jobs=1")[0] == 0
    assert sorted(pretended) == ["a1", "b2", "b2"]
    found = json.loads((tmp_path / "proof" / "score.json").read_text())
    assert found["figures"] == json.loads(first)["figures"]
    strict = next(f for f in found["figures"] if f["name"] == "strict")
    silent = next(f for f in found["figures"] if f["name"] == "nothing_found")
    assert (strict["right"], strict["of"], silent["right"], silent["of"]) == (1, 1, 0, 1)


@pytest.mark.usefixtures("short")
def test_a_proof_in_parts_is_the_proof_in_one(dtb, pretended, tmp_path):
    """What a former proof brought into the docs is not done again, and counts."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "proof.md").write_text(f"{BEGIN}\n{END}\n")
    assert dtb("n=1", "seed=7", "out=first", "jobs=1", "docs=docs")[0] == 0
    assert len(pretended) == 1
    assert "| exactly the hidden effects, at their places |" in (tmp_path / "docs" / "proof.md").read_text()
    assert dtb("n=2", "seed=7", "out=second", "jobs=1", "known=docs/proof/cases.json.gz")[0] == 0
    assert len(pretended) == 2
    assert dtb("n=2", "seed=7", "out=whole", "jobs=1")[0] == 0
    assert len(pretended) == 4
    parts, whole = (pd.read_csv(tmp_path / name / "score.csv") for name in ("second", "whole"))
    drop = ["id", "wall_s", "cpu_s"]
    pd.testing.assert_frame_equal(parts.drop(columns=drop), whole.drop(columns=drop))


@pytest.mark.usefixtures("short")
def test_the_quick_proof_fails_when_the_score_drops(dtb, pretended, tmp_path, monkeypatch):
    chosen = tuple(seed for seed in quick_seeds(LEAD_SCREW, 20) if draw_kind(seed, LEAD_SCREW) == "nothing")
    monkeypatch.setattr("dtbacklash.prove.quick.quick_seeds", lambda rig, n: chosen)
    monkeypatch.setattr("dtbacklash.prove.quick.reached", lambda rig, n: {"nothing_found": [2, 3], "strict": [0, 0]})
    code, _, err = dtb("--quick", "out=proof", "jobs=1")
    assert code == 1
    assert "dtb: dropped: nothing found where nothing is: 0/3, reached were 2/3" in err
    assert "nothing_found: [0, 3]" in (tmp_path / "proof" / "reached.yaml").read_text()
    for before, said in (({"nothing_found": [0, 3]}, False), ({}, True)):
        monkeypatch.setattr("dtbacklash.prove.quick.reached", lambda rig, n, before=before: before)
        code, _, err = dtb("--quick", "out=proof", "jobs=1")
        assert code == 0
        assert ("no score of rig=lead_screw was stored before" in err) == said
    assert len(pretended) == 3


def test_a_seal_that_is_none_is_found_before_anything_is_diagnosed(dtb, tmp_path, pretended):
    (tmp_path / "bench" / "b2" / "sealed.json").write_text("{}")
    assert "sealed.json is no seal" in one_line(dtb("folder=bench", "out=proof"))
    assert pretended == []
    assert not (tmp_path / "proof").exists()


def test_a_cluster_that_does_not_answer_leaves_no_folder(dtb, tmp_path, monkeypatch):
    def refuse(*_):
        raise UserError("scheduler", "tcp://a:1", "no Dask scheduler answers there")

    monkeypatch.setattr("dtbacklash.campaign.backends.Workers.do", refuse)
    code, _, err = dtb("folder=bench", "out=proof")
    assert code == 2
    assert err.splitlines()[-1] == "dtb: error: scheduler=tcp://a:1: no Dask scheduler answers there"
    assert not (tmp_path / "proof").exists()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["n=0"], "n=0: must be at least 1 and at most 100000"),
        (["n=1" + 5000 * "0"], "n=1000"),
        (["n=many"], "n=many: must be a whole number"),
        (["seed=-1"], "seed=-1: must be at least 0"),
        (["jobs=0"], "jobs=0: must be at least 1 and at most 256"),
        (["rig=nosuch"], "rig=nosuch: choose one of"),
        (["rigs=[emps]", "rig=emps"], "rigs=emps: does not go with rig"),
        (["rigs=[emps,nosuch]"], "rig=nosuch: choose one of"),
        (["rigs=[emps:0]"], "rigs=emps:0: write NAME or NAME:COUNT"),
        (["rigs=[emps:2,emps]"], "rigs=emps: names a rig twice"),
        (["rigs=[emps]", "folder=bench"], "rigs="),
        (["scheduler=tcp://a:1"], "scheduler=tcp://a:1: belongs to backend=dask"),
        (["folder=nowhere"], "folder="),
        (["folder=bench", "rig=nosuch"], "rig=nosuch: choose one of"),
        (["folder=bench", "key=bench/a1/public.json"], "key="),
        (["folder=bench", "n=3"], "n=3: does not go with folder"),
        (["folder=bench", "key=nowhere.key"], "key="),
        (["key=bench.key"], "key=bench.key: belongs to folder=FOLDER"),
        (["--quick", "n=3"], "n=3: does not go with --quick"),
        (["docs=nowhere"], "docs="),
        (["n=2", "n=3"], "n=3: is given twice; the first is 2"),
        (["n="], "n=: must be a whole number"),
        (["colour=red"], "colour=red: no such setting; choose one of backend, docs, folder, jobs, key, known"),
        (["known=nowhere", "n=1"], "known="),
        (["known=bench", "folder=bench"], "known=bench: does not go with folder"),
        (["--slow"], "option=--slow: choose one of --cfg"),
        (["fast"], "argument=fast: write key=value"),
        (["out=bench", "n=1"], "out="),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(dtb, tmp_path, words, line):
    assert one_line(dtb(*words)).startswith(line)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bench", "bench.key"]


def test_a_wrong_key_opens_nothing(dtb, pretended, tmp_path):
    (tmp_path / "bench.key").unlink()
    seal.read_or_make_key(tmp_path / "bench.key")
    code, _, err = dtb("folder=bench", "out=proof", "jobs=1")
    assert code == 2
    assert "dtb: error: key=" in err.splitlines()[-1]
    assert not (tmp_path / "proof" / "score.json").exists()


def test_ctrl_c_is_one_line_and_the_same_command_goes_on(dtb, monkeypatch, pretended, tmp_path):
    answers = iter([KeyboardInterrupt])

    def interrupted(folder, rig_name, secret, extended):
        for answer in answers:
            raise answer
        return proved.oracle(proved.BACKLASH)

    monkeypatch.setattr("dtbacklash.prove.work.oracle_folder", interrupted)
    code, _, err = dtb("folder=bench", "out=proof", "jobs=1")
    assert code == 130
    assert err.splitlines()[-1] == ("dtb: interrupted: 0 of 2 cases are done and stay; the same command does the rest")
    assert dtb("folder=bench", "out=proof", "jobs=1")[0] == 0
    assert len(pretended) == 2


def test_several_rigs_end_in_one_table(dtb, monkeypatch, tmp_path):
    monkeypatch.setattr("dtbacklash.prove.draw.DURATION_S", (2, 2))
    found = SimpleNamespace(to_json=proved.diagnosis)
    monkeypatch.setattr(
        "dtbacklash.diagnosis.diagnose", lambda recording, rig: SimpleNamespace(**vars(found), extended=rig)
    )
    monkeypatch.setattr("dtbacklash.prove.work.oracle_folder", lambda *_: proved.oracle())
    code, _, err = dtb("rigs=[oscillator:2,pendulum]", "n=1", "seed=3", "out=proof", "jobs=1")
    assert code == 0, err
    rows = pd.read_csv(tmp_path / "proof" / "score.csv")
    assert list(zip(rows["rig"], rows["seed"], strict=True)) == [("oscillator", 3), ("oscillator", 4), ("pendulum", 3)]
    document = json.loads((tmp_path / "proof" / "score.json").read_text())
    assert document["notes"]["command"] == "dtb prove 'rigs=[oscillator:2,pendulum:1]' seed=3"
    assert list(document["rigs"]) == ["oscillator", "pendulum"]
    for j, figure in enumerate(document["figures"]):
        assert figure["of"] == sum(figures[j]["of"] for figures in document["rigs"].values())
    table = (tmp_path / "proof" / "table.md").read_text()
    assert "| count of each rig, **bold** below its bar | oscillator | pendulum |" in table
    assert "| oscillator |" in table
    assert Score.from_json(document).to_json() == Score.from_json(json.loads(json.dumps(document))).to_json()
