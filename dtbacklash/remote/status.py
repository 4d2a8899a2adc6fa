"""How a twin is: what it counts and says of itself, and what is heard of it, checked, and as tables."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, OrderedDict
from dataclasses import dataclass, field
from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table

from dtbacklash.config.twin import StatusConfig
from dtbacklash.errors import Failure
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import STATUS, load_credentials
from dtbacklash.remote.protocol import STATUSES, Document, Rejected, check_origin, name_in, parsed
from dtbacklash.twin.link.service import Answer

#: what is counted of each machine: requests that passed all checks, estimates sent, those of them that the guard
#: accepted, requests without an estimate, those of them for want of time
COUNTS = ("requests", "answered", "accepted", "refused", "dropped")
#: machines that are remembered; the one that has been silent for longest is forgotten
MACHINES_KEPT = 2000
#: twins that are listened to at most
TWINS_KEPT = 100
#: counts that the table names otherwise than a status does
HEADS = {"answered": "estimates", "queue": "waiting"}


@dataclass
class Statistics:
    """Counts of all machines, behind one lock.

    counts : by machine, by the names of ``COUNTS``. last : of each machine, what its last estimate said.
    rejected : messages that failed a check, by reason.
    """

    counts: OrderedDict[str, Counter[str]] = field(default_factory=OrderedDict)
    last: dict[str, dict[str, Any]] = field(default_factory=dict)
    rejected: Counter[str] = field(default_factory=Counter)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def count(self, machine: str, *names: str) -> None:
        """Add one to some counts of a machine, whose turn to be forgotten is the last again."""
        with self._lock:
            self.counts.setdefault(machine, Counter()).update(names)
            self.counts.move_to_end(machine)
            if len(self.counts) > MACHINES_KEPT:
                self.last.pop(self.counts.popitem(last=False)[0], None)

    def reject(self, reason: str) -> None:
        """Count a message that has failed a check."""
        with self._lock:
            self.rejected[reason] += 1

    def answer(self, machine: str, answer: Answer, delay_s: float) -> None:
        """Count an estimate that has been sent ``delay_s`` after its request came."""
        self.count(machine, "answered", *["accepted"] * answer.accepted)
        gap = answer.gap_rad if answer.accepted else answer.chosen.estimate.gap_rad
        last = {
            "time_s": round(time.time(), 3), "gap_deg": math.degrees(gap) if math.isfinite(gap) else None,
            "accepted": bool(answer.accepted), "reason": answer.chosen.verdict.reason[:500],
            "delay_s": round(delay_s, 6),
        }  # fmt: skip
        with self._lock:
            if machine in self.counts:
                self.last[machine] = last

    def document(self, queue: dict[str, int]) -> dict[str, Any]:
        """``rejected`` and ``machines`` of a status; ``queue`` : how many requests of each machine wait."""
        with self._lock:
            machines: dict[str, dict[str, Any]] = {
                name: {count: counts[count] for count in COUNTS} | {"queue": queue.get(name, 0)}
                for name, counts in self.counts.items()
            }
            for name, last in self.last.items():
                machines[name]["last"] = last
            return {"rejected": dict(self.rejected), "machines": machines}


def heard(config: StatusConfig) -> tuple[dict[str, Document], dict[str, int]]:
    """The status of each twin by its name, and how many messages failed a check, by reason.

    Raises UserError: no key, no address. Failure: no broker there, or it refuses.
    """
    credentials = load_credentials(config.credentials, "credentials")
    key = credentials.needed_key("credentials").of_machine(STATUS)
    twins: dict[str, Document] = {}
    rejected: Counter[str] = Counter()
    lock = threading.Lock()

    def take(topic: str, payload: bytes, signature: str | None) -> None:
        try:
            check_origin("status", key, topic, payload, signature)
            document = parsed(payload, "status")
        except Exception as error:  # whatever it is: a message must not end the network's thread
            with lock:
                rejected[Rejected.of(error).reason] += 1
            return
        with lock:
            if document["name"] == name_in(topic) and (document["name"] in twins or len(twins) < TWINS_KEPT):
                twins[document["name"]] = document

    connection = Connection(config.broker, credentials, [STATUSES], take, "monitor", retained=True)
    connection.open()
    try:
        connection.answered.wait(max(config.wait_s, 5.0))
        if not connection.connected.wait(0.5):
            raise Failure("broker", config.broker, connection.problem or "no answer")
        time.sleep(config.wait_s)
    finally:
        connection.close()
    with lock:
        return dict(twins), dict(rejected)


def lines(found: tuple[dict[str, Document], dict[str, int]]) -> list[Any]:
    """What was heard, for a console: a line and a table for each twin."""
    twins, rejected = found
    told: list[Any] = [] if twins else ["no twin has said how it is"]
    for name, one in sorted(twins.items()):
        age_s = max(0.0, time.time() - one.get("time_s", time.time()))
        state = f"[green]online[/], {age_s:.0f} s ago" if one["online"] else "[red]gone[/]"
        work = f"{one['busy']} of {one['workers']} processes busy, {one['queue']} waiting"
        told.append(f"[bold]{escape(name)}[/]: {state}; {work}")
        if one["rejected"]:
            told.append(f"  rejected messages: {_counted(one['rejected'])}")
        if one["machines"]:
            told.append(_table(one["machines"]))
    if rejected:
        told.append(f"not shown, as it failed a check: {_counted(rejected)}")
    return told


def _counted(reasons: dict[str, int]) -> str:
    return ", ".join(f"{escape(reason)}: {n}" for reason, n in sorted(reasons.items()))


def _table(machines: Document) -> Table:
    table = Table(box=box.ASCII2, show_edge=False, pad_edge=False)
    counts = [*COUNTS, "queue"]
    for head in ("machine", *(HEADS.get(count, count) for count in counts), "last", r"gap \[deg]", "reason"):
        table.add_column(head, justify="left" if head in ("machine", "reason") else "right")
    for name, one in sorted(machines.items()):
        row, last = [escape(name), *(str(one[count]) for count in counts)], one.get("last")
        if last is None:
            table.add_row(*row, "-", "-", "-")
            continue
        gap = last.get("gap_deg")
        when = time.strftime("%H:%M:%S", time.localtime(last["time_s"]))
        table.add_row(*row, when, "-" if gap is None else f"{gap:.2f}", escape(last["reason"]))
    return table
