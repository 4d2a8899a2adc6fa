"""Seals: only the key opens them, and nothing that was changed passes."""

import json
import stat

import pytest

from dtbacklash.errors import UserError
from dtbacklash.prove import seal
from dtbacklash.prove.secret import Secret

SECRET = Secret(
    seed=7, rig="lead_screw", kind="single",
    effects=[{"location": "gear", "effect": "backlash", "parameters": {"half_gap": 0.1}}],
    parameters={"k": 9500.0}, visibility={"gear.backlash": 12.5},
)  # fmt: skip


@pytest.fixture
def case(tmp_path):
    """A sealed case; returns its folder and the key's file."""
    key = tmp_path / "folder.key"
    folder = tmp_path / "folder" / "1234"
    folder.mkdir(parents=True)
    (folder / seal.RECORDING).write_bytes(b"samples")
    sealed = seal.seal(SECRET, b"samples", seal.read_or_make_key(key))
    (folder / seal.SEALED).write_text(json.dumps(sealed))
    return folder, key


def change(folder, **entries):
    path = folder / seal.SEALED
    path.write_text(json.dumps({**json.loads(path.read_text()), **entries}))


def test_the_key_opens_the_seal(case):
    assert seal.open_seal(*case) == SECRET
    assert seal.key_path(case[0].parent) == case[1]
    assert Secret.from_json(SECRET.to_json()) == SECRET


def test_neither_the_length_of_a_seal_nor_its_commitment_tells_what_is_hidden(case):
    key = seal.read_key(case[1])
    nothing = seal.seal(Secret(seed=1, rig="lead_screw", kind="nothing"), b"", key)
    several = seal.seal(Secret(seed=2, rig="lead_screw", kind="several", effects=SECRET.effects * 3), b"", key)
    assert len(nothing["token"]) == len(several["token"])
    assert seal.seal(SECRET, b"", key)["sha256"] != seal.seal(SECRET, b"", key)["sha256"]


def test_a_key_is_the_owners_alone_and_stays_as_it_is(case):
    before = case[1].read_bytes()
    assert stat.S_IMODE(case[1].stat().st_mode) == 0o600
    assert seal.read_or_make_key(case[1]) == before.strip()
    assert [p.name for p in case[1].parent.iterdir()].count(case[1].name) == 1
    assert not list(case[1].parent.glob(".*"))


def other_key(folder, key):
    key.unlink()
    seal.read_or_make_key(key)


def changed_token(folder, key):
    token = json.loads((folder / seal.SEALED).read_text())["token"]
    change(folder, token=token[:-10] + ("A" if token[-10] != "A" else "B") + token[-9:])


def other_secret(folder, key):
    other = seal.seal(Secret(seed=8, rig="lead_screw", kind="nothing"), b"samples", seal.read_key(key))
    change(folder, token=other["token"])


def without(name):
    return lambda folder, key: (folder / name).unlink()


def with_seal(text):
    return lambda folder, key: (folder / seal.SEALED).write_text(text)


@pytest.mark.parametrize(
    ("tamper", "said"),
    [
        (other_key, "a wrong key, or a changed seal"), (changed_token, "a wrong key, or a changed seal"),
        (lambda folder, key: key.write_text("secret"), "holds no key"),
        (lambda folder, key: key.unlink(), "cannot be read: no such file"),
        (other_secret, "the secret does not match its commitment"),
        (lambda folder, key: (folder / seal.RECORDING).write_bytes(b"other"), "is not the one that was sealed"),
        *((with_seal(text), "is no seal of `dtb conceal`")
          for text in ("", "[]", "{}", '{"format": "x"}', '{"format": "dtbacklash sealed secret 1"}')),
        *((without(name), f"{name} cannot be read: no such file") for name in (seal.SEALED, seal.RECORDING)),
    ],
)  # fmt: skip
def test_what_was_changed_or_is_missing_opens_nothing(case, tamper, said):
    tamper(*case)
    with pytest.raises(UserError, match=said):
        seal.open_seal(*case)


@pytest.mark.parametrize(
    "text", ["", "3", "{}", "[[", '{"seed": 1, "other": 1}', SECRET.to_json().replace("single", "double")]
)
def test_json_that_is_no_secret_is_refused(text):
    with pytest.raises(UserError, match="what `dtb conceal` has sealed"):
        Secret.from_json(text)
