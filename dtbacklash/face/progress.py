"""Progress in Python: none unless asked for; a bar in a terminal or a notebook's output; or a function of one's own."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TypeAlias

from dtbacklash.errors import UserError

#: False: silent. True: a bar on stderr. A function: called with the share done, 0 to 1, and what is being done
ShowProgress: TypeAlias = bool | Callable[[float, str], object]

Tell: TypeAlias = Callable[[float, str], None]

EVERY_S = 10.0


def cores_of(jobs: int | None) -> int:
    """How many threads share the work; None: one for each core. Raises UserError: no whole number above 0."""
    if jobs is not None and not (isinstance(jobs, int) and jobs > 0):
        raise UserError("jobs", jobs, "must be a whole number above 0")
    return jobs or os.cpu_count() or 1


@contextmanager
def shown(progress: ShowProgress, what: str) -> Iterator[Tell | None]:
    """Give the function to call with the share done and the text of the stage, or None for silence.

    Raises
    ------
    UserError : ``progress`` is neither a truth value nor a function.
    """
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise UserError("progress", progress, "must be True, False or a function of a share and a text")
    if progress is False or progress is None:
        yield None
    elif callable(progress):
        own = progress

        def tell(share: float, text: str) -> None:
            own(share, text)

        yield tell
    else:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TimeRemainingColumn

        console = Console(stderr=True)
        if not (find_spec("ipywidgets") if console.is_jupyter else console.is_terminal):
            yield _lines(what)
            return
        columns = "{task.description}", BarColumn(), "{task.percentage:3.0f} %", TimeRemainingColumn()
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task(what, total=1.0)
            yield lambda share, text: bar.update(task, completed=share, description=text or what)


def _lines(what: str) -> Tell:
    """Lines on stderr, where there is neither a terminal nor a widget: one for each stage, and every ten seconds."""
    last, at = "", -EVERY_S

    def tell(share: float, text: str) -> None:
        nonlocal last, at
        now = time.monotonic()
        if text != last or now - at >= EVERY_S:
            last, at = text, now
            print(f"{what}: {text + ', ' if text else ''}{100 * share:.0f} %", file=sys.stderr, flush=True)

    return tell
