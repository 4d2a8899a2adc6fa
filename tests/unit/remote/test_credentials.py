"""Keys sign, and are told to nobody."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from dtbacklash.errors import UserError
from dtbacklash.remote.connection import address
from dtbacklash.remote.credentials import KEY, PASSWORD, STATUS, Credentials, Key, load_credentials
from dtbacklash.remote.protocol import check_name

DIGITS = "0f" * 32


def _file(tmp_path: Path, text: str, mode: int = 0o600) -> str:
    path = tmp_path / "credentials.yaml"
    path.write_text(text)
    path.chmod(mode)
    return str(path)


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (KEY, PASSWORD, "DTB_TWIN_USER"):
        monkeypatch.delenv(name, raising=False)


def test_a_signature_is_of_topic_bytes_and_machine() -> None:
    key = Key.parsed(DIGITS, "key").of_machine("press")
    signature = key.sign("a/b", b"payload")
    assert key.signed("a/b", b"payload", signature)
    for topic, payload, given in (
        ("a/c", b"payload", signature), ("a/b", b"payloae", signature), ("a/b", b"payload", signature[:-1] + "x"),
        ("a/b", b"payload", None), ("a/b", b"payload", ""), ("a/b", b"payload", "\ud800é"),
    ):  # fmt: skip
        assert not key.signed(topic, payload, given)
    assert not Key.parsed(DIGITS, "key").of_machine("lathe").signed("a/b", b"payload", signature)
    assert not Key.parsed(DIGITS, "key").of_machine(STATUS).signed("a/b", b"payload", signature)


def test_the_key_of_a_machine_signs_as_the_twins_key_does_for_it() -> None:
    twin = Key.parsed(DIGITS, "key")
    own = Key.parsed(twin.of_machine("press").text(), "key")
    assert own.of_machine("press").sign("t", b"x") == twin.of_machine("press").sign("t", b"x")
    with pytest.raises(UserError, match="is that of press; needed is that of lathe"):
        own.of_machine("lathe")


def test_neither_keys_nor_passwords_are_printed(tmp_path: Path) -> None:
    found = load_credentials(_file(tmp_path, f"user: me\npassword: hidden\nkey: {DIGITS}\n"), "credentials")
    assert found.password == "hidden"
    shown = repr(found) + str(found) + repr(found.key)
    assert "hidden" not in shown
    assert DIGITS not in shown
    assert repr(bytes.fromhex(DIGITS))[2:20] not in shown


@pytest.mark.parametrize(
    ("text", "mode", "said"),
    [
        ("key: tooshort", 0o600, "a key is 64 hexadecimal digits"), ("key: 12345", 0o600, "texts for"),
        *((text, 0o600, "a YAML file with some of") for text in ("secret: x", "- key", "key: [")),
        *((f"key: {DIGITS}", mode, f"others may read it (mode {mode:o}): chmod 600")
          for mode in (0o640, 0o604, 0o644, 0o620, 0o666)),
    ],
)  # fmt: skip
def test_a_file_that_is_none_or_that_others_may_read_is_refused_without_quoting_it(
    tmp_path: Path, text: str, mode: int, said: str
) -> None:
    with pytest.raises(UserError) as error:
        load_credentials(_file(tmp_path, text, mode), "credentials")
    assert said in str(error.value)
    assert not {"tooshort", DIGITS} & set(str(error.value).split())


def test_the_environment_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = _file(tmp_path, f"user: me\npassword: one\nkey: {DIGITS}\nca_file: ca.pem\n")
    monkeypatch.setenv(PASSWORD, "two")
    monkeypatch.setenv(KEY, "ab" * 32)
    found = load_credentials(file, "credentials")
    assert (found.user, found.password, found.ca_file) == ("me", "two", str(tmp_path / "ca.pem"))
    assert found.key == Key.parsed("ab" * 32, "key")
    assert load_credentials(None, "credentials").user is None
    monkeypatch.setenv(KEY, "no key")
    with pytest.raises(UserError, match=r"^\$DTB_TWIN_KEY=\.\.\.: a key is"):
        load_credentials(None, "credentials")


@pytest.mark.parametrize(
    ("text", "found"),
    [("a:1", ("a", 1)), ("10.0.0.7", ("10.0.0.7", 1883)), ("[::1]:8883", ("::1", 8883)), ("::1", ("::1", 1883))],
)
def test_an_address(text: str, found: tuple[str, int]) -> None:
    assert address(text, "broker") == found


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Credentials().needed_key("credentials"), "messages have to be signed"),
        *((partial(address, text, "broker"), "host:port") for text in ("", ":1", "a:", "a:b", "a:0", "a:65536", "a:²")),
        *((partial(check_name, "machine", n), "letters, digits") for n in ("", "a/b", "+", "#", "a b", "x" * 65, "ä")),
    ],
)
def test_no_key_no_address_no_name_for_a_topic(call: Callable[[], object], said: str) -> None:
    with pytest.raises(UserError, match=said):
        call()
