"""How long diagnoses took on this machine, stage by stage: from that, how long the rest of another one takes.

The last ones of each kind are kept in the cache folder, in ``durations.json``, which may be deleted.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dtbacklash import files
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.api.progress import Tell
    from dtbacklash.physics.rig import Rig
    from dtbacklash.recording import Recording

#: diagnoses of a kind that are kept, and that have to agree before anything is said
KEPT, LEAST = 8, 2
#: a time left is said where none of the earlier ones speaks for another one by more than this factor
WITHIN = 2.0


def file() -> Path:
    """Return the path of the file of durations, in the user's cache folder."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "dtbacklash" / "durations.json"


class Durations:
    """Durations of earlier diagnoses of a kind, and the time that one takes now.

    kind : what diagnoses have to share to be compared. size : the time is proportional to it (samples).
    """

    def __init__(self, kind: str, size: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._kind, self._size, self._clock = kind, size, clock
        self._begun_s, self._begins = clock(), dict[str, float]()
        self._earlier: list[dict[str, Any]] = _read().get(kind, [])
        self._stage = ""

    def reached(self, share: float) -> None:
        """Note that a stage begins, by the share of the stages that are done."""
        stage = f"{share:.3f}"
        if stage != self._stage:
            self._stage = stage
            self._begins[stage] = self._clock() - self._begun_s

    def left(self) -> float | None:
        """Return the seconds until the end, if the earlier ones agree within a factor of two; else None."""
        if not self._stage:
            return None
        since = self._clock() - self._begun_s - self._begins[self._stage]
        left = [
            (one["all"] - one["begins"][self._stage]) * self._size / one["size"] - since
            for one in self._earlier if self._stage in one["begins"]
        ]  # fmt: skip
        if len(left) < LEAST or min(left) <= 0.0 or max(left) > WITHIN**2 * min(left):
            return None
        return math.sqrt(min(left) * max(left))

    def keep(self) -> None:
        """Write the duration of this diagnosis, which has ended; nothing if the file cannot be written."""
        took = {"size": self._size, "begins": self._begins, "all": self._clock() - self._begun_s}
        known = _read()
        known[self._kind] = [*known.get(self._kind, []), took][-KEPT:]
        with suppress(UserError):
            files.write_json(file(), known)


def _read() -> dict[str, list[dict[str, Any]]]:
    """What is kept; nothing of a file that is not there, or that cannot be read."""
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError):
        found = json.loads(file().read_text(encoding="utf-8"))
        return {
            kind: [one for one in ended if one["size"] > 0.0 and one["all"] >= max(one["begins"].values())]
            for kind, ended in found.items()
        }  # fmt: skip
    return {}


@contextmanager
def timed(
    tell: Tell, rig: Rig, recordings: Recording | Sequence[Recording], depth: str, jobs: int
) -> Iterator[Callable[[float, str], None]]:
    """Pass the progress of a diagnosis on to ``tell``, with the time left if it is known; keep its duration."""
    from dtbacklash.recording import Recording

    each = [recordings] if isinstance(recordings, Recording) else recordings
    channels = " ".join(sorted({name for one in each for name in one.channels}))
    kind = f"{rig.config.name}, search={depth}, {len(each)} x {channels}, jobs={jobs}"
    known = Durations(kind, float(sum(one.samples for one in each)))

    def said(share: float, text: str) -> None:
        known.reached(share)
        tell(share, text, known.left)

    yield said
    known.keep()
