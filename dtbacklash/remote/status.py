"""How the twins at a broker are: what they say of themselves, checked, and as tables."""

from __future__ import annotations

import threading
import time
from collections import Counter
from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table

from dtbacklash.config.twin import StatusConfig
from dtbacklash.errors import Failure
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import STATUS, load_credentials
from dtbacklash.remote.protocol import STATUSES, Document, Refused, check_origin, name_in, parsed
from dtbacklash.remote.statistics import COUNTS

#: twins that are listened to at most
TWINS_KEPT = 100
#: counts that the table names otherwise than a status does
HEADS = {"answered": "estimates", "queue": "waiting"}


def heard(config: StatusConfig) -> tuple[dict[str, Document], dict[str, int]]:
    """The status of each twin by its name, and how many messages failed a check, by reason.

    Raises
    ------
    UserError : no key, no address. Failure : no broker there, or it refuses.
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
                rejected[Refused.of(error).reason] += 1
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
