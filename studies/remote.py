"""Machines on one twin, over a real broker: estimates a second, delays, and what happens beyond capacity.

Broker, twin (``dtb twin serve workers=N``) and machines share this computer. The machines send the nine buffers of the
paper's Figure 13; each client is the one that ``dtb run twin=remote`` has.
"""

from __future__ import annotations

import getpass
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dtbacklash.config.compose import compose
from dtbacklash.config.run import TwinConfig
from dtbacklash.experiment.run import run_scenario
from dtbacklash.files import write_text
from dtbacklash.remote.belief import described, twin_of
from dtbacklash.remote.client import RemoteTwin
from dtbacklash.remote.protocol import Document
from dtbacklash.report.components.markdown import between, table
from dtbacklash.twin.link.service import LocalTwin, Request
from studies.measure import Row

MACHINES, WORKERS = (1, 10, 50), 2
#: of a row; the paper's reference changes every 20 s
SECONDS, PERIOD_S = 15.0, 20.0
BEGIN, END = "<!-- remote: begin, made by python -m studies remote -->", "<!-- remote: end -->"
HEADS = ("machines", "they ask", "requests/s", "estimates/s", "median delay", "99 %", "dropped")


@dataclass
class _Listening(LocalTwin):
    """A twin of the run's own that keeps what it is asked."""

    requests: list[Request] = field(default_factory=list)

    def ask(self, request: Request) -> None:
        self.requests.append(request)
        super().ask(request)


def buffers() -> tuple[Document, list[Request]]:
    """What the twin has to know in Figure 13, and the nine requests of its run."""
    config = compose("experiment=fig13", "figures=false")
    belief = described(config)
    listening = _Listening(twin_of(belief))
    run_scenario(config, service=listening)
    return belief, listening.requests


def program(name: str) -> str:
    """The path of one of Mosquitto's programs, which Debian puts where not everybody looks; "" if it is not there."""
    return shutil.which(name, path=os.environ["PATH"] + ":/usr/sbin:/usr/local/sbin:/opt/homebrew/sbin") or ""


def broker_files(scratch: Path, names: list[str], port: int) -> tuple[Path, Path]:
    """What docs/remote.md has a user write for these machines, in ``scratch``: folder of credentials, configuration."""
    page = (Path(__file__).parents[1] / "docs" / "remote.md").read_text(encoding="utf-8")
    conf, acl, access = re.findall(r"```(?:conf|python)\n(.*?)```", page, re.DOTALL)
    subprocess.run([sys.executable, "-c", access, *names], cwd=scratch, check=True)
    folder = scratch / "twin_access"
    subprocess.run([program("mosquitto_passwd"), "-U", str(folder / "passwords")], check=True)
    (folder / "acl").write_text(acl)
    conf = conf.replace("1883", str(port)).replace("twin_access", str(folder))
    (scratch / "mosquitto.conf").write_text(f"{conf}user {getpass.getuser()}\n")
    return folder, scratch / "mosquitto.conf"


@contextmanager
def twin(names: list[str]) -> Iterator[tuple[str, Path]]:
    """A broker and a twin for these machines: address, folder of credentials."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory() as scratch:
        folder, conf = broker_files(Path(scratch), names, port)
        log = Path(scratch) / "serve.log"
        started = [subprocess.Popen([program("mosquitto"), "-c", str(conf)], stderr=subprocess.DEVNULL)]
        try:
            words = [f"broker=127.0.0.1:{port}", f"credentials={folder / 'twin.yaml'}", f"workers={WORKERS}"]
            with log.open("w") as out:
                command = [sys.executable, "-m", "dtbacklash.cli", "twin", "serve", *words]
                started.append(subprocess.Popen(command, stderr=out))
            until = time.monotonic() + 300.0
            while "connected" not in log.read_text():
                if time.monotonic() > until or started[-1].poll() is not None:
                    raise RuntimeError(f"the twin does not start: {log.read_text()}")
                time.sleep(0.1)
            yield f"127.0.0.1:{port}", folder
        finally:
            for process in reversed(started):
                process.terminate()
                with suppress(subprocess.TimeoutExpired):
                    process.wait(20)


def remote_rows() -> list[Row]:
    """A row a number of machines and way of asking."""
    belief, requests = buffers()
    names = [f"machine_{j:02}" for j in range(max(MACHINES))]
    rows: list[Row] = []
    with twin(names) as (broker, folder):
        settings = replace(compose("twin=remote").twin, broker=broker, timeout_s=30.0)
        clients = [_client(settings, name, folder, belief) for name in names]
        try:
            _asked(clients[:WORKERS], requests, 2.0, 0.0)  # each worker has seen the belief
            for count in MACHINES:
                rows.append(_asked(clients[:count], requests, SECONDS, 0.0) | {"they ask": "when answered"})
            capacity = max(row["estimates/s"] for row in rows)
            rows.append(_asked(clients, requests, SECONDS + 5.0, PERIOD_S) | {"they ask": f"every {PERIOD_S:g} s"})
            period_s = len(clients) / (2.0 * capacity)
            rows.append(_asked(clients, requests, SECONDS, period_s) | {"they ask": "twice the capacity"})
        finally:
            for client in clients:
                client.close()
    return [
        {"what": f"{row['machines']} machine{'s' * (row['machines'] > 1)}, {row['they ask']}", **row} for row in rows
    ]


def _client(settings: TwinConfig, name: str, folder: Path, belief: Document) -> RemoteTwin:
    settings = replace(settings, machine=name, credentials=str(folder / f"{name}.yaml"))
    client = RemoteTwin(settings, belief, waits=False)
    client.warm_up()
    return client


def _asked(clients: list[RemoteTwin], requests: list[Request], seconds: float, period_s: float) -> Row:
    """Have the clients ask for so long: again when answered (``period_s`` 0), or each once a period, spread over it."""
    answered: list[float] = []
    reasons: list[str] = []
    asked: list[dict[int, float]] = [{} for _ in clients]
    began = time.monotonic()
    due = [began + period_s * j / len(clients) for j in range(len(clients))]
    events = [0] * len(clients)
    stop = began + seconds
    while (now := time.monotonic()) < stop or any(asked):
        for j, client in enumerate(clients):
            for reply in client.replies():
                since = asked[j].pop(reply.request.event, None)
                if since is None:
                    continue
                if reply.answer is None:
                    reasons.append(reply.reason)
                else:
                    answered.append(time.monotonic() - since)
            ready = now >= due[j] if period_s else not asked[j]
            if now < stop and ready:
                due[j] += period_s
                events[j] += 1
                event = int(began) * 10_000 + events[j]
                asked[j][event] = now
                client.ask(replace(requests[(events[j] + j) % len(requests)], event=event))
        if now > stop + 40.0:
            raise RuntimeError(f"no answer to {sum(map(len, asked))} requests")
        time.sleep(0.001)
    took_s = seconds if period_s else time.monotonic() - began
    total = len(answered) + len(reasons)
    busy = sum("busy" in reason for reason in reasons)
    if busy < len(reasons):
        raise RuntimeError(f"requests without an answer: {set(reasons)}")
    return {
        "machines": len(clients), "requests/s": total / took_s, "estimates/s": len(answered) / took_s,
        "median delay": float(np.median(answered)), "99 %": float(np.quantile(answered, 0.99)),
        "dropped": busy / total,
    }  # fmt: skip


def write_docs(rows: list[Row], docs: Path) -> None:
    """Bring the rows into ``remote.md``."""
    shown = [
        [
            str(row["machines"]), row["they ask"], f"{row['requests/s']:.1f}", f"{row['estimates/s']:.1f}",
            f"{1e3 * row['median delay']:.0f} ms", f"{1e3 * row['99 %']:.0f} ms", f"{row['dropped']:.0%}",
        ]
        for row in rows
    ]  # fmt: skip
    page = docs / "remote.md"
    write_text(page, between(page.read_text(encoding="utf-8"), BEGIN, END, table(HEADS, shown)))
