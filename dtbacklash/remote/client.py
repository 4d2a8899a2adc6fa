"""The twin as the machine sees it: requests go out, answers come back and are checked; those that fail are counted.

Threads of their own serve the network, so that it never holds up the loop. Simulated time stands still while the twin
works, as with a twin in the same process: there :meth:`RemoteTwin.replies` waits, at most ``timeout_s``. In real time
(``waits=False``) it never waits.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dtbacklash.config.run import TwinConfig
from dtbacklash.control.belief import Belief
from dtbacklash.errors import UserError
from dtbacklash.remote import protocol
from dtbacklash.remote.connection import NOBODY, Connection
from dtbacklash.remote.credentials import load_credentials
from dtbacklash.remote.messages import AnswerMessage, RequestMessage, Ticket, check_bounds, digest, samples_that_fit
from dtbacklash.twin.link.service import RUN_ENDED, Dropped, Reply, Request

log = logging.getLogger(__name__)

#: what is said beside it of a twin that has answered nothing yet: it drops a wrong signature, and only its log says so
NEVER = ": is it this machine's key that the twin has?"
#: why an answer that is signed and well formed is dropped
OTHER_RUN, UNKNOWN, DOUBLED = "of another run", "to an unknown request", "doubled"
LATE, OLD_BUFFER, CHANGED = "late", "for an old buffer", "to a request that was changed"
UNGUARDED, NO_MODEL = "not guarded as asked", "no model for this machine"
#: what a request may be
WAITING, ANSWERED, GIVEN_UP, OVERTAKEN = range(4)
#: requests and twins that are remembered
REQUESTS_KEPT, TWINS_KEPT = 1000, 100
#: seconds: between two tries where no twin listens; that a broker is waited for once it was found to be gone
AGAIN_S, SHORT_S = 0.3, 1.0


@dataclass
class _Asked:
    """A request and what has come of it."""

    request: Request
    ticket: Ticket
    asked_at: float
    until: float
    state: int = WAITING
    sha256: str = ""
    sent: bool = False
    payload: bytes = b""
    again_at: float = 0.0
    accepted: Ticket | None = None
    problem: str = ""


class RemoteTwin:
    """A :class:`~dtbacklash.twin.link.service.TwinService` whose twin is at the other end of a network.

    settings : ``broker``, ``machine``, ``credentials``, ``timeout_s``, ``buffer``, ``gap_max_deg`` of a run's twin.
    belief : see :mod:`.belief`. waits : whether :meth:`replies` waits for what is outstanding. design : designs the
        controller for another model that an answer holds; where it raises UserError the answer is dropped.

    Raises UserError: no key, a file that others may read, no address, a buffer that no message holds; the extra is
    missing.
    """

    def __init__(
        self,
        settings: TwinConfig,
        belief: protocol.Document,
        waits: bool = True,
        design: Callable[[Belief], object] = lambda belief: None,
    ) -> None:
        self._design = design
        self.settings, self.belief, self.waits = settings, belief, waits
        machine = protocol.check_name("twin.machine", settings.machine)
        credentials = load_credentials(settings.credentials, "twin.credentials")
        self._key = credentials.needed_key("twin.credentials").of_machine(machine)
        bank = settings.on_alarm == "bank"
        name, length = ("bank_buffer", settings.bank_buffer) if bank else ("buffer", settings.buffer)
        if length > (most := samples_that_fit(belief, 3 if bank else 2)):
            raise UserError(f"twin.{name}", length, f"must be at most {most} samples with a remote twin")
        self._topic, self._machine = protocol.request_topic(machine), machine
        self._run, self._counter = secrets.token_hex(16), 0
        self._asked: OrderedDict[int, _Asked] = OrderedDict()
        self._waiting: dict[int, _Asked] = {}  # of the asked
        self._unsent: deque[_Asked] = deque()
        self._by_mid: dict[int, _Asked] = {}
        self._told: dict[int, str] = {}
        self._done: list[Reply] = []
        self._twins = protocol.Counters(TWINS_KEPT)
        self._dropped: Counter[tuple[int, str]] = Counter()  # by the last request before, and reason
        self._delays: list[float] = []
        self._reasons: Counter[str] = Counter()
        self._gone = False
        self._closing, self._over = False, False
        self._state = threading.Condition()
        self._connection = Connection(
            settings.broker, credentials, [protocol.answer_topic(machine)], self._take, f"machine-{machine}",
            "twin.broker", published=self._published, changed=self._changed,
        )  # fmt: skip
        self._sender = threading.Thread(target=self._send_all, name="twin-sender", daemon=True)
        self._connection.open()
        self._sender.start()

    # --- the loop's side

    def warm_up(self) -> None:
        """Wait until the broker has answered, at most ``timeout_s``; without one the run goes on.

        Raises UserError: the broker refuses user, password or certificate.
        """
        link = self._connection
        link.answered.wait(self.settings.timeout_s)
        if link.refused:
            where = self.settings.credentials or "null"
            raise UserError("twin.credentials", where, f"the broker at {link.broker} refuses them: {link.problem}")
        if not link.connected.is_set():
            log.warning("no broker at %s (%s): the gap in force stays", link.broker, link.problem or "no answer")

    def ask(self, request: Request) -> None:
        """See :class:`TwinService`; returns at once."""
        now = time.monotonic()
        with self._state:
            self._counter += 1
            patience = min(SHORT_S, self.settings.timeout_s) if self._gone else self.settings.timeout_s
            one = _Asked(request, Ticket(self._run, self._counter), now, now + patience)
            self._asked[self._counter] = self._waiting[self._counter] = one
            while len(self._asked) > REQUESTS_KEPT:
                self._asked.popitem(last=False)
            self._unsent.append(one)
            self._state.notify_all()

    def replies(self) -> list[Reply]:
        """See :class:`TwinService`; waits for all that is outstanding if ``waits``."""
        with self._state:
            while True:
                now = time.monotonic()
                self._give_up(now)
                if not self._waiting or not self.waits:
                    break
                self._state.wait(max(0.0, min(one.until for one in self._waiting.values()) - now))
            done, self._done = self._done, []
        return done

    def dropped(self) -> list[Dropped]:
        """What was dropped, by the request before it and by reason; nothing is counted after this call."""
        with self._state:
            self._over = True
            self._reasons[RUN_ENDED] += len(self._waiting)
            self._reasons += Counter()  # without what is zero
            known = {number: one.request for number, one in self._asked.items()}
            return [Dropped(known.get(number), reason, n) for (number, reason), n in self._dropped.items()]

    def summary(self) -> dict[str, Any]:
        """For a run's summary: requests, answers, why there were none, what was dropped, delays in s."""
        with self._state:
            dropped: Counter[str] = Counter()
            for (_, reason), n in self._dropped.items():
                dropped[reason] += n
            delays = sorted(self._delays)
            return {
                "broker": self.settings.broker, "machine": self._machine, "requests": self._counter,
                "answered": len(delays), "unanswered": dict(self._reasons), "dropped": dict(dropped),
                "delay_s": {"median": _quantile(delays, 0.5), "p99": _quantile(delays, 0.99)},
            }  # fmt: skip

    def close(self) -> None:
        """End the connection."""
        with self._state:
            self._closing = True
            self._state.notify_all()
        self._connection.close()
        self._sender.join(1.0)

    def __enter__(self) -> RemoteTwin:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- threads: what goes out

    def _send_all(self) -> None:
        """Send the requests in order, and again where no twin was listening."""
        link = self._connection
        while True:
            with self._state:
                while not (self._closing or (self._unsent and link.connected.is_set() and self._due())):
                    self._state.wait(AGAIN_S if self._unsent else None)
                if self._closing:
                    return
                one = self._unsent.popleft()
            try:
                self._send(one)
            except Exception as error:  # whatever it is: the next request is to be sent
                with self._state:
                    if one.state == WAITING:
                        self._unanswered(one, f"cannot be sent: {error}")
                    self._state.notify_all()

    def _send(self, one: _Asked) -> None:
        """Send a request, unless something has come of it meanwhile."""
        left_s = round(max(one.until - time.monotonic(), 0.001), 3)
        message = RequestMessage(self._machine, one.ticket, left_s, one.request, self.belief)
        payload = one.payload or message.dumped()
        with self._state:
            if one.state != WAITING:
                return
            one.payload, one.sha256, one.sent = payload, digest(payload), True
        # not while the state is locked: paho tells what was published with a lock of its own, that publishing takes
        mid = self._connection.publish(self._topic, payload, self._key, expires_s=self.settings.timeout_s)
        with self._state:
            self._by_mid[mid] = one
            if mid in self._told:
                self._hear(self._by_mid.pop(mid), self._told.pop(mid))

    def _due(self) -> bool:
        """Whether the next request is to be sent now; those that were given up are forgotten."""
        while self._unsent and self._unsent[0].state != WAITING:
            self._unsent.popleft()
        return bool(self._unsent) and self._unsent[0].again_at <= time.monotonic()

    def _published(self, mid: int, refusal: str) -> None:
        """Take what the broker says about a request, which may come before its number is known."""
        with self._state:
            if mid in self._by_mid:
                self._hear(self._by_mid.pop(mid), refusal)
            else:
                self._told[mid] = refusal

    def _hear(self, one: _Asked, refusal: str) -> None:
        """A request has reached the broker, which may refuse it, or report that nobody listens."""
        one.problem = ""
        if one.state == WAITING and refusal == NOBODY:
            one.problem = "no twin listens at"
            one.again_at = time.monotonic() + AGAIN_S
            self._unsent.appendleft(one)  # before later ones: a twin takes none that comes behind those
        elif one.state == WAITING and refusal:
            self._unanswered(one, f"the broker at {self.settings.broker} refuses the request: {refusal}")
        self._state.notify_all()

    def _changed(self) -> None:
        with self._state:
            if self._connection.connected.is_set():
                self._gone = False
            self._state.notify_all()

    # --- threads: what comes in

    def _take(self, topic: str, payload: bytes, signature: str | None) -> None:
        """A message on the topic of the answers."""
        try:
            message = self._checked(topic, payload, signature)
            with self._state:
                self._accept(message)
        except Exception as error:  # whatever it is: a message must not end the network's thread
            refused = protocol.Rejected.of(error)
            log.info("dropped an answer: %s", refused)
            with self._state:
                if not self._over:
                    self._dropped[self._counter, refused.reason] += 1

    def _checked(self, topic: str, payload: bytes, signature: str | None) -> AnswerMessage:
        """The answer in a message that passes all checks; raises Rejected."""
        protocol.check_origin("answer", self._key, topic, payload, signature)
        message = AnswerMessage.parsed(payload)
        if message.to.run != self._run or message.machine != self._machine:
            raise protocol.Rejected(OTHER_RUN)
        if message.answer is not None:
            if self.settings.guard and not message.answer.guarded:
                raise protocol.Rejected(UNGUARDED)
            self._check_model(message.answer.belief)
            check_bounds(message.answer, self.settings.gap_max_deg)
        return message

    def _check_model(self, belief: Belief | None) -> None:
        """Raise Rejected for a model that was not asked for, fits another machine, or allows no controller."""
        if belief is None:
            return
        if self.settings.on_alarm != "bank":
            raise protocol.Rejected(NO_MODEL, "it was not asked for")
        mine, said = self.belief["rig"], belief.rig.config
        if mine["elements"] != said.elements or mine["sensors"] != said.sensors or set(mine["parameters"]) != set(
            said.parameters
        ):  # fmt: skip
            raise protocol.Rejected(NO_MODEL, "its elements, sensors or parameters are others")
        try:
            self._design(belief)
        except UserError as mistake:
            raise protocol.Rejected(NO_MODEL, str(mistake)) from mistake

    def _accept(self, message: AnswerMessage) -> None:
        """Take the answer to a request that waits for one; raises Rejected for all others."""
        one = self._asked.get(message.to.counter)
        if one is None:
            raise protocol.Rejected(UNKNOWN)
        if one.state == ANSWERED:
            raise protocol.Rejected(protocol.REPLAYED if message.ticket == one.accepted else DOUBLED)
        if one.state != WAITING:
            raise protocol.Rejected(LATE if one.state == GIVEN_UP else OLD_BUFFER)
        if message.sha256 != one.sha256:
            raise protocol.Rejected(CHANGED)
        self._twins.advance(message.ticket.run, message.ticket.counter)
        one.accepted = message.ticket
        if message.answer is None:
            self._unanswered(one, f"the twin: {message.reason}", ANSWERED)
        else:
            self._settle(one, ANSWERED)
            self._delays.append(time.monotonic() - one.asked_at)
            self._done.append(Reply(one.request, message.answer))
            if message.answer.accepted:
                for old in [w for w in self._waiting.values() if w.ticket.counter < one.ticket.counter]:
                    self._unanswered(old, "overtaken by the answer to a later buffer", OVERTAKEN)
        self._state.notify_all()

    def _give_up(self, now: float) -> None:
        """Give up the requests that have waited for too long."""
        for one in [one for one in self._waiting.values() if one.until <= now]:
            link = self._connection
            if not one.sent and not one.problem:
                self._gone = True
                reason = f"no broker at {link.broker}" + (f": {link.problem}" if link.problem else "")
            elif one.problem:
                reason = f"{one.problem} {link.broker}"
            else:
                reason = f"no answer within {one.until - one.asked_at:g} s" + ("" if self._delays else NEVER)
            self._unanswered(one, reason)

    def _unanswered(self, one: _Asked, reason: str, state: int = GIVEN_UP) -> None:
        self._settle(one, state)
        self._reasons[reason] += 1
        self._done.append(Reply(one.request, None, reason))

    def _settle(self, one: _Asked, state: int) -> None:
        """Settle a request: it waits no more, and is not sent again."""
        one.state, one.payload = state, b""
        self._waiting.pop(one.ticket.counter, None)


def _quantile(ordered: list[float], share: float) -> float | None:
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else None
