"""Without the extra the mistake is one line; a password that goes unencrypted is told."""

import logging
import socket
import ssl
import sys

import pytest
from told import refused

from dtbacklash.remote.connection import Connection, why_not
from dtbacklash.remote.credentials import Credentials


def _connection(broker: str, credentials: Credentials) -> Connection:
    return Connection(broker, credentials, [], lambda *_: None, "test", "twin.broker")


@pytest.mark.parametrize("missing", ["paho.mqtt.client", "fastjsonschema", ""])
def test_without_the_extra_or_certificates(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if missing:
        monkeypatch.setitem(sys.modules, missing, None)
    extra = "twin.broker=127.0.0.1: needs paho-mqtt: pip install 'dtbacklash[remote]'"
    with refused(extra if missing else "credentials=nowhere.pem: no certificates"):
        _connection("127.0.0.1", Credentials() if missing else Credentials(ca_file="nowhere.pem"))


@pytest.mark.parametrize(("host", "told"), [("10.0.0.7", 1), ("127.0.0.1", 0), ("localhost", 0), ("[::1]:1883", 0)])
def test_a_password_that_goes_unencrypted_is_told(host: str, told: int, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, "dtbacklash"):
        _connection(host, Credentials(user="press", password="hidden"))
    assert len(caplog.records) == told
    assert "hidden" not in caplog.text


EXPIRED = ssl.SSLCertVerificationError(1, "certificate verify failed")
EXPIRED.verify_message = "certificate has expired"


@pytest.mark.parametrize(("error", "said"), [
    (socket.gaierror(-2, "Name or service not known"), "there is no such host"),
    (ConnectionRefusedError(111, "Connection refused"), "nothing listens there (connection refused)"),
    (TimeoutError("timed out"), "it does not answer within 5 s"),
    (OSError(113, "No route to host"), "no route to host"),
    (EXPIRED, "its certificate does not hold: certificate has expired"),
])  # fmt: skip
def test_why_a_broker_cannot_be_reached_is_said(error: OSError, said: str) -> None:
    assert why_not(error) == said
