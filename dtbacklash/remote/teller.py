"""Lines for a person from threads that must not wait: a terminal that stands still, or is gone, stops no work."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import suppress

#: lines that wait to be told, at most; further ones are dropped
LINES = 1000
CLOSE_S = 1.0


class Teller:
    """Calls ``say`` with each line, in order, from a thread of its own; what goes wrong there is nobody's affair."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._lines: queue.Queue[str | None] = queue.Queue(LINES)
        self._thread = threading.Thread(target=self._tell, name="teller", daemon=True)
        self._thread.start()

    def __call__(self, line: str) -> None:
        """Take a line; returns at once."""
        with suppress(queue.Full):
            self._lines.put_nowait(line)

    def close(self) -> None:
        """Tell what is left, for a second at most."""
        with suppress(queue.Full):
            self._lines.put_nowait(None)
        self._thread.join(CLOSE_S)

    def _tell(self) -> None:
        while (line := self._lines.get()) is not None:
            with suppress(OSError, ValueError):  # a broken pipe, a closed file
                self._say(line)
