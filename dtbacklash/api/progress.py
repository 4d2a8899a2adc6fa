"""Progress: a bar in a terminal or a notebook's output, lines elsewhere; in Python none unless it is asked for."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Protocol, TypeAlias

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TimeElapsedColumn
from rich.text import Text

from dtbacklash.campaign.progress import SO_FAR, duration
from dtbacklash.errors import UserError

#: False: silent. True: a bar on stderr. A function: called with the share done, 0 to 1, and what is being done
ShowProgress: TypeAlias = bool | Callable[[float, str], object]
#: seconds that are left, as far as they are known
Left: TypeAlias = Callable[[], float | None]

PATIENCE_S = 2.0  # what is quicker needs no progress bar
LINE_EVERY_S, SAME_EVERY_S = 10.0, 60.0  # outside of a terminal: of something new, and of nothing new
KNOWN_SHARE = 0.05  # with less done nobody knows how long the rest takes
WITHIN = 2.0  # a time left is said where it is known within this factor
WIDTH_OF_BAR = 20

log = logging.getLogger("dtbacklash.progress")


class Tell(Protocol):
    """Takes the share done, 0 to 1, what is being done now, and the seconds left where the share says nothing of them.

    Work without ``left`` is even: the same share takes the same time.
    """

    def __call__(self, share: float, text: str = "", left: Left | None = None) -> None: ...


class Remaining(ProgressColumn):
    """Column with the time left, if the work itself or the pace until now determines it within a factor of two."""

    def __init__(self) -> None:
        super().__init__()
        self._begun = time.monotonic()
        self._told: list[tuple[float, float]] = []
        self._left: Left | None = None

    def told(self, share: float, left: Left | None = None) -> None:
        """Take the share done, and a function that returns the time left."""
        self._left = left
        self._told.append((time.monotonic() - self._begun, share))

    def seconds(self) -> float | None:
        """Return the time left, s; None if it is not known."""
        return self._left() if self._left else self._by_pace()

    def _by_pace(self) -> float | None:
        """As long as all of it took, where the second half of what is done was neither much quicker nor slower."""
        at, share = self._told[-1] if self._told else (0.0, 0.0)
        if not KNOWN_SHARE < share < 1.0 or at < PATIENCE_S:
            return None
        half = next((told for told in self._told if told[1] >= share / 2.0), (0.0, 0.0))
        pace, lately = at / share, (at - half[0]) / max(share - half[1], 1e-9) if half[1] < share else at / share
        left = pace * (1.0 - share) - (time.monotonic() - self._begun - at)
        return left if left > 0.0 and 1.0 / WITHIN <= lately / pace <= WITHIN else None

    def __str__(self) -> str:
        left = self.seconds()
        return "" if left is None else f"about {duration(left)} left"

    def render(self, task: Task) -> Text:
        """The same in a bar."""
        return Text(str(self))


class _Work:
    """Some work, as far as has been told of it."""

    def __init__(self, what: str) -> None:
        self.what, self.text, self.share, self.known, self.step = what, "", 0.0, "", ""
        self.begun, self.remaining = time.monotonic(), Remaining()
        self.verbose = log.isEnabledFor(logging.INFO)

    def tell(self, share: float, text: str = "", left: Left | None = None) -> None:
        """As :class:`Tell`; what is new of what is known is said at once, with ``-v`` each step as well."""
        self.share, (self.text, _, known) = share, text.partition(SO_FAR)
        self.remaining.told(share, left)
        if known and known != self.known and not self.verbose:
            self.known = known
            _print(f"after {duration(time.monotonic() - self.begun)}: {known}")
        step = "; ".join(filter(None, (self.text, known))) or f"{self.what}: {10 * int(10 * share)} %"
        if self.verbose and step != self.step:
            self.step = step
            log.info("%3.0f %%  %s", 100 * share, step if self.text else self.what)

    def say_now_and_then(self, ended: threading.Event) -> None:
        """Lines on stderr until it has ended: of something new after ten seconds, of the same after a minute."""
        last, at = "", time.monotonic()
        while not ended.wait(LINE_EVERY_S):
            doing, now = str(self), time.monotonic()
            if doing != last or now - at >= SAME_EVERY_S:
                last, at = doing, now
                gone = f"{100 * self.share:.0f} %, {duration(now - self.begun)} gone"
                _print(", ".join(filter(None, (doing, gone, str(self.remaining)))))

    def __str__(self) -> str:
        return f"{self.what}: {self.text}" if self.text else self.what


def _print(line: str) -> None:
    print(f"dtb: {line}", file=sys.stderr, flush=True)


class _Doing(ProgressColumn):
    """What is being done, in a bar; it looks at the work's share as well."""

    max_refresh = 0.5

    def __init__(self, work: _Work) -> None:
        super().__init__()
        self._work = work

    def render(self, task: Task) -> Text:
        task.completed = self._work.share
        return Text(str(self._work))


@contextmanager
def progress(what: str) -> Iterator[Tell]:
    """Give a function of the share done and of what is being done.

    In a terminal, or a notebook with widgets, a bar appears after 2 s, by itself: what is silent for long is seen to
    work. Elsewhere, as in a log, a line after 10 s of something new, and after a minute of nothing new. What is known
    so far, behind ``so far`` in a text, is a line of its own each time that it changes. With ``-v`` there are lines of
    every step instead.
    """
    console, work, ended = Console(stderr=True), _Work(what), threading.Event()
    columns = _Doing(work), BarColumn(bar_width=WIDTH_OF_BAR), "{task.percentage:3.0f} %", TimeElapsedColumn()
    bar = Progress(*columns, work.remaining, console=console, transient=True)
    bar.add_task(what, total=1.0)
    patience = threading.Timer(PATIENCE_S, bar.start)
    patience.daemon = True
    if not work.verbose and (find_spec("ipywidgets") if console.is_jupyter else console.is_terminal):
        patience.start()
    elif not work.verbose:
        threading.Thread(target=work.say_now_and_then, args=(ended,), daemon=True).start()
    try:
        yield work.tell
    finally:
        ended.set()
        patience.cancel()
        if patience.is_alive():
            patience.join()
        if bar.live.is_started:  # else it would end with an empty line
            bar.stop()


def cores_of(jobs: int | None) -> int:
    """Return the number of threads; None: one for each core. Raises UserError: no whole number above 0."""
    if jobs is not None and not (isinstance(jobs, int) and jobs > 0):
        raise UserError("jobs", jobs, "must be a whole number above 0")
    return jobs or os.cpu_count() or 1


@contextmanager
def shown(wanted: ShowProgress, what: str) -> Iterator[Tell | None]:
    """Give the function to call with the share done and the text of the stage, or None for silence.

    Raises
    ------
    UserError : ``wanted`` is neither a truth value nor a function.
    """
    if not (wanted is None or isinstance(wanted, bool) or callable(wanted)):
        raise UserError("progress", wanted, "must be True, False or a function of a share and a text")
    if wanted is False or wanted is None:
        yield None
    elif callable(wanted):
        own = wanted

        def tell(share: float, text: str = "", left: Left | None = None) -> None:
            own(share, text)

        yield tell
    else:
        with progress(what) as bar:
            yield bar
