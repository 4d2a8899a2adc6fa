"""JSON documents off a network: small enough, well formed, of a version that is known, and as their schema says.

What fails a check is :class:`Refused`, with a word for the counters and more for the log.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

#: the format of the messages; another one is refused
VERSION = 1
#: bytes of a message, at most: 100 000 samples and what is believed of a rig fit into the first
REQUEST_BYTES, ANSWER_BYTES, STATUS_BYTES = 4_000_000, 500_000, 4_000_000
SCHEMAS = Path(__file__).with_name("schemas")

#: why a message is dropped, in the counters' words
TOO_LARGE, SIGNATURE, MALFORMED, OTHER_VERSION = "too large", "wrong signature", "malformed", "wrong version"
#: a check that failed itself: what it was about is dropped all the same
FAULT = "the check failed"

Document = dict[str, Any]


class Refused(Exception):
    """A message that fails a check.

    Parameters
    ----------
    reason : a few words, one of a fixed set. detail : what exactly, for the log.
    """

    def __init__(self, reason: str, detail: str = "") -> None:
        self.reason, self.detail = reason, detail
        super().__init__(f"{reason}: {detail}" if detail else reason)


def dumped(document: Document) -> bytes:
    """The bytes of a document; numbers with all their digits.

    Raises
    ------
    ValueError : a number that JSON does not know.
    """
    return json.dumps(document, allow_nan=False, separators=(",", ":")).encode("utf-8")


def parsed(payload: bytes, kind: str, limit: int) -> Document:
    """The document in a message, checked against the schema of its ``kind``.

    Raises
    ------
    Refused : it is too large, no JSON, of another version, or not as the schema says.
    """
    if len(payload) > limit:
        raise Refused(TOO_LARGE, f"{len(payload)} bytes, at most {limit}")
    try:
        document = json.loads(payload.decode("utf-8"), parse_constant=_no_number, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        raise Refused(MALFORMED, f"no JSON: {error}") from error
    if not isinstance(document, dict):
        raise Refused(MALFORMED, "no JSON object")
    if (version := document.get("version")) != VERSION or isinstance(version, bool):
        raise Refused(OTHER_VERSION, f"{str(version)[:40]}, not {VERSION}")
    check, mistake = _validator(kind)
    try:
        check(document)
    except mistake as error:
        raise Refused(MALFORMED, str(error)[:300]) from error
    except RecursionError as error:
        raise Refused(MALFORMED, "nested too deeply") from error
    return document


def schema(kind: str) -> Document:
    """The JSON schema of a kind of message: request, answer or status."""
    found: Document = json.loads((SCHEMAS / f"{kind}.json").read_text(encoding="utf-8"))
    return found


@cache
def _validator(kind: str) -> tuple[Callable[[Document], object], type[Exception]]:
    import fastjsonschema

    return fastjsonschema.compile(schema(kind), use_default=False), fastjsonschema.JsonSchemaValueException


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is beyond a double")
    return number
