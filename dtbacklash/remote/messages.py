"""The messages between machine and twin, version 1: a request with its buffer, and an answer.

Each is a JSON document (``schemas/``); numbers keep all their bits. A new field is optional, and a reader that does not
know it ignores it. A field that changes its meaning needs a new version.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.belief import Belief
from dtbacklash.errors import UserError
from dtbacklash.physics.rig_file import rig_content, rig_of
from dtbacklash.remote.protocol import LIMITS, MALFORMED, VERSION, Document, Rejected, dumped, parsed
from dtbacklash.twin.gap.estimate import Estimate
from dtbacklash.twin.gap.guard import Attempt, Verdict
from dtbacklash.twin.link.service import Answer, Request

#: why an answer with a gap that no machine has is dropped
OUT_OF_BOUNDS = "gap out of bounds"
#: letters of a text at most
TEXT = 500
#: a run, and its largest counter, as the schemas have them
RUN, LARGEST = re.compile("[0-9a-f]{32}"), 2**53 - 1


@dataclass(frozen=True)
class Ticket:
    """Which message of which sender: ``run`` is drawn anew at each start, ``counter`` 1, 2, 3, ... within it."""

    run: str
    counter: int


@dataclass(frozen=True)
class RequestMessage:
    """A request on its way.

    timeout_s : how long the machine waits. belief : see :mod:`.belief`. sha256 : of its bytes; ties the answer to it.
    """

    machine: str
    ticket: Ticket
    timeout_s: float
    request: Request
    belief: Document
    sha256: str = ""

    def dumped(self) -> bytes:
        """The message's bytes."""
        r, belief = self.request, self.belief
        if r.believed is not None:  # an answer may have changed it
            belief = belief | {"rig": rig_content(r.believed.rig)}
        document: Document = {
            "version": VERSION, "kind": "request", "machine": self.machine,
            "run": self.ticket.run, "counter": self.ticket.counter, "timeout_s": self.timeout_s,
            "event": int(r.event), "first": int(r.first), "seed": int(r.seed), "present_rad": float(r.present_rad),
            "theta_m_rad": _packed(r.theta_m), "q3_m": _packed(r.q3), "belief": belief,
        }  # fmt: skip
        if r.u is not None:
            document |= {"u_v": _packed(r.u), "moved": int(r.moved)}
        return dumped(document)

    @classmethod
    def parsed(cls, payload: bytes) -> RequestMessage:
        """The request in a message; raises Rejected."""
        d = parsed(payload, "request")
        samples = {name: _unpacked(d[name]) for name in ("q3_m", "theta_m_rad", "u_v") if name in d}
        q3, theta_m, u = samples["q3_m"], samples["theta_m_rad"], samples.get("u_v")
        for name, one in samples.items():
            if one.size != q3.size:
                raise Rejected(MALFORMED, f"{one.size} samples of {name}, {q3.size} of q3_m")
        where = int(d["event"]), int(d["first"])
        request = Request(*where, theta_m, q3, float(d["present_rad"]), int(d["seed"]), u, d.get("moved", 0))
        ticket = Ticket(d["run"], int(d["counter"]))
        return cls(d["machine"], ticket, float(d["timeout_s"]), request, d["belief"], digest(payload))


@dataclass(frozen=True)
class AnswerMessage:
    """An answer on its way, or the reason why there is none.

    ticket : of the twin. to, sha256 : the request's ticket, and the digest of its bytes.
    """

    machine: str
    ticket: Ticket
    to: Ticket
    sha256: str
    answer: Answer | None
    reason: str = ""

    def dumped(self) -> bytes:
        """The message's bytes."""
        document: Document = {
            "version": VERSION, "kind": "answer", "machine": self.machine, "twin": self.ticket.run,
            "counter": self.ticket.counter,
            "request": {"run": self.to.run, "counter": self.to.counter, "sha256": self.sha256},
        }  # fmt: skip
        answer = self.answer
        if answer is None:
            return dumped(document | {"status": "refused", "reason": self.reason[:TEXT]})
        document |= {"status": "answered", "guarded": bool(answer.guarded), "wall_s": float(answer.wall_s)}
        document["attempts"] = [_attempt_out(one) for one in answer.attempts]
        if answer.found:
            document["found"] = answer.found[:TEXT]
        if answer.belief is not None:
            document["belief"] = rig_content(answer.belief.rig)
        return dumped(document)

    @classmethod
    def parsed(cls, payload: bytes) -> AnswerMessage:
        """The answer in a message; raises Rejected."""
        d = parsed(payload, "answer")
        answer = None
        if d["status"] == "answered":
            attempts = tuple(_attempt_in(one) for one in d["attempts"])
            belief = _belief_in(d["belief"]) if "belief" in d else None
            answer = Answer(attempts, d["guarded"], float(d["wall_s"]), d.get("found", ""), belief)
        ticket, to = Ticket(d["twin"], int(d["counter"])), d["request"]
        asked = Ticket(to["run"], int(to["counter"]))
        return cls(d["machine"], ticket, asked, to["sha256"], answer, d.get("reason", ""))


def check_bounds(answer: Answer, gap_max_deg: float) -> None:
    """Raise Rejected where an answer would put a gap in force that no machine has.

    Attempts that are not accepted may hold any number: they only go into the table.
    """
    if not answer.accepted:
        return
    gap_deg = math.degrees(answer.gap_rad)
    # rounding from radians and back moves a gap at the bound by less than this
    if not 0.0 <= gap_deg <= gap_max_deg * (1.0 + 1e-12):
        raise Rejected(OUT_OF_BOUNDS, f"{gap_deg:g} deg, not within 0..{gap_max_deg:g}")
    std_rad = answer.chosen.estimate.std_rad
    if answer.guarded and not std_rad >= 0.0:
        raise Rejected(OUT_OF_BOUNDS, f"a standard error of {std_rad:g} rad")


def claimed_ticket(payload: bytes) -> Ticket:
    """What a request of a wrong form says of itself; where that cannot be read, a run of zeros and the counter 1."""
    try:
        said = json.loads(payload.decode("utf-8"))
        run, counter = said["run"], said["counter"]
    except (ValueError, RecursionError, TypeError, KeyError):
        run, counter = "", 1
    known = isinstance(run, str) and RUN.fullmatch(run) and type(counter) is int and 1 <= counter <= LARGEST
    return Ticket(run, counter) if known else Ticket(32 * "0", 1)


def digest(payload: bytes) -> str:
    """SHA-256 of a message, in hexadecimal digits."""
    return hashlib.sha256(payload).hexdigest()


def samples_that_fit(belief: Document, signals: int = 2) -> int:
    """The most samples that a buffer of so many signals may have before its request is too large."""
    rest = len(dumped(belief)) + 4000
    return max(0, (LIMITS["request"] - rest) * 3 // (4 * 8 * signals) - 4)


def _packed(samples: Floats) -> str:
    return base64.b64encode(np.ascontiguousarray(samples, dtype="<f8").tobytes()).decode("ascii")


def _unpacked(samples: str | list[float]) -> Floats:
    """(N,) finite numbers from their base64, or from a list."""
    if isinstance(samples, list):
        try:
            found = np.array(samples, dtype=np.float64)
        except OverflowError as error:
            raise Rejected(MALFORMED, "a sample beyond a double") from error
    else:
        try:
            raw = base64.b64decode(samples, validate=True)
        except (binascii.Error, ValueError) as error:
            raise Rejected(MALFORMED, f"samples: {error}") from error
        if len(raw) % 8:
            raise Rejected(MALFORMED, "samples that are no doubles")
        found = np.frombuffer(raw, dtype="<f8").astype(np.float64)
    if not np.all(np.isfinite(found)):
        raise Rejected(MALFORMED, "samples that are not finite")
    return found


def _belief_in(document: Document) -> Belief:
    try:
        return Belief(rig_of(document))
    except (UserError, TypeError, ValueError, KeyError) as error:
        raise Rejected(MALFORMED, f"no rig: {error}") from error


def _number_out(value: float) -> float | str:
    return float(value) if math.isfinite(value) else str(float(value))


def _number_in(value: float | str) -> float:
    """A number, or one of the words ``nan``, ``inf``, ``-inf``."""
    try:
        return float(value)
    except OverflowError as error:
        raise Rejected(MALFORMED, "a number beyond a double") from error


#: type of a field -> how it is written, and read
_FORMS: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "float": (_number_out, _number_in), "int": (int, int), "bool": (bool, bool), "str": (lambda text: text[:TEXT], str),
}  # fmt: skip


def _attempt_out(attempt: Attempt) -> Document:
    parts = (attempt.estimate, attempt.verdict)
    found = {one.name: _FORMS[str(one.type)][0](getattr(part, one.name)) for part in parts for one in fields(part)}
    # it is the one number that a controller takes: a number, or null where there is none
    return found | {"applied_rad": attempt.applied_rad if math.isfinite(attempt.applied_rad) else None}


def _attempt_in(said: Document) -> Attempt:
    def part(kind: type) -> dict[str, Any]:
        return {one.name: _FORMS[str(one.type)][1](said[one.name]) for one in fields(kind)}

    applied = said["applied_rad"]
    applied_rad = math.nan if applied is None else _number_in(applied)
    return Attempt(Estimate(**part(Estimate)), Verdict(**part(Verdict)), applied_rad)
