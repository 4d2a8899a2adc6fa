"""The asynchronous link between controller and twin: when a buffer is full, and when its answer takes effect.

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

import numpy as np

from dtbacklash.core.library import lib, struct
from dtbacklash.errors import UserError

Answer = TypeVar("Answer")
#: answers that are under way for which there is room at first
UNDER_WAY = 16


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
    _answers: deque[Answer] = field(default_factory=deque, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.buffer < 1:
            raise UserError("twin.buffer", self.buffer, "at least 1 sample")
        if not 0.0 <= self.delay_s < float("inf"):
            raise UserError("twin.delay_s", self.delay_s, "at least 0 s")

        due = np.empty(UNDER_WAY, dtype=np.int64)
        self._struct = struct("TwinLink", length=self.buffer, delay=self.delay, slots=due.size, due=due)

    @property
    def delay(self) -> int:
        """The delay in samples."""
        return round(self.delay_s / self.sample_time_s)

    def open(self, event: int, first: int | None = None) -> bool:
        """An event at sample ``event`` asks for an estimation; False if a buffer is filling already.

        first: where the buffer begins, by default at the event; an earlier sample sends what memory still
        holds (the buffer may then be full at once).
        """
        begin = event if first is None else first
        if not 0 <= begin <= event:
            raise ValueError(f"a buffer can begin at samples 0..{event}, not {begin}")
        return bool(lib.dtb_link_open(self._struct, event, begin))

    @property
    def filling(self) -> bool:
        """Whether a buffer is being filled."""
        return bool(self._struct.filling)

    def next_sample(self) -> int | None:
        """The next sample before which a buffer is full or an answer arrives; None if none is under way."""
        found: int = lib.dtb_link_next(self._struct)
        return None if found < 0 else found

    def full_buffer(self, k: int) -> FullBuffer | None:
        """The buffer that is full before sample k, once; else None."""
        link = self._struct
        if not lib.dtb_link_full(link, k):
            return None
        return FullBuffer(link.event, link.first, link.first + link.length)

    def send(self, k: int, answer: Answer) -> int:
        """The twin's answer to the buffer taken at sample k; returns the sample from which it is in force."""
        old = self._struct
        if old.waiting == old.slots:  # none that is under way is lost
            due = np.empty(2 * old.slots, dtype=np.int64)
            due[: old.slots] = [old.due[(old.oldest + i) % old.slots] for i in range(old.slots)]
            same = {name: getattr(old, name) for name in ("length", "delay", "filling", "event", "first", "waiting")}
            self._struct = struct("TwinLink", slots=due.size, due=due, **same)
        self._answers.append(answer)
        return int(self._struct.due[lib.dtb_link_send(self._struct, k)])

    def arrived(self, k: int) -> list[Answer]:
        """Answers that take effect at sample k or before, oldest first; each is handed out once."""
        out = []
        while lib.dtb_link_arrived(self._struct, k) >= 0:
            out.append(self._answers.popleft())
        return out
