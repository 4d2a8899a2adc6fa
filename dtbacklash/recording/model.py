"""What a recording is once it has been read and checked."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dtbacklash.errors import UserError
from dtbacklash.recording.command import HELD

Floats = NDArray[np.float64]

SAMPLES_MIN = 100  # fewer samples cannot carry a diagnosis


class Refused(ValueError):
    """A recording that cannot be used; its text is one sentence. Becomes a UserError at the border."""


@dataclass(frozen=True)
class Recording:
    """A recording on a uniform time grid, in SI units.

    Attributes
    ----------
    name : name of the mapping or of the file.
    source : the file that was read.
    sample_time_s : time between two samples, s.
    t_s : (N,) time of each sample as recorded (it need not start at 0), s.
    channels : name -> (N,) values in SI units.
    units : name -> SI unit.
    notes : one sentence for each thing that was found and how it was handled.
    citation, licence : of a published recording, else empty.
    rig : the rig that it was recorded on, where the mapping says so.
    splits : the parts that the mapping names, as half-open ranges of rows of the file.
    part : which of them this is, or empty for the whole file.
    command : what ``u`` does between two samples: ``held`` or ``band_limited`` (see :mod:`.command`).
    """

    name: str
    source: Path
    sample_time_s: float
    t_s: Floats
    channels: dict[str, Floats]
    units: dict[str, str]
    notes: list[str] = field(default_factory=list)
    citation: str = ""
    licence: str = ""
    rig: str | None = None
    splits: dict[str, tuple[int, int]] = field(default_factory=dict)
    part: str = ""
    command: str = HELD

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return len(self.t_s)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample, s."""
        return self.sample_time_s * (self.samples - 1)

    def section(self, start: int, stop: int) -> Recording:
        """The samples ``start`` to ``stop - 1``."""
        channels = {name: values[start:stop] for name, values in self.channels.items()}
        return replace(self, t_s=self.t_s[start:stop], channels=channels)


def split(recording: Recording, share: float = 0.3) -> tuple[Recording, Recording]:
    """Hold out the last ``share`` of a recording.

    Returns
    -------
    The part to fit and the part to judge on.

    Raises
    ------
    UserError : the share is not between 0 and 1, or leaves a part with fewer than 100 samples.
    """
    if not 0.0 < share < 1.0:
        raise UserError("held_out", share, "must be above 0 and below 1")
    cut = recording.samples - round(share * recording.samples)
    if min(cut, recording.samples - cut) < SAMPLES_MIN:
        allowed = f"leaves a part with fewer than {SAMPLES_MIN} of the {recording.samples} samples"
        raise UserError("held_out", share, f"{allowed}; give a longer recording")
    return recording.section(0, cut), recording.section(cut, recording.samples)
