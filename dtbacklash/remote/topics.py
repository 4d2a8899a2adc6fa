"""The topics of the broker: two a machine, one a twin. Access rules speak of nothing else."""

from __future__ import annotations

import re

from dtbacklash.errors import UserError

ROOT = "dtbacklash"
NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
REQUESTS, STATUSES = f"{ROOT}/machine/+/request", f"{ROOT}/twin/+/status"


def check_name(key: str, name: str) -> str:
    """A name that may stand in a topic; raises UserError for another."""
    if not NAME.fullmatch(name):
        raise UserError(key, name, "letters, digits, - and _, at most 64 of them")
    return name


def request_topic(machine: str) -> str:
    """Where a machine asks."""
    return f"{ROOT}/machine/{machine}/request"


def answer_topic(machine: str) -> str:
    """Where it is answered."""
    return f"{ROOT}/machine/{machine}/answer"


def status_topic(twin: str) -> str:
    """Where a twin says how it is."""
    return f"{ROOT}/twin/{twin}/status"


def name_in(topic: str) -> str:
    """The machine or twin in a topic."""
    return topic.split("/")[2]


def address(text: str, key: str) -> tuple[str, int]:
    """Host and port from ``host:port``, ``host`` or ``[::1]:port``; raises UserError."""
    host, colon, port = text.rpartition(":")
    if not colon or (":" in host and not host.startswith("[")):
        host, port = text, "1883"
    host = host.strip("[]")
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise UserError(key, text, "host:port, e.g. 127.0.0.1:1883")
    return host, int(port)
