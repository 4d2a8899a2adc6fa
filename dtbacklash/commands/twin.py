"""``dtb twin``: the twin elsewhere. Serve it, ask how it is, start a broker, say who may speak, describe a machine."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dtbacklash.config import words as key_values
from dtbacklash.config.twin import EXAMPLE, PARTS, AccessConfig, BrokerConfig, ServeConfig, StatusConfig
from dtbacklash.errors import UserError


def main(words: Sequence[str]) -> int:
    """Run ``dtb twin``; returns the exit code."""
    asks = any(word in ("-h", "--help", "help") for word in words)
    if not words or (asks and words[0] not in PARTS):
        print(usage())
        return 0
    name, *rest = words
    if name not in PARTS:
        raise UserError("twin", name, "choose one of " + ", ".join(PARTS))
    part = PARTS[name]
    if asks:
        print(help_of(name))
        return 0
    return DOES[name](rest if part.schema is None else key_values.read(part.schema, rest))


def usage() -> str:
    """The text of ``dtb twin --help``."""
    lines = ["usage: dtb twin <part> [key=value ...]", "", "The digital twin as a process of its own, over MQTT 5.", ""]
    lines += [f"  {name:<10} {part.about.splitlines()[0]}" for name, part in PARTS.items()]
    lines += ["", "dtb twin <part> --help lists its settings. In three terminals:", *(f"  {line}" for line in EXAMPLE)]
    return "\n".join(lines)


def help_of(name: str) -> str:
    """The text of ``dtb twin <part> --help``."""
    part = PARTS[name]
    settings = [] if part.schema is None else ["", "settings (key=default) [unit]:", *key_values.rows(part.schema)]
    return "\n".join([f"usage: dtb twin {name} [key=value ...]", "", part.about, *settings])


def _serve(config: ServeConfig) -> int:
    from dtbacklash.commands.console import announce_compilation
    from dtbacklash.config.compose import compose
    from dtbacklash.remote.belief import described
    from dtbacklash.remote.server import TwinServer
    from dtbacklash.remote.statistics import serve_metrics

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    server = TwinServer(config, say)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: server.end())
    announce_compilation()
    with serve_metrics(server.statistics, server.queue.lengths, config.metrics_port):
        say(f"twin {config.name}: {config.workers} process{'es' * (config.workers > 1)}, broker {config.broker}")
        server.run(described(compose()))
    if server.refused:
        raise UserError("credentials", config.credentials, f"the broker at {config.broker} refuses: {server.refused}")
    say(f"twin {config.name}: ended")
    return 0


def _status(config: StatusConfig) -> int:
    from dtbacklash.commands.console import stdout_console
    from dtbacklash.remote.status import heard, lines

    console = stdout_console()
    for line in lines(heard(config)):
        console.print(line, soft_wrap=True)
    return 0


def _broker(config: BrokerConfig) -> int:
    from dtbacklash.remote.broker import run

    return run(config, lambda line: print(line, file=sys.stderr, flush=True))


def _access(config: AccessConfig) -> int:
    from dtbacklash.commands.console import shown_path
    from dtbacklash.remote.access import write

    for path, what in write(Path(config.out), config.machines):
        print(f"{shown_path(path)}: {what}")
    return 0


def _describe(words: list[str]) -> int:
    import json

    from dtbacklash.config.compose import compose
    from dtbacklash.remote.belief import described

    print(json.dumps(described(compose(*words)), indent=1))
    return 0


#: what does each part; `describe` gets the words themselves
DOES: dict[str, Callable[[Any], int]] = {
    "serve": _serve, "status": _status, "broker": _broker, "access": _access, "describe": _describe,
}  # fmt: skip
