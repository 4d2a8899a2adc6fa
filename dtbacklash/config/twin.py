"""The settings of the parts of ``dtb twin``, and the words ``key=value`` that set them: Hydra does not compose them."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from dtbacklash.config.setting import INPUT, Declared, check, declared, setting
from dtbacklash.errors import UserError

Config = TypeVar("Config")

BROKER = "127.0.0.1:1883"


@dataclass
class ServeConfig:
    """The twin as a process of its own."""

    broker: str = setting(BROKER, "where the MQTT broker is, host:port")
    credentials: str | None = setting(
        None, "file of mode 600 with user, password and the twin's key; null: from the environment", path=INPUT
    )
    name: str = setting("twin", "name of this twin, for its status")
    workers: int = setting(1, "processes that estimate", at_least=1, at_most=1000)
    queue: int = setting(2, "requests of a machine that may wait; the oldest is dropped", at_least=1, at_most=1000)

    def __post_init__(self) -> None:
        check(self)


@dataclass
class StatusConfig:
    """The state of the twins."""

    broker: str = setting(BROKER, "where the MQTT broker is, host:port")
    credentials: str | None = setting(
        None, "file of mode 600 with user, password and the key; null: from the environment", path=INPUT
    )
    wait_s: float = setting(1.0, "how long to listen", above=0, at_most=600)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Part:
    """One word behind ``dtb twin``: its settings (None: the words of ``dtb run``), and what it is."""

    schema: type | None
    about: str


#: the paper's Figure 13 in three terminals
EXAMPLE = (
    "mosquitto -c mosquitto.conf",
    "dtb twin serve credentials=twin_access/twin.yaml",
    "dtb run experiment=fig13 twin=remote twin.credentials=twin_access/machine.yaml",
)
PARTS = {
    "serve": Part(
        ServeConfig, "answer the requests of machines, until Ctrl-C\n"
        "Takes buffers off an MQTT broker, estimates on a pool of processes, the machines in turn, and answers.\n"
        "Prints a line for each request on stderr."
    ),
    "status": Part(StatusConfig, "print the state of the twins: machines, last estimates, rejected messages, queue"),
    "describe": Part(
        None, "print what a twin has to know of a machine, for other clients; takes the settings of dtb run"
    ),
}  # fmt: skip


def read(schema: type[Config], words: Sequence[str]) -> Config:
    """The settings in ``words``, checked.

    Raises UserError: an unknown key, one given twice, a value of the wrong kind or out of range.
    """
    known = {one.key: one for one in declared(schema)}
    given: dict[str, Any] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise UserError("argument", word, "write key=value")
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.6)
            meant = f"did you mean {near[0]}?" if near else "choose one of " + ", ".join(known)
            raise UserError(key, value, f"no such setting; {meant}")
        if key in given:
            raise UserError(key, value, "is given twice")
        given[key] = _value(known[key], value)
    return schema(**given)


def _value(one: Declared, text: str) -> Any:
    if text in ("", "null"):
        if one.default is None:
            return None
        raise UserError(one.key, text, "needs a value")
    kind = one.plain_kind
    if kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            raise UserError(one.key, text, "must be a whole number" if kind is int else "must be a number") from None
    return text
