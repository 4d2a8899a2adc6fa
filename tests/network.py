"""A real Mosquitto on a free port of 127.0.0.1, twins that do as a test says, and a network that is slow and lossy."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from dtbacklash.api.run_files import simulate, write
from dtbacklash.config.compose import compose
from dtbacklash.config.run import RunConfig
from dtbacklash.config.twin import StatusConfig
from dtbacklash.experiment.result import RunResult
from dtbacklash.remote.belief import twin_of
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import Key, load_credentials
from dtbacklash.remote.messages import AnswerMessage, RequestMessage, Ticket
from dtbacklash.remote.protocol import REQUESTS, answer_topic
from dtbacklash.remote.status import heard
from dtbacklash.twin.link.service import Answer
from studies.remote import broker_files, program

#: three changes of the reference with a gap of 40 degrees, of which the controller knows nothing at first
SCENARIO = ("controller=nimc_twin", "profile=constant", "profile.start_deg=40", "duration_s=36",
            "reference.period_s=20", "twin.delay_s=2", "figures=false")  # fmt: skip
MACHINES = ["press", "lathe"]
PATIENCE_S = 60.0


def need_mosquitto() -> None:
    """Skip where the broker is not installed; in CI that is a failure."""
    there = program("mosquitto") and program("mosquitto_passwd")
    if not there and os.environ.get("CI"):
        pytest.fail("Mosquitto is not installed (apt install mosquitto)")
    if not there:
        pytest.skip("Mosquitto is not installed (apt install mosquitto)")


def free_port() -> int:
    """A port of 127.0.0.1 that nobody has."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def wait_for(what: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
    """Wait until something holds; fails where it never does."""
    until = time.monotonic() + patience_s
    while not what():
        assert time.monotonic() < until, "it never came"
        time.sleep(0.02)


class Broker:
    """Mosquitto as docs/remote.md has it; may be stopped and started again."""

    def __init__(self, folder: Path, port: int | None = None, more: str = "", machines: list[str] = MACHINES) -> None:
        need_mosquitto()
        self.port = port or free_port()
        self.folder, self.conf = broker_files(folder, machines, self.port)
        self.conf.write_text(self.conf.read_text() + more)
        self.process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self.port}"

    def start(self) -> Broker:
        self.process = subprocess.Popen(
            [program("mosquitto"), "-c", str(self.conf)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        wait_for(self._answers)
        return self

    def stop(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait(10)
            self.process = None

    def of(self, name: str) -> str:
        """The file of credentials of a user."""
        return str(self.folder / f"{name}.yaml")

    def config(self, *words: str, machine: str = "press", timeout_s: float = 10.0) -> RunConfig:
        """The scenario, other ``words`` in it, with a twin here."""
        there = ("twin=remote", f"twin.broker={self.address}", f"twin.machine={machine}",
                 f"twin.timeout_s={timeout_s}", f"twin.credentials={self.of(machine)}")  # fmt: skip
        return compose(*there, *scenario(*words))

    def _answers(self) -> bool:
        with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 0.2):
            return True
        return False


def status(broker: Broker, wait_s: float = 0.2) -> dict[str, dict[str, Any]]:
    """What the twins at a broker say of themselves."""
    found, rejected = heard(StatusConfig(broker.address, broker.of("monitor"), wait_s=wait_s))
    assert rejected == {}
    return found


def settled_status(broker: Broker, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The twin's status once something holds in it."""
    found: list[dict[str, Any]] = []

    def there() -> bool:
        one = status(broker).get("twin")
        found[:] = [one] if one else []
        return bool(one and holds(one))

    wait_for(there, 20)
    return found[0]


Play = Callable[["Puppet", RequestMessage], None]


class Puppet:
    """A twin with the right key that does with each request what ``play`` says, in a thread of its own."""

    def __init__(self, broker: Broker, play: Play | None = None, address: str = "") -> None:
        self.play = play or Puppet.reply
        self.requests: list[RequestMessage] = []
        self.payloads: list[tuple[str, bytes, str | None]] = []
        self.counter, self.run = 0, os.urandom(16).hex()
        credentials = load_credentials(broker.of("twin"), "credentials")
        self.key: Key = credentials.needed_key("credentials")
        self._threads: list[threading.Thread] = []
        self.connection = Connection(address or broker.address, credentials, [REQUESTS], self._take, "puppet")
        self.connection.open()
        wait_for(self.connection.connected.is_set)
        time.sleep(0.1)  # subscribed

    def _take(self, topic: str, payload: bytes, signature: str | None) -> None:
        message = RequestMessage.parsed(payload)
        self.requests.append(message)
        thread = threading.Thread(target=self.play, args=(self, message), daemon=True)
        self._threads.append(thread)
        thread.start()

    def answer(self, message: RequestMessage) -> Answer:
        """What the twin says."""
        return twin_of(message.belief).answer(message.request)

    def message(self, message: RequestMessage, answer: Answer | None = None, **other: object) -> AnswerMessage:
        """The right answer to a request, or with some of it ``other``."""
        self.counter += 1
        said = {"machine": message.machine, "ticket": Ticket(self.run, self.counter), "to": message.ticket,
                "sha256": message.sha256, "answer": answer or self.answer(message)}  # fmt: skip
        return AnswerMessage(**said | other)  # type: ignore[arg-type]

    def send(self, machine: str, payload: bytes, key: Key | None = None) -> None:
        """Publish what is to look like an answer."""
        topic = answer_topic(machine)
        key = key or self.key.of_machine(machine)
        self.payloads.append((topic, payload, key.sign(topic, payload)))
        self.connection.publish(topic, payload, key)

    def reply(self, message: RequestMessage) -> None:
        """Answer as a twin does."""
        self.send(message.machine, self.message(message).dumped())

    def close(self) -> None:
        for thread in self._threads:
            thread.join(10)
        self.connection.close()


class Served:
    """``dtb twin serve`` as a process."""

    def __init__(self, broker: Broker, *words: str, folder: Path) -> None:
        self.log = folder / f"serve_{time.monotonic_ns()}.log"
        command = [sys.executable, "-m", "dtbacklash.cli", "twin", "serve", f"broker={broker.address}",
                   f"credentials={broker.of('twin')}", *words]  # fmt: skip
        with self.log.open("w") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)

    def ready(self) -> Served:
        wait_for(lambda: "connected to the broker" in self.text() or self.process.poll() is not None, 300)
        assert self.process.poll() is None, self.text()
        return self

    def text(self) -> str:
        return self.log.read_text()

    def end(self) -> int:
        """SIGTERM; its exit code."""
        if self.process.poll() is None:
            self.process.terminate()
        return self.process.wait(20)


def children(pid: int, called: str = "") -> list[int]:
    """The processes that a process has started, with a word in their command (none where there is no /proc)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = int(stat.read_text().rsplit(")", 1)[1].split()[1])
            if parent == pid and called in (stat.parent / "cmdline").read_text():
                found.append(int(stat.parent.name))
    return found


class Proxy:
    """TCP from a client to the broker: late, slow, and cut ``cuts`` times after ``cut_after`` bytes to the broker."""

    def __init__(
        self, broker: Broker, delay_s: float = 0.0, bytes_s: float = 1e9, cut_after: int = 10**12, cuts: int = 0
    ) -> None:
        self.broker, self.delay_s, self.bytes_s, self.cut_after, self.cuts = broker, delay_s, bytes_s, cut_after, cuts
        self.cut = 0
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._closing = False
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self._listener.getsockname()[1]}"

    def _accept(self) -> None:
        while not self._closing:
            try:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self.broker.port), 2.0)
            except OSError:
                return
            self._sockets += [near, far]
            for source, target, counted in ((near, far, True), (far, near, False)):
                threading.Thread(target=self._pump, args=(source, target, counted), daemon=True).start()

    def _pump(self, source: socket.socket, target: socket.socket, counted: bool) -> None:
        passed = 0
        with suppress(OSError):
            while data := source.recv(2048):
                passed += len(data)
                time.sleep(self.delay_s + len(data) / self.bytes_s)
                if counted and passed > self.cut_after and self.cut < self.cuts:
                    self.cut += 1
                    break
                target.sendall(data)
        for one in (source, target):
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._closing = True
        for one in [self._listener, *self._sockets]:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()


def scenario(*words: str) -> list[str]:
    """The words of the scenario, with others in their place or behind them."""
    return list({word.partition("=")[0]: word for word in (*SCENARIO, *words)}.values())


def local(*words: str) -> RunResult:
    """The scenario with a twin in the same process."""
    return simulate(compose(*scenario(*words)), None)


def run(config: RunConfig) -> RunResult:
    """A run as ``dtb run`` has it."""
    return simulate(config, None)


def same(one: RunResult, other: RunResult) -> None:
    """Two runs are the same to the last bit: the trace, and the estimates but for the time they took."""
    pd.testing.assert_frame_equal(one.trace, other.trace, check_exact=True)
    tables = [result.estimates[~result.estimates["reason"].str.startswith("dropped")] for result in (one, other)]
    tables = [table.drop(columns="wall_s").reset_index(drop=True) for table in tables]
    pd.testing.assert_frame_equal(*tables, check_exact=True, check_dtype=False)


def under_control(result: RunResult) -> None:
    """Every move settles, and the gap in force is one that the twin found or the first one."""
    assert result.summary["settles"]
    assert result.trace["q3_mm"].abs().max() < 1.2
    accepted = result.estimates.loc[result.estimates["accepted"], "applied_deg"]
    known = {0.0, *accepted.dropna().round(9)}
    assert set(result.trace["gap_hat_deg"].round(9)) <= known


def told(result: RunResult, folder: Path, *reasons: str) -> None:
    """The estimates' table and the report name the reasons."""
    folder.mkdir(exist_ok=True)
    write(result, folder)
    rows = pd.read_csv(folder / "estimates.csv")["reason"].astype(str)
    page = (folder / "report.html").read_text(encoding="utf-8")
    for reason in reasons:
        assert rows.str.contains(reason, regex=False).any(), (reason, list(rows))
        assert reason in page
