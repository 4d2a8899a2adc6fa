"""How the twins at a broker are: what they say of themselves, checked, and as tables."""

from __future__ import annotations

import threading
import time
from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table

from dtbacklash.config.twin import StatusConfig
from dtbacklash.errors import Failure
from dtbacklash.remote.connection import Connection
from dtbacklash.remote.credentials import STATUS, load_credentials
from dtbacklash.remote.documents import FAULT, SIGNATURE, STATUS_BYTES, TOO_LARGE, Document, Refused, parsed
from dtbacklash.remote.topics import STATUSES, name_in

#: twins that are listened to
TWINS_KEPT = 100


def heard(config: StatusConfig) -> tuple[dict[str, Document], dict[str, int]]:
    """The status of each twin by its name, and how many messages failed a check, by reason.

    Raises
    ------
    UserError : no key, no address. Failure : no broker there, or it refuses.
    """
    credentials = load_credentials(config.credentials, "credentials")
    key = credentials.needed_key("credentials").of_machine(STATUS)
    twins: dict[str, Document] = {}
    rejected: dict[str, int] = {}
    lock = threading.Lock()

    def take(topic: str, payload: bytes, signature: str | None) -> None:
        try:
            if len(payload) > STATUS_BYTES:
                raise Refused(TOO_LARGE)
            if not key.signed(topic, payload, signature):
                raise Refused(SIGNATURE)
            document = parsed(payload, "status", STATUS_BYTES)
        except Exception as error:  # whatever it is: a message must not end the network's thread
            reason = error.reason if isinstance(error, Refused) else FAULT
            with lock:
                rejected[reason] = rejected.get(reason, 0) + 1
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
    """What was heard, for a console: a line and a table a twin."""
    twins, rejected = found
    told: list[Any] = [] if twins else ["no twin has said how it is"]
    for name, one in sorted(twins.items()):
        age_s = max(0.0, time.time() - one.get("time_s", time.time()))
        state = f"[green]online[/], {age_s:.0f} s ago" if one["online"] else "[red]gone[/]"
        work = f"{one['busy']} of {one['workers']} processes busy, {one['queue']} waiting"
        told.append(f"[bold]{escape(name)}[/]: {state}; {work}")
        if one["rejected"]:
            reasons = ", ".join(f"{escape(reason)}: {n}" for reason, n in sorted(one["rejected"].items()))
            told.append(f"  rejected messages: {reasons}")
        if one["machines"]:
            told.append(_table(one["machines"]))
    if rejected:
        told.append("not shown, as it failed a check: " + ", ".join(f"{escape(r)}: {n}" for r, n in rejected.items()))
    return told


def _table(machines: Document) -> Table:
    table = Table(box=box.ASCII2, show_edge=False, pad_edge=False)
    counts = ("requests", "estimates", "accepted", "refused", "dropped", "waiting")
    for head in ("machine", *counts, "last", "gap [deg]", "reason"):
        table.add_column(head.replace("[", r"\["), justify="left" if head in ("machine", "reason") else "right")
    for name, one in sorted(machines.items()):
        last = one.get("last")
        when = time.strftime("%H:%M:%S", time.localtime(last["time_s"])) if last else "-"
        gap = f"{last['gap_deg']:.2f}" if last and last.get("gap_deg") is not None else "-"
        numbers = [str(one[key]) for key in ("requests", "answered", "accepted", "refused", "dropped", "queue")]
        table.add_row(escape(name), *numbers, when, gap, escape(last["reason"]) if last else "-")
    return table
