"""Each adapter answers three cases of the benchmark, and its answers are read and scored without a complaint."""

import base64
import importlib
from types import SimpleNamespace

import pytest

from dtbacklash.benchmark import make, plan
from dtbacklash.benchmark.files import nominal
from dtbacklash.benchmark.score import Score, score_folder
from dtbacklash.campaign.backends import Workers
from dtbacklash.diagnosis.findings import ParameterEstimate
from studies import benchmark
from studies.baselines import diagnose
from studies.baselines.case import load, write


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """The cases of two machines and a third, with the folder of the benchmark."""
    folder = tmp_path_factory.mktemp("bench") / "bench"
    folder.with_name("key").write_bytes(base64.urlsafe_b64encode(bytes(32)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "MACHINES", ("pendulum", "oscillator", "rotary_drive"))
        make.make(folder, folder.with_name("key"), Workers("loky", 1), lambda *_: None, seed=60, per_machine=1)
    found = [load(one) for one in sorted((folder / "cases").iterdir())[:3]]
    assert None not in found
    return folder, found


@pytest.mark.check
@pytest.mark.parametrize("tool", benchmark.CHEAP)
def test_an_adapter_answers(tool, cases, tmp_path):
    folder, given = cases
    adapter = importlib.import_module(f"studies.baselines.{tool}")
    answers = {case.number: (case, adapter.answer(case)) for case in given}
    write(tmp_path / tool, answers)
    score = score_folder(tmp_path / tool, folder, folder.with_name("key"), "all", tool)
    assert score.problems == []
    assert score.cases == score.figure("prediction").of == 3
    assert score.figure("prediction").value >= 0.9  # no prediction is better than the true machine's


@pytest.mark.nightly
def test_the_diagnosis_answers(cases, tmp_path):
    folder, given = cases
    answers = benchmark.run("diagnose", given[:1])
    write(tmp_path / "diagnose", answers)
    score = score_folder(tmp_path / "diagnose", folder, folder.with_name("key"), "all", "diagnose")
    assert score.problems == []
    assert score.cases == score.figure("prediction").of == 1


def test_what_changed_has_its_size_after_the_change():
    after = ParameterEstimate(0.3, "N m", (0.2, 0.4))
    changed = [
        SimpleNamespace(title=title, confidence=confidence, after=after)
        for title, confidence in (("disk.gravity.torque", "sure"), ("J", "one_of"))
    ]
    case = SimpleNamespace(rig=nominal("pendulum"))
    size = {"size": 0.3, "unit": "N m", "low": 0.2, "high": 0.4}
    assert diagnose._changes(SimpleNamespace(changes=changed), case) == [
        {"place": "disk", "effect": "gravity", "certainty": diagnose.CERTAINTY["sure"], **size},
        {"place": "J", "effect": "wrong_parameter", "certainty": diagnose.CERTAINTY["one_of"], **size},
    ]


@pytest.mark.parametrize(("more", "kept"), [((), True), (("--first", "1"), False), (("--split", "all"), False)])
def test_only_answers_to_all_of_the_development_split_are_kept(tmp_path, monkeypatch, more, kept):
    case, tables = SimpleNamespace(said={"split": "development"}), []
    monkeypatch.setattr(benchmark, "ANSWERS", tmp_path / "kept")
    monkeypatch.setattr(benchmark, "case_folders", lambda bench: [bench])
    monkeypatch.setattr(benchmark, "load", lambda folder: case)
    monkeypatch.setattr(benchmark, "run", lambda tool, given: {})
    monkeypatch.setattr(benchmark, "score_folder", lambda *words: Score("nominal", 0))
    monkeypatch.setattr(benchmark, "text", lambda scores: tables.append(list(scores)))
    benchmark.main(["--tools", "nominal", "--out", str(tmp_path / "out"), *more])
    assert (tmp_path / "kept" / "nominal" / "answers.csv").exists() == kept
    benchmark.main(["--tools", "--out", str(tmp_path / "out"), *more])  # runs none, and scores what is there
    assert tables == [["nominal"], ["nominal"]]


def test_a_split_that_is_none_is_refused(capsys):
    with pytest.raises(SystemExit):
        benchmark.main(["--split", "open"])
    assert "invalid choice: 'open'" in capsys.readouterr().err
