"""Progress in Python: none unless asked for; a bar in a terminal or a notebook's output; or a function of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

#: False: silent. True: a bar on stderr. A function: called with the share done, 0 to 1, and what is being done
ShowProgress: TypeAlias = bool | Callable[[float, str], object]

Tell: TypeAlias = Callable[[float, str], None]


@contextmanager
def shown(progress: ShowProgress, what: str) -> Iterator[Tell | None]:
    """Give the function to call with the share done and the text of the stage, or None for silence."""
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

        columns = "{task.description}", BarColumn(), "{task.percentage:3.0f} %", TimeRemainingColumn()
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(what, total=1.0)
            yield lambda share, text: bar.update(task, completed=share, description=text or what)
