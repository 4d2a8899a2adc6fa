"""How far a diagnosis is: told to who waits for it, and kept for who does not want to wait any longer."""

from __future__ import annotations

from collections.abc import Callable

from dtbacklash.diagnose.search.model import Log, Model


def silent(text: str, share: float) -> None:
    """What to call with a text and a share, 0 to 1, where nobody asked for progress."""


class Course:
    """The course of a diagnosis.

    Parameters
    ----------
    say : called with what is being done and the share done, 0 to 1, which never falls.

    Attributes
    ----------
    stage : what is being done. believed : what the search believes so far, with its log; None before the first fit.
    smooth : whether it reads the command as smooth between its samples.
    """

    def __init__(self, say: Callable[[str, float], None] = silent) -> None:
        self._say = say
        self._share = self._first = self._last = 0.0
        self.stage = ""
        self.believed: tuple[Model, Log] | None = None
        self.smooth = False

    def at(self, stage: str, first: float, last: float | None = None) -> None:
        """A stage begins, at the share ``first``; until the next one at ``last``."""
        self.stage, self._first, self._last = stage, first, first if last is None else last
        self._tell(first)

    def part(self, first: float, last: float) -> Callable[[int, int], None]:
        """What to call with (done, of) for work that is this part of the stage, 0 to 1."""

        def tell(done: int, of: int) -> None:
            self._tell(self._first + (self._last - self._first) * (first + (last - first) * done / of))

        return tell

    def believe(self, model: Model, log: Log) -> None:
        """Keep what is believed now."""
        self.believed = model, log

    def again(self) -> Course:
        """For a second search: it is told here, and what is believed here stays."""

        def say(stage: str, share: float) -> None:
            self.stage = stage
            self._tell(share)

        return Course(say)

    def _tell(self, share: float) -> None:
        self._share = max(self._share, share)
        self._say(self.stage, self._share)
