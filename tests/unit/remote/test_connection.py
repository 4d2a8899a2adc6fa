"""Without the extra the mistake is one line; a password that goes unencrypted is told."""

from __future__ import annotations

import logging
import sys

import pytest

from dtbacklash.errors import UserError
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import Credentials


def _connection(broker: str, credentials: Credentials) -> Connection:
    return Connection(broker, credentials, [], lambda *_: None, "test", "twin.broker")


@pytest.mark.parametrize("missing", ["paho.mqtt.client", "fastjsonschema"])
def test_without_the_extra(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(UserError, match=r"twin\.broker=127\.0\.0\.1: needs the extra `remote`"):
        _connection("127.0.0.1", Credentials())


@pytest.mark.parametrize(("host", "told"), [("10.0.0.7", 1), ("127.0.0.1", 0), ("localhost", 0), ("[::1]:1883", 0)])
def test_a_password_that_goes_unencrypted_is_told(host: str, told: int, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "dtbacklash"):
        _connection(host, Credentials(user="press", password="hidden"))
    assert len(caplog.records) == told
    assert "hidden" not in caplog.text


def test_certificates_that_cannot_be_read_are_one_line() -> None:
    with pytest.raises(UserError, match=r"credentials=nowhere\.pem: no certificates"):
        _connection("127.0.0.1", Credentials(ca_file="nowhere.pem"))
