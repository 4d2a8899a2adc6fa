"""What a benchmark's folder tells, and when it is refused to go on with it."""

import base64
import hashlib
import json

import pytest

from dtbacklash.benchmark import files, make, plan, real
from dtbacklash.campaign.backends import Workers
from dtbacklash.errors import UserError
from dtbacklash.prove import seal

KEYS = tuple(base64.urlsafe_b64encode(bytes([k]) * 32) for k in range(2))


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Makes a benchmark of no concealed case; returns its folder and key."""
    monkeypatch.setattr(plan, "MACHINES", ())
    monkeypatch.setattr(make, "MACHINES", ())
    monkeypatch.setattr(real, "RECORDINGS", ())
    out, key = tmp_path / "bench", tmp_path / "bench.key"
    key.write_bytes(KEYS[0])

    def write(seed=40, per_machine=1):
        make.make(out, key, Workers("loky", 1), lambda *_: None, seed, per_machine)
        return out, key

    return write


def test_the_published_plan_stays_as_it_is():
    every = [tuple(vars(one).values()) for one in plan.plan_cases()]
    assert hashlib.sha256(repr(every).encode()).hexdigest().startswith("9cbb41a134a20369a71cc96b6130f4d594064306")
    assert every == [tuple(vars(one).values()) for one in plan.plan_cases(plan.SEED, 24, KEYS[0])]


def test_a_seed_finds_no_other_case_without_its_key():
    one, same, other = (plan.plan_cases(40, None, KEYS[k]) for k in (0, 0, 1))
    assert one == same
    assert not {c.seed for c in one} & {c.seed for c in other}
    assert min(c.seed for c in one) > 2**96  # too many to try
    assert [(c.machine, c.kind) for c in one] != [(c.machine, c.kind) for c in other]


@pytest.mark.parametrize("per_machine", range(1, 25))
def test_a_small_benchmark_hides_physics_as_well(per_machine):
    cases = [one for one in plan.plan_cases(40, per_machine) if one.machine == "pendulum"]
    assert len(cases) == per_machine
    kinds = {one.kind for one in cases}
    assert len(kinds) == min(per_machine, len(plan.TURNS))
    assert {one.split for one in cases} == ({"scored"} if per_machine == 1 else {"scored", "development"})
    assert any(one.kind in ("single", "change") and one.split == "scored" for one in cases)


def test_only_the_published_seed_stands_in_the_folder(made):
    folder, _ = made(seed=48613)
    assert "48613" not in "".join(f.read_text() for f in (folder / files.ABOUT, folder / files.README))
    assert "seed" not in json.loads((folder / files.ABOUT).read_text())


def test_the_published_seed_is_said(made):
    folder, _ = made(seed=plan.SEED)
    assert json.loads((folder / files.ABOUT).read_text())["seed"] == plan.SEED


def test_a_benchmark_goes_on_with_its_seed_size_and_key_alone(made):
    folder, key = made()
    made()
    before = files.digest(folder)
    with pytest.raises(UserError, match="another seed, size or key"):
        made(seed=41)
    key.write_bytes(KEYS[1])
    with pytest.raises(UserError, match="another seed, size or key"):
        made()
    key.unlink()
    with pytest.raises(UserError, match="is not there"):
        made()
    assert not key.exists()  # a new one would open nothing
    assert files.digest(folder) == before


def test_seals_of_another_key_are_refused(made, monkeypatch):
    folder, _ = made()
    monkeypatch.setattr(plan, "MACHINES", ("pendulum",))
    case = folder / files.CASES / "001"
    case.mkdir(parents=True)
    (case / seal.SEALED).write_text(json.dumps(seal.seal_text("{}", b"", KEYS[1])))
    about = {"name": make.NAME, "version": plan.VERSION, "concealed": 1,
             "commitment": plan.commitment(40, 1, KEYS[0])}  # fmt: skip
    (folder / files.ABOUT).write_text(json.dumps(about))
    with pytest.raises(UserError, match="does not open"):
        made()


def test_a_key_within_the_folder_is_refused_by_any_path(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "bench", target_is_directory=True)
    with pytest.raises(UserError, match="must not get the key"):
        make.make(tmp_path / "bench", tmp_path / "link" / "key", Workers("loky", 1), lambda *_: None)


def test_a_copy_of_a_recording_that_cannot_be_made_anew_stays(tmp_path, monkeypatch):
    folder = tmp_path / "003"
    folder.mkdir()
    (folder / "train.csv").write_text("t,u\n0,1\n")
    monkeypatch.setattr(real, "table", lambda one: None)
    make._write_real(folder, real.RECORDINGS[0])
    assert (folder / "train.csv").read_text() == "t,u\n0,1\n"
