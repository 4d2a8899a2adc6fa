"""Without the extra the mistake is one line; a password that goes unencrypted is told."""

from __future__ import annotations

import logging
import socket
import ssl
import sys

import pytest

from dtbacklash.errors import UserError
from dtbacklash.remote.connection import Connection, why_not
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


@pytest.mark.parametrize(("error", "said"), [
    (socket.gaierror(-2, "Name or service not known"), "there is no such host"),
    (ConnectionRefusedError(111, "Connection refused"), "nothing listens there (connection refused)"),
    (TimeoutError("timed out"), "it does not answer within 5 s"),
    (OSError(113, "No route to host"), "no route to host"),
])  # fmt: skip
def test_why_a_broker_cannot_be_reached_is_said(error: OSError, said: str) -> None:
    assert why_not(error) == said


def test_a_certificate_that_has_expired_is_said() -> None:
    error = ssl.SSLCertVerificationError(1, "certificate verify failed")
    error.verify_message = "certificate has expired"
    assert why_not(error) == "its certificate does not hold: certificate has expired"
