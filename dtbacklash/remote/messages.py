"""The messages between machine and twin, version 1: a request with its buffer, and an answer.

Each is a JSON document (``schemas/``); numbers survive to the last bit. A later field is added as an optional one: who
does not know it ignores it. What changes the meaning of a field gets a new version.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.belief import Belief
from dtbacklash.errors import UserError
from dtbacklash.remote.belief import rig_document, rig_of
from dtbacklash.remote.documents import (
    ANSWER_BYTES,
    MALFORMED,
    REQUEST_BYTES,
    VERSION,
    Document,
    Refused,
    dumped,
    parsed,
)
from dtbacklash.twin.estimate import Estimate
from dtbacklash.twin.guard import Attempt, Verdict
from dtbacklash.twin.service import Answer, Request

#: an answer that would put such a gap in force is dropped
OUT_OF_BOUNDS = "gap out of bounds"
#: of words that come from a library
WORDS = 500
_WORDS_FOR = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}


@dataclass(frozen=True)
class Ticket:
    """Which message of which sender: ``run`` is drawn anew at each start, ``counter`` 1, 2, 3, ... within it."""

    run: str
    counter: int


@dataclass(frozen=True)
class RequestMessage:
    """A request on its way. ``sha256`` of its bytes ties the answer to it.

    timeout_s : how long the machine waits. belief : see :mod:`.belief`.
    """

    machine: str
    ticket: Ticket
    timeout_s: float
    request: Request
    belief: Document
    sha256: str = ""

    def dumped(self) -> bytes:
        """The message's bytes."""
        r = self.request
        belief = self.belief
        if r.believed is not None:  # since an answer it may be another
            belief = belief | {"rig": rig_document(r.believed.rig)}
        more: Document = {} if r.u is None else {"u_v": _packed(r.u), "moved": int(r.moved)}
        return dumped(more | {
            "version": VERSION, "kind": "request", "machine": self.machine,
            "run": self.ticket.run, "counter": self.ticket.counter, "timeout_s": self.timeout_s,
            "event": int(r.event), "first": int(r.first), "seed": int(r.seed), "present_rad": float(r.present_rad),
            "theta_m_rad": _packed(r.theta_m), "q3_m": _packed(r.q3), "belief": belief,
        })  # fmt: skip

    @classmethod
    def parsed(cls, payload: bytes) -> RequestMessage:
        """The request in a message; raises Refused."""
        d = parsed(payload, "request", REQUEST_BYTES)
        theta_m, q3 = _unpacked(d["theta_m_rad"]), _unpacked(d["q3_m"])
        if theta_m.size != q3.size:
            raise Refused(MALFORMED, f"{theta_m.size} samples of theta_m_rad, {q3.size} of q3_m")
        u = _unpacked(d["u_v"]) if "u_v" in d else None
        if u is not None and u.size != q3.size:
            raise Refused(MALFORMED, f"{u.size} samples of u_v, {q3.size} of q3_m")
        request = Request(
            int(d["event"]), int(d["first"]), theta_m, q3, float(d["present_rad"]), int(d["seed"]), u, d.get("moved", 0)
        )  # fmt: skip
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
        if self.answer is None:
            return dumped(document | {"status": "refused", "reason": self.reason[:WORDS]})
        said: Document = {
            "status": "answered",
            "guarded": bool(self.answer.guarded),
            "wall_s": float(self.answer.wall_s),
        }
        if self.answer.found:
            said["found"] = self.answer.found[:WORDS]
        if self.answer.belief is not None:
            said["belief"] = rig_document(self.answer.belief.rig)
        return dumped(document | said | {"attempts": [_attempt_out(one) for one in self.answer.attempts]})

    @classmethod
    def parsed(cls, payload: bytes) -> AnswerMessage:
        """The answer in a message; raises Refused."""
        d = parsed(payload, "answer", ANSWER_BYTES)
        to = d["request"]
        answer = None
        if d["status"] == "answered":
            attempts = tuple(_attempt_in(one) for one in d["attempts"])
            belief = _belief_in(d["belief"]) if "belief" in d else None
            answer = Answer(attempts, d["guarded"], float(d["wall_s"]), d.get("found", ""), belief)
        ticket = Ticket(d["twin"], int(d["counter"]))
        return cls(
            d["machine"], ticket, Ticket(to["run"], int(to["counter"])), to["sha256"], answer, d.get("reason", "")
        )  # fmt: skip


def check_bounds(answer: Answer, gap_max_deg: float) -> None:
    """Refuse an answer that would put in force a gap that no machine has; raises Refused.

    The attempts that are not accepted may say anything: they come into the table only.
    """
    if not answer.accepted:
        return
    gap_deg = math.degrees(answer.gap_rad)
    # rounding from radians and back moves a gap at the bound by less than this
    if not 0.0 <= gap_deg <= gap_max_deg * (1.0 + 1e-12):
        raise Refused(OUT_OF_BOUNDS, f"{gap_deg:g} deg, not within 0..{gap_max_deg:g}")
    std_rad = answer.chosen.estimate.std_rad
    if answer.guarded and not std_rad >= 0.0:
        raise Refused(OUT_OF_BOUNDS, f"a standard error of {std_rad:g} rad")


def digest(payload: bytes) -> str:
    """SHA-256 of a message, in hexadecimal digits."""
    return hashlib.sha256(payload).hexdigest()


def samples_that_fit(belief: Document, signals: int = 2) -> int:
    """How many samples a buffer of so many signals may have at most, so that its request is not too large."""
    rest = len(dumped(belief)) + 4000
    return max(0, (REQUEST_BYTES - rest) * 3 // (4 * 8 * signals) - 4)


def _packed(samples: Floats) -> str:
    return base64.b64encode(np.ascontiguousarray(samples, dtype="<f8").tobytes()).decode("ascii")


def _unpacked(samples: str | list[float]) -> Floats:
    """(N,) finite numbers from their base64, or from a list."""
    if isinstance(samples, list):
        try:
            found = np.array(samples, dtype=np.float64)
        except OverflowError as error:
            raise Refused(MALFORMED, "a sample beyond a double") from error
    else:
        try:
            raw = base64.b64decode(samples, validate=True)
        except (binascii.Error, ValueError) as error:
            raise Refused(MALFORMED, f"samples: {error}") from error
        if len(raw) % 8:
            raise Refused(MALFORMED, "samples that are no doubles")
        found = np.frombuffer(raw, dtype="<f8").astype(np.float64)
    if not np.all(np.isfinite(found)):
        raise Refused(MALFORMED, "samples that are not finite")
    return found


def _belief_in(document: Document) -> Belief:
    try:
        return Belief(rig_of(document))
    except (UserError, TypeError, ValueError, KeyError) as error:
        raise Refused(MALFORMED, f"no rig: {error}") from error


def _number_out(value: float) -> float | str:
    value = float(value)
    return value if math.isfinite(value) else str(value)


def _number_in(value: float | str) -> float:
    try:
        return _WORDS_FOR[value] if isinstance(value, str) else float(value)
    except OverflowError as error:
        raise Refused(MALFORMED, "a number beyond a double") from error


def _attempt_out(attempt: Attempt) -> Document:
    e, v = attempt.estimate, attempt.verdict
    return {
        **{name: _number_out(getattr(e, name)) for name in _NUMBERS},
        "evaluations": int(e.evaluations), "converged": bool(e.converged), "message": e.message[:WORDS],
        "wall_s": float(e.wall_s), "accepted": bool(v.accepted), "reason": v.reason[:WORDS],
        "settled": bool(v.settled), "agrees": bool(v.agrees), "applied_rad": _number_out(attempt.applied_rad),
    }  # fmt: skip


def _attempt_in(said: dict[str, Any]) -> Attempt:
    known: dict[str, Any] = {name: _number_in(said[name]) for name in _NUMBERS}
    known |= {name: said[name] for name in ("evaluations", "converged", "message")}
    estimate = Estimate(**known, wall_s=float(said["wall_s"]))
    verdict = Verdict(said["accepted"], said["reason"], said["settled"], said["agrees"])
    return Attempt(estimate, verdict, _number_in(said["applied_rad"]))


_NUMBERS = tuple(one.name for one in fields(Estimate) if one.type == "float" and one.name != "wall_s")
