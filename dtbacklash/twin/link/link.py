"""The asynchronous link between controller and twin: when a buffer is full and when its answer takes effect.

Times are sample indices. An event at sample k opens a buffer that holds the samples k ... k+n-1; the twin
gets it at sample k+n, before that sample's control step, and its answer is in force from sample k+n+delay on.

What happens when events come faster than that:

- An event while a buffer fills is ignored: that buffer records the new motion as well, and starting again
  at every change would never finish where the reference keeps changing.
- An event while an answer is on its way opens the next buffer at once: measuring does not wait for the
  network.
- Answers take effect in the order of their buffers; the delay is the same for all, so none overtakes another.
- What is not full, or not there, when the run ends is lost, as on a real rig.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from dtbacklash.errors import UserError

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class FullBuffer:
    """Samples first <= k < stop are to be sent to the twin; opened by the event at sample ``event``."""

    event: int
    first: int
    stop: int


@dataclass
class TwinLink(Generic[Answer]):
    """State of the link; ``Answer`` is whatever the twin sends back, e.g. a gap.

    buffer: samples of one estimation. delay_s: from the full buffer to the answer in force, rounded to
    samples. Use: ``open`` at each event; run up to ``next_sample()``; there take ``full_buffer(k)``,
    ``send`` its answer and apply every ``arrived(k)`` before sample k is computed.
    """

    buffer: int
    delay_s: float
    sample_time_s: float
    _filling: FullBuffer | None = field(default=None, init=False, repr=False)
    _on_the_way: deque[tuple[int, Answer]] = field(default_factory=deque, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.buffer < 1:
            raise UserError("twin.buffer", self.buffer, "at least 1 sample")
        if not 0.0 <= self.delay_s < float("inf"):
            raise UserError("twin.delay_s", self.delay_s, "at least 0 s")

    @property
    def delay(self) -> int:
        """The delay in samples."""
        return round(self.delay_s / self.sample_time_s)

    def open(self, event: int, first: int | None = None) -> bool:
        """An event at sample ``event`` asks for an estimation; False if a buffer is filling already.

        first: where the buffer begins, by default at the event; an earlier sample sends what memory still
        holds (the buffer may then be full at once).
        """
        if self._filling is not None:
            return False
        begin = event if first is None else first
        if not 0 <= begin <= event:
            raise ValueError(f"a buffer can begin at samples 0..{event}, not {begin}")
        self._filling = FullBuffer(event, begin, begin + self.buffer)
        return True

    @property
    def filling(self) -> bool:
        """Whether a buffer is being filled."""
        return self._filling is not None

    def next_sample(self) -> int | None:
        """The next sample before which a buffer is full or an answer arrives; None if none is under way."""
        times = [when for when, _ in self._on_the_way]
        if self._filling is not None:
            times.append(max(self._filling.stop, self._filling.event))
        return min(times, default=None)

    def full_buffer(self, k: int) -> FullBuffer | None:
        """The buffer that is full before sample k, once; else None."""
        ready = self._filling
        if ready is None or k < max(ready.stop, ready.event):
            return None
        self._filling = None
        return ready

    def send(self, k: int, answer: Answer) -> int:
        """The twin's answer to the buffer taken at sample k; returns the sample from which it is in force."""
        when = k + self.delay
        self._on_the_way.append((when, answer))
        return when

    def arrived(self, k: int) -> list[Answer]:
        """Answers that take effect at sample k or before, oldest first; each is handed out once."""
        out = []
        while self._on_the_way and self._on_the_way[0][0] <= k:
            out.append(self._on_the_way.popleft()[1])
        return out
