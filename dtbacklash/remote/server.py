"""The twin as a process of its own: takes the requests of all machines off the broker, and answers them.

Messages are checked in the network's thread, wait in a fair queue, are estimated by a pool of processes, and their
answers go out from the threads of the pool. Nothing here grows without a bound.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from dtbacklash.config.twin import ServeConfig
from dtbacklash.errors import UserError
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import STATUS, Key, load_credentials
from dtbacklash.remote.documents import (
    FAULT,
    MALFORMED,
    REQUEST_BYTES,
    SIGNATURE,
    TOO_LARGE,
    VERSION,
    Document,
    Refused,
    dumped,
)
from dtbacklash.remote.messages import AnswerMessage, RequestMessage, Ticket
from dtbacklash.remote.queue import FairQueue
from dtbacklash.remote.statistics import Statistics
from dtbacklash.remote.teller import Teller
from dtbacklash.remote.topics import NAME, REQUESTS, answer_topic, check_name, name_in, status_topic
from dtbacklash.remote.workers import Result, Workers

REPLAYED = "replayed"
BUSY, OVERDUE = "dropped: the twin is busy", "dropped: the machine has stopped waiting"
#: machines that may wait at a time, runs of one that are remembered
MACHINES_WAITING, RUNS_KEPT = 1000, 4000
#: seconds between two looks whether to end, and between two statuses
LOOK_S, STATUS_S = 0.2, 2.0
#: after this the broker says of a twin that is gone that nobody listens, and machines ask again
KEPT_S = 10

Say = Callable[[str], None]


@dataclass(frozen=True)
class _Waiting:
    """A request that waits since ``since``."""

    message: RequestMessage
    since: float


class TwinServer:
    """The twin at the broker.

    Parameters
    ----------
    config : of ``dtb twin serve``. say : takes a line a request.

    Raises
    ------
    UserError : no key, or that of one machine only; no address; the extra is not installed.
    """

    def __init__(self, config: ServeConfig, say: Say = lambda line: None) -> None:
        self.config, self._say = config, Teller(say)
        self.name = check_name("name", config.name)
        credentials = load_credentials(config.credentials, "credentials")
        self._key = credentials.needed_key("credentials")
        if self._key.machine is not None:
            allowed = f"its key is that of {self._key.machine}; the twin needs its own"
            raise UserError("credentials", config.credentials, allowed)
        self._status_key = self._key.of_machine(STATUS)
        self._keys: OrderedDict[str, Key] = OrderedDict()
        self._run, self._counter = secrets.token_hex(16), 0
        self._lock = threading.Lock()  # of the counters and the keys, which several threads use
        self.statistics = Statistics()
        self.queue: FairQueue[_Waiting] = FairQueue(config.queue, MACHINES_WAITING)
        self._runs: OrderedDict[tuple[str, str], int] = OrderedDict()
        self._workers: Workers | None = None
        self._free = threading.Semaphore(config.workers)
        self._busy = 0
        self._ended = threading.Event()
        topic, will = status_topic(self.name), dumped(self._status(online=False))
        self._connection = Connection(
            config.broker, credentials, [REQUESTS], self._take, f"twin-{self.name}",
            will=(topic, will, self._status_key.sign(topic, will)), changed=self._changed, kept_s=KEPT_S,
        )  # fmt: skip
        self._was_connected, self._said = False, ""

    def run(self, belief: Document) -> None:
        """Serve until :meth:`end`; ``belief`` : of a machine, to get ready with."""
        self._workers = Workers(self.config.workers)
        try:
            self._workers.warm_up(belief)
            self._connection.open()
            reporter = threading.Thread(target=self._report, daemon=True)
            reporter.start()
            self._dispatch(self._workers)
            reporter.join(LOOK_S + 1.0)
            if self._connection.connected.is_set():
                self._publish_status(online=False)
                time.sleep(0.1)  # out, before the connection ends
        finally:
            self._connection.close()
            self._workers.close()
            self._say.close()

    def end(self) -> None:
        """Have :meth:`run` return; may be called from a handler of signals."""
        self._ended.set()

    @property
    def refused(self) -> str:
        """What the broker has against this twin; empty for nothing."""
        return self._connection.problem if self._connection.refused else ""

    # --- in: the network's thread

    def _take(self, topic: str, payload: bytes, signature: str | None) -> None:
        try:
            message = self._checked(topic, payload, signature)
        except Exception as error:  # whatever it is: a message must not end the network's thread
            refused = error if isinstance(error, Refused) else Refused(FAULT, repr(error))
            self.statistics.reject(refused.reason)
            self._say(f"{_printable(topic)}: a message is dropped: {refused}")
            return
        self.statistics.asked(message.machine)
        dropped = self.queue.put(message.machine, _Waiting(message, time.monotonic()))
        if dropped is not None:
            self._refuse(dropped.message, BUSY, dropped=True)

    def _checked(self, topic: str, payload: bytes, signature: str | None) -> RequestMessage:
        """The request, if it is what it says it is; raises Refused."""
        if len(payload) > REQUEST_BYTES:
            raise Refused(TOO_LARGE, f"{len(payload)} bytes")
        machine = name_in(topic)
        if not NAME.fullmatch(machine):
            raise Refused(MALFORMED, "the name of the machine")
        if not self._key_of(machine).signed(topic, payload, signature):
            raise Refused(SIGNATURE)
        message = RequestMessage.parsed(payload)
        if message.machine != machine:
            raise Refused(MALFORMED, f"of machine {message.machine}")
        place = machine, message.ticket.run
        if message.ticket.counter <= self._runs.get(place, 0):
            raise Refused(REPLAYED, f"request {message.ticket.counter}")
        self._runs[place] = message.ticket.counter
        self._runs.move_to_end(place)
        if len(self._runs) > RUNS_KEPT:
            self._runs.popitem(last=False)
        return message

    def _key_of(self, machine: str) -> Key:
        with self._lock:
            if machine not in self._keys:
                self._keys[machine] = self._key.of_machine(machine)
                if len(self._keys) > RUNS_KEPT:
                    self._keys.popitem(last=False)
            return self._keys[machine]

    # --- work

    def _dispatch(self, workers: Workers) -> None:
        """Give the requests to the workers, each as one becomes free."""
        while not self._ended.is_set():
            if not self._free.acquire(timeout=LOOK_S):
                continue
            waiting = None
            while waiting is None and not self._ended.is_set():
                waiting = self.queue.take(LOOK_S)
            if waiting is None:
                return
            if time.monotonic() - waiting.since > waiting.message.timeout_s:
                self._free.release()
                self._refuse(waiting.message, OVERDUE, dropped=True)
                continue
            with self._lock:
                self._busy += 1
            workers.submit(waiting.message.belief, waiting.message.request, self._finisher(waiting))

    def _finisher(self, waiting: _Waiting) -> Callable[[Result], None]:
        def done(result: Result) -> None:
            with self._lock:
                self._busy -= 1
            self._free.release()
            if self._ended.is_set():
                return
            message = waiting.message
            if isinstance(result, str):
                self._refuse(message, result)
                return
            delay_s = time.monotonic() - waiting.since
            self.statistics.answer(message.machine, result, delay_s)
            self._send(AnswerMessage(message.machine, self._ticket(), message.ticket, message.sha256, result))
            verdict = "accepted" if result.accepted else "rejected"
            self._say(
                f"{message.machine} request {message.ticket.counter}: {verdict}, {result.chosen.verdict.reason}"
                f" ({1e3 * delay_s:.0f} ms)"
            )

        return done

    # --- out

    def _refuse(self, message: RequestMessage, reason: str, dropped: bool = False) -> None:
        self.statistics.refuse(message.machine, dropped)
        self._send(AnswerMessage(message.machine, self._ticket(), message.ticket, message.sha256, None, reason))
        self._say(f"{message.machine} request {message.ticket.counter}: {reason}")

    def _send(self, answer: AnswerMessage) -> None:
        topic = answer_topic(answer.machine)
        self._connection.publish(topic, answer.dumped(), self._key_of(answer.machine), expires_s=600)

    def _ticket(self) -> Ticket:
        with self._lock:
            self._counter += 1
            return Ticket(self._run, self._counter)

    def _report(self) -> None:
        """Tell the status every few seconds."""
        while not self._ended.wait(STATUS_S):
            if self._connection.connected.is_set():
                self._publish_status(online=True)

    def _publish_status(self, online: bool) -> None:
        self._connection.publish(status_topic(self.name), dumped(self._status(online)), self._status_key, retain=True)

    def _status(self, online: bool) -> Document:
        queue = self.queue.lengths()
        return {
            "version": VERSION, "kind": "status", "name": self.name, "twin": self._run,
            "counter": self._ticket().counter, "online": online, "time_s": round(time.time(), 3),
            "workers": self.config.workers, "busy": self._busy, "queue": sum(queue.values()),
            **self.statistics.document(queue),
        }  # fmt: skip

    def _changed(self) -> None:
        """The connection has come or gone, or cannot be had; told once. Refused from the start: the twin ends."""
        link = self._connection
        connected = link.connected.is_set()
        said = (
            f"connected to the broker at {link.broker}" if connected else f"no broker at {link.broker}: {link.problem}"
        )
        if said != self._said:
            self._said = said
            self._say(said)
        if connected:
            self._was_connected = True
            threading.Thread(target=self._publish_status, args=(True,), daemon=True).start()
        elif link.refused and not self._was_connected:
            self.end()


def _printable(topic: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in topic[:100])
