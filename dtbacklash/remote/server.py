"""The twin as a process of its own: takes the requests of all machines off the broker, and answers them.

The network's thread checks the messages, a fair queue holds them, a pool of processes estimates, and the threads of the
pool send the answers. Nothing here grows without a bound.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from queue import Full, Queue

from dtbacklash.config.twin import ServeConfig
from dtbacklash.errors import UserError
from dtbacklash.remote import protocol
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import STATUS, load_credentials
from dtbacklash.remote.messages import AnswerMessage, RequestMessage, Ticket, claimed_ticket, digest
from dtbacklash.remote.status import Statistics
from dtbacklash.remote.workers import FairQueue, Processes, Result
from dtbacklash.twin.link.service import Answer

BUSY, OVERDUE = "dropped: the twin is busy", "dropped: the machine has stopped waiting"
#: machines that may wait at a time, runs of machines that are remembered
MACHINES_WAITING, RUNS_KEPT = 1000, 4000
#: seconds between two looks whether to end, and between two statuses
LOOK_S, STATUS_S = 0.2, 2.0
#: after this the broker says of a twin that is gone that nobody listens, and machines ask again
KEPT_S = 10
#: lines for a person that may wait; seconds in which they are told at the end
LINES, CLOSE_S = 1000, 1.0

Say = Callable[[str], None]


class Teller:
    """Calls ``say`` with each line, in order, from a thread of its own.

    A terminal that blocks, or is gone, stops no other thread: lines beyond ``LINES`` are dropped, and errors ignored.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._lines: Queue[str | None] = Queue(LINES)
        self._thread = threading.Thread(target=self._tell, name="teller", daemon=True)
        self._thread.start()

    def __call__(self, line: str) -> None:
        """Take a line; returns at once."""
        with suppress(Full):
            self._lines.put_nowait(line)

    def close(self) -> None:
        """Tell what is left, for a second at most."""
        with suppress(Full):
            self._lines.put_nowait(None)
        self._thread.join(CLOSE_S)

    def _tell(self) -> None:
        while (line := self._lines.get()) is not None:
            with suppress(OSError, ValueError):  # a broken pipe, a closed file
                self._say(line)


@dataclass(frozen=True)
class _Waiting:
    """A request that waits since ``since``."""

    message: RequestMessage
    since: float


class TwinServer:
    """The twin at the broker.

    config : of ``dtb twin serve``. say : gets a line for each request.

    Raises UserError: no key, or that of one machine only; no address; the extra is not installed.
    """

    def __init__(self, config: ServeConfig, say: Say = lambda line: None) -> None:
        self.config, self._say = config, Teller(say)
        self.name = protocol.check_name("name", config.name)
        credentials = load_credentials(config.credentials, "credentials")
        self._key = credentials.needed_key("credentials")
        if self._key.machine is not None:
            allowed = f"its key is that of {self._key.machine}; the twin needs its own"
            raise UserError("credentials", config.credentials, allowed)
        self._status_key = self._key.of_machine(STATUS)
        self._run, self._counter = secrets.token_hex(16), 0
        self._lock = threading.Lock()  # of the counters, which several threads use
        self.statistics = Statistics()
        self.queue: FairQueue[_Waiting] = FairQueue(config.queue, MACHINES_WAITING)
        self._runs = protocol.Counters(RUNS_KEPT)
        self._workers: Processes | None = None
        self._free = threading.Semaphore(config.workers)
        self._busy = 0
        self._ended = threading.Event()
        topic, will = protocol.status_topic(self.name), protocol.dumped(self._status(online=False))
        self._connection = Connection(
            config.broker, credentials, [protocol.REQUESTS], self._take, f"twin-{self.name}",
            will=(topic, will, self._status_key.sign(topic, will)), changed=self._changed, kept_s=KEPT_S,
        )  # fmt: skip
        self._was_connected, self._said = False, ""

    def run(self, belief: protocol.Document) -> None:
        """Serve until :meth:`end`; ``belief`` : of any machine, to load what estimates need."""
        self._workers = Processes(self.config.workers)
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
        """Make :meth:`run` return; may be called from a handler of signals."""
        self._ended.set()

    @property
    def refused(self) -> str:
        """Why the broker refuses this twin; empty where it does not."""
        return self._connection.problem if self._connection.refused else ""

    # --- in: the network's thread

    def _take(self, topic: str, payload: bytes, signature: str | None) -> None:
        sender: str | None = None
        try:
            sender = self._sender(topic, payload, signature)
            message = self._checked(sender, payload)
        except Exception as error:  # whatever it is: a message must not end the network's thread
            refused = protocol.Rejected.of(error)
            self.statistics.reject(refused.reason)
            printable = "".join(letter if letter.isprintable() else "?" for letter in topic[:100])
            self._say(f"{printable}: a message is dropped: {refused}")
            if sender is not None and refused.reason in (protocol.MALFORMED, protocol.OTHER_VERSION):
                self._send(sender, claimed_ticket(payload), digest(payload), None, str(refused))
            return
        self.statistics.count(message.machine, "requests")
        dropped = self.queue.put(message.machine, _Waiting(message, time.monotonic()))
        if dropped is not None:
            self._refuse(dropped.message, BUSY, dropped=True)

    def _sender(self, topic: str, payload: bytes, signature: str | None) -> str:
        """The machine that has signed a message; raises Rejected."""
        machine = protocol.name_in(topic)
        if not protocol.NAME.fullmatch(machine):
            raise protocol.Rejected(protocol.MALFORMED, "the name of the machine")
        protocol.check_origin("request", self._key.of_machine(machine), topic, payload, signature)
        return machine

    def _checked(self, machine: str, payload: bytes) -> RequestMessage:
        """The request in a message of a machine that passes all checks; raises Rejected."""
        message = RequestMessage.parsed(payload)
        if message.machine != machine:
            raise protocol.Rejected(protocol.MALFORMED, f"of machine {message.machine}")
        self._runs.advance((machine, message.ticket.run), message.ticket.counter)
        return message

    # --- work

    def _dispatch(self, workers: Processes) -> None:
        """Give each request to a worker as soon as one is free."""
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
            verdict = "accepted" if result.accepted else "rejected"
            line = f"{verdict}, {result.chosen.verdict.reason} ({1e3 * delay_s:.0f} ms)"
            self._answer(message, result, line)

        return done

    # --- out

    def _refuse(self, message: RequestMessage, reason: str, dropped: bool = False) -> None:
        self.statistics.count(message.machine, "refused", *["dropped"] * dropped)
        self._answer(message, reason, reason)

    def _answer(self, message: RequestMessage, result: Result, line: str) -> None:
        """Send the answer to a request, or the reason why there is none, and tell a line about it."""
        answer, reason = (None, result) if isinstance(result, str) else (result, "")
        self._send(message.machine, message.ticket, message.sha256, answer, reason)
        self._say(f"{message.machine} request {message.ticket.counter}: {line}")

    def _send(self, machine: str, to: Ticket, sha256: str, answer: Answer | None, reason: str) -> None:
        out = AnswerMessage(machine, self._ticket(), to, sha256, answer, reason)
        self._connection.publish(
            protocol.answer_topic(machine), out.dumped(), self._key.of_machine(machine), expires_s=600
        )

    def _ticket(self) -> Ticket:
        with self._lock:
            self._counter += 1
            return Ticket(self._run, self._counter)

    def _report(self) -> None:
        """Publish the status every few seconds."""
        while not self._ended.wait(STATUS_S):
            if self._connection.connected.is_set():
                self._publish_status(online=True)

    def _publish_status(self, online: bool) -> None:
        self._connection.publish(
            protocol.status_topic(self.name), protocol.dumped(self._status(online)), self._status_key, retain=True
        )

    def _status(self, online: bool) -> protocol.Document:
        queue = self.queue.lengths()
        return {
            "version": protocol.VERSION, "kind": "status", "name": self.name, "twin": self._run,
            "counter": self._ticket().counter, "online": online, "time_s": round(time.time(), 3),
            "workers": self.config.workers, "busy": self._busy, "queue": sum(queue.values()),
            **self.statistics.document(queue),
        }  # fmt: skip

    def _changed(self) -> None:
        """Tell once that the connection has come or gone; end where the broker refuses this twin from the start."""
        link = self._connection
        connected = link.connected.is_set()
        there, gone = f"connected to the broker at {link.broker}", f"no broker at {link.broker}: {link.problem}"
        said = there if connected else gone
        if said != self._said:
            self._said = said
            self._say(said)
        if connected:
            self._was_connected = True
            threading.Thread(target=self._publish_status, args=(True,), daemon=True).start()
        elif link.refused and not self._was_connected:
            self.end()
