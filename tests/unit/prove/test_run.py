"""The course of a proof, with made-up recordings and stand-ins for the diagnosis and the oracle."""

from importlib.util import find_spec

import proved
import pytest
from proved import COULOMB
from told import refused

from dtbacklash import source_hash
from dtbacklash.campaign.backends import Workers
from dtbacklash.errors import UserError
from dtbacklash.files import read_json, write_json
from dtbacklash.prove import run, seal, work
from dtbacklash.prove.run import Plan
from dtbacklash.prove.score import score
from dtbacklash.prove.secret import Secret

ALONE, TWO = Workers(jobs=1), Workers(jobs=2)
N = 4


def silent(stage, done, total):
    pass


def diagnose(folder, rig_name):
    """Right for every case but the one that cannot be diagnosed."""
    with (folder / "asked").open("a") as file:
        file.write("x")
    if folder.name == "case2":
        raise RuntimeError("no luck\nat all")
    return proved.diagnosis(proved.finding(COULOMB)), {"parameters": {}, "effects": {}}


def oracle(folder, rig_name, secret, extended):
    assert secret["kind"] == "single"
    return proved.oracle(COULOMB, extended=1.0 if extended else None)


@pytest.fixture
def plan(tmp_path):
    """Four sealed cases of one effect, in a folder with its key."""
    folder = tmp_path / "concealed"
    key = seal.read_or_make_key(seal.key_path(folder))
    for j in range(N):
        case = folder / f"case{j}"
        case.mkdir(parents=True)
        (case / seal.RECORDING).write_bytes(b"a recording")
        write_json(case / seal.PUBLIC, {"rig": "lead_screw", "channels": ["theta_m", "q3"]})
        secret = Secret(**proved.secret("single", COULOMB, seed=10_000 + j))
        write_json(case / seal.SEALED, seal.seal(secret, b"a recording", key))
    return Plan(tmp_path / "out", folder=folder)


def asked(plan):
    return [len((case / "asked").read_text()) if (case / "asked").exists() else 0 for case in run.given_cases(plan)]


def course(plan, by=ALONE):
    cases = run.given_cases(plan)
    run.diagnose_missing(plan, cases, by, silent, diagnose)
    secrets = run.open_seals(plan, cases)
    run.ask_oracle(plan, cases, secrets, by, silent, oracle)
    return run.gather(plan, cases, secrets)


NO_DASK = pytest.mark.skipif(find_spec("distributed") is None, reason="the extra dask is not installed")
DASK = pytest.param(Workers("dask", 2), id="dask", marks=NO_DASK)


@pytest.mark.parametrize("by", [pytest.param(ALONE, id="here"), pytest.param(TWO, id="loky"), DASK])
@pytest.mark.check
def test_a_whole_course_with_a_case_that_fails(plan, by):
    cases = course(plan, by)
    found = score(cases)
    assert (found.cases, found.failed) == (N, 1)
    assert (found.figure("strict").right, found.figure("strict").of) == (3, 4)
    assert cases[2].error == "RuntimeError: no luck at all"
    assert "raise RuntimeError" in read_json(plan.target(plan.concealed / "case2"))["traceback"]


def test_what_is_done_is_not_done_again_and_a_missing_or_broken_file_is(plan):
    course(plan)
    cases, told = run.given_cases(plan), []
    run.diagnose_missing(plan, cases, ALONE, lambda *words: told.append(words), diagnose)
    assert (asked(plan), told) == ([1] * N, [("diagnosing", N, N)])
    plan.target(cases[0]).unlink()
    plan.target(cases[3]).write_text('{"id": "case3", "diag')
    run.diagnose_missing(plan, cases, ALONE, silent, diagnose)
    assert asked(plan) == [2, 1, 1, 2]
    seen = [work.AskOracle(plan.target(case), case, "", {}).done() for case in cases[:2]]
    assert seen == [False, True]


def test_other_code_diagnoses_again(plan, monkeypatch):
    course(plan)
    monkeypatch.setattr(work.source_hash, "digest", lambda parts: "other")
    run.diagnose_missing(plan, run.given_cases(plan), ALONE, silent, diagnose)
    assert asked(plan) == [2] * N


def test_the_seals_stay_shut_until_every_case_is_diagnosed(plan, monkeypatch):
    cases = run.given_cases(plan)
    opened = []
    monkeypatch.setattr(seal, "open_seal", lambda *words: opened.append(words))
    run.diagnose_missing(plan, cases[:3], ALONE, silent, diagnose)
    with pytest.raises(UserError, match="1 of 4 diagnoses are missing"):
        run.open_seals(plan, cases)
    assert opened == []


def test_what_a_worker_died_of_is_a_failed_diagnosis(plan):
    """That it comes to this is the engine's affair: tests/unit/campaign/test_engine.py."""
    case = run.given_cases(plan)[1]
    job = work.DiagnoseCase(plan.target(case), case, "lead_screw", diagnose)
    job.died(None)
    assert job.done()
    assert (read_json(job.record)["error"], read_json(job.record)["diagnosis"]) == ("its worker died", None)


def test_an_oracle_that_fails_leaves_its_reason(plan):
    cases = run.given_cases(plan)
    run.diagnose_missing(plan, cases, ALONE, silent, diagnose)
    secrets = run.open_seals(plan, cases)

    def broken(*_):
        raise ValueError("no fit")

    run.ask_oracle(plan, cases, secrets, ALONE, silent, broken)
    found = score(run.gather(plan, cases, secrets))
    strict = found.figure("strict")
    assert (found.oracle_failed, strict.of, strict.every_right) == (N, 1, 3)  # one was not diagnosed either


def test_what_does_not_belong_to_a_proof_is_refused(plan, tmp_path):
    for _ in range(2):
        run.claim(plan)
    for other, said in (
        (Plan(plan.out, "lead_screw", (10_000,)), "holds a proof of other recordings"),
        (Plan(tmp_path), "holds files that are no proof"), (Plan(plan.out / run.PLAN), "is a file"),
    ):  # fmt: skip
        with refused(said):
            run.claim(other)
    plan.key_file.unlink()
    for given, said in (
        (Plan(plan.out, folder=tmp_path / "nowhere"), "is no folder"),
        (Plan(plan.out, folder=tmp_path), "holds no concealed recording"),
        (plan, "without it the seals cannot be opened"),
    ):
        with refused(said):
            run.given_cases(given)


def test_a_case_that_names_no_rig_takes_the_chosen_one(plan):
    case = run.given_cases(plan)[0]
    assert work.rig_of(case, None) == "lead_screw"
    assert work.rig_of(case, "mine.yaml") == "mine.yaml"
    write_json(case / seal.PUBLIC, {})
    with pytest.raises(UserError, match="names no rig"):
        work.rig_of(case, None)


def test_one_score_holds_results_of_one_state_of_the_package(plan, monkeypatch):
    cases = run.given_cases(plan)
    digest = work.source_hash.digest

    def changing(folder, rig_name):
        monkeypatch.setattr(work.source_hash, "digest", digest)
        return diagnose(folder, rig_name)

    monkeypatch.setattr(work.source_hash, "digest", lambda parts: "before")
    with pytest.raises(UserError, match="the package changed while 1 cases were worked on"):
        run.diagnose_missing(plan, cases, ALONE, silent, changing)


def test_recordings_of_another_rig_are_other_recordings(tmp_path):
    """Of a rig from a file the content counts, of one that comes with the package its YAML."""
    file = tmp_path / "mine.yaml"
    file.write_text("name: mine\n")
    plan = run.Plan(tmp_path / "out", rigs=((str(file), 2),), seeds=(7000, 7001))
    run.claim(plan)
    run.claim(plan)
    file.write_text("name: mine\ndescription: heavier\n")
    with pytest.raises(UserError, match="holds a proof of other recordings"):
        run.claim(plan)
    assert source_hash.digest(("conf/rig",)) != source_hash.digest(("conf/no_such_folder",))
