"""``dtb twin``: the twin elsewhere. Serve it, ask how it is, describe a machine."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

from dtbacklash.commands.help import of_command
from dtbacklash.config.twin import PARTS, ServeConfig, StatusConfig, read
from dtbacklash.errors import UserError


def main(words: Sequence[str]) -> int:
    """Run ``dtb twin``; returns the exit code."""
    if not words:
        print(of_command("twin", ["--help"]))
        return 0
    name, *rest = words
    if name not in PARTS:
        raise UserError("twin", name, "choose one of " + ", ".join(PARTS))
    schema = PARTS[name].schema
    return DOES[name](rest if schema is None else read(schema, rest))


def _serve(config: ServeConfig) -> int:
    from dtbacklash.config.compose import compose
    from dtbacklash.remote.belief import described
    from dtbacklash.remote.server import TwinServer

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    server = TwinServer(config, say)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: server.end())
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


def _describe(words: list[str]) -> int:
    import json

    from dtbacklash.config.compose import compose
    from dtbacklash.remote.belief import described

    print(json.dumps(described(compose(*words)), indent=1))
    return 0


#: what does each part; `describe` gets the words themselves
DOES: dict[str, Callable[[Any], int]] = {"serve": _serve, "status": _status, "describe": _describe}
