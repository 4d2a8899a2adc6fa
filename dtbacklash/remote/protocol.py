"""What the two ends of the network agree on: topics, limits, signed JSON documents, and why a message is dropped.

A message that fails a check raises :class:`Rejected`, with a short reason for the counters and more for the log.
"""

from __future__ import annotations

import json
import math
import re
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from dtbacklash.errors import UserError

#: the version of the messages; another one is refused
VERSION = 1
#: kind of message -> bytes at most: 100 000 samples and the belief about a rig fit into a request
LIMITS = {"request": 4_000_000, "answer": 500_000, "status": 4_000_000}
SCHEMAS = Path(__file__).with_name("schemas")

#: why either end drops a message, as the counters name it; FAULT: the check itself failed
TOO_LARGE, SIGNATURE, MALFORMED, OTHER_VERSION = "too large", "wrong signature", "malformed", "wrong version"
REPLAYED, FAULT = "replayed", "the check failed"

ROOT = "dtbacklash"
NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
REQUESTS, STATUSES = f"{ROOT}/machine/+/request", f"{ROOT}/twin/+/status"

Document = dict[str, Any]


class Rejected(Exception):
    """A message that fails a check.

    reason : a few words, one of a fixed set. detail : what exactly, for the log.
    """

    def __init__(self, reason: str, detail: str = "") -> None:
        self.reason, self.detail = reason, detail
        super().__init__(f"{reason}: {detail}" if detail else reason)

    @classmethod
    def of(cls, error: Exception) -> Rejected:
        """The refusal that an error stands for: any error but a refusal is a fault of the check."""
        return error if isinstance(error, cls) else cls(FAULT, repr(error))


class Signer(Protocol):
    """A key: see :class:`.credentials.Key`."""

    def signed(self, topic: str, payload: bytes, signature: str | None) -> bool:
        """Whether a signature fits a message."""


class Counters:
    """The last counter of each sender, for the ``limit`` senders that were heard last."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._last: OrderedDict[Hashable, int] = OrderedDict()

    def advance(self, sender: Hashable, counter: int) -> None:
        """Note the next counter of a sender; raises Rejected where it is not above the last one."""
        if counter <= self._last.get(sender, 0):
            raise Rejected(REPLAYED, f"message {counter}")
        self._last[sender] = counter
        self._last.move_to_end(sender)
        if len(self._last) > self._limit:
            self._last.popitem(last=False)


def check_name(key: str, name: str) -> str:
    """Return a name that may stand in a topic; raises UserError for another one."""
    if not NAME.fullmatch(name):
        raise UserError(key, name, "letters, digits, - and _, at most 64 of them")
    return name


def request_topic(machine: str) -> str:
    """The topic of a machine's requests."""
    return f"{ROOT}/machine/{machine}/request"


def answer_topic(machine: str) -> str:
    """The topic of the answers to a machine."""
    return f"{ROOT}/machine/{machine}/answer"


def status_topic(twin: str) -> str:
    """The topic of a twin's status."""
    return f"{ROOT}/twin/{twin}/status"


def name_in(topic: str) -> str:
    """The machine or twin that a topic names."""
    return topic.split("/")[2]


def dumped(document: Document) -> bytes:
    """The bytes of a document, numbers with all their digits; raises ValueError for NaN and infinity."""
    return json.dumps(document, allow_nan=False, separators=(",", ":")).encode("utf-8")


def check_origin(kind: str, key: Signer, topic: str, payload: bytes, signature: str | None) -> None:
    """Check size and signature of a message before its content is read; raises Rejected."""
    if len(payload) > LIMITS[kind]:
        raise Rejected(TOO_LARGE, f"{len(payload)} bytes, at most {LIMITS[kind]}")
    if not key.signed(topic, payload, signature):
        raise Rejected(SIGNATURE)


def parsed(payload: bytes, kind: str) -> Document:
    """The document in a message, checked against the schema of its ``kind``: request, answer or status.

    Raises Rejected: it is no JSON, of another version, or does not follow the schema.
    """
    try:
        document = json.loads(payload.decode("utf-8"), parse_constant=_not_a_number, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        raise Rejected(MALFORMED, f"no JSON: {error}") from error
    if not isinstance(document, dict):
        raise Rejected(MALFORMED, "no JSON object")
    if (version := document.get("version")) != VERSION or isinstance(version, bool):
        raise Rejected(OTHER_VERSION, f"{str(version)[:40]}, not {VERSION}")
    check, mistake = _validator(kind)
    try:
        check(document)
    except mistake as error:
        raise Rejected(MALFORMED, str(error)[:300]) from error
    except RecursionError as error:
        raise Rejected(MALFORMED, "nested too deeply") from error
    return document


def schema(kind: str) -> Document:
    """The JSON schema of a kind of message."""
    found: Document = json.loads((SCHEMAS / f"{kind}.json").read_text(encoding="utf-8"))
    return found


@cache
def _validator(kind: str) -> tuple[Callable[[Document], object], type[Exception]]:
    import fastjsonschema

    return fastjsonschema.compile(schema(kind), use_default=False), fastjsonschema.JsonSchemaValueException


def _not_a_number(text: str) -> float:
    raise ValueError(f"{text} is not a number in JSON")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} exceeds a double")
    return number
