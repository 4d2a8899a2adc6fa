"""What is done to a recording before it is compared with anything: cut, detrend, resample."""

from __future__ import annotations

import math
from collections.abc import Mapping as Dict
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from dtbacklash.errors import UserError
from dtbacklash.recording.refusal import SAMPLES_MIN

if TYPE_CHECKING:
    from dtbacklash.arrays import Floats
    from dtbacklash.recording.model import Recording

#: what is taken off a channel, as in ``scipy.signal.detrend``
TRENDS = ("constant", "linear")


@dataclass(frozen=True)
class Preparation:
    """What a mapping says is done to the recording, in this order.

    from_s, to_s : what is kept, s of the recording's clock. detrend : channel -> ``constant`` or ``linear``.
    sample_time_s : after it, a whole multiple of the recording's own.
    """

    from_s: float | None = None
    to_s: float | None = None
    detrend: Dict[str, str] | None = None
    sample_time_s: float | None = None

    def of(self, recording: Recording) -> Recording:
        """The recording, prepared."""
        if self.from_s is not None or self.to_s is not None:
            recording = cut(recording, self.from_s, self.to_s)
        if self.detrend:
            recording = detrended(recording, self.detrend)
        return recording if self.sample_time_s is None else resampled(recording, self.sample_time_s)


def cut(recording: Recording, from_s: float | None = None, to_s: float | None = None) -> Recording:
    """What lies from ``from_s`` to ``to_s`` of the recording's clock; None: from its beginning, to its end.

    Raises
    ------
    UserError : too few samples lie there.
    """
    import numpy as np

    t_s = recording.t_s
    begin, end = t_s[0] if from_s is None else from_s, t_s[-1] if to_s is None else to_s
    first, last = int(np.searchsorted(t_s, begin - 1e-9)), int(np.searchsorted(t_s, end + 1e-9, side="right"))
    if last - first < SAMPLES_MIN:
        allowed = f"fewer than {SAMPLES_MIN} samples lie there; it goes from {t_s[0]:g} to {t_s[-1]:g} s"
        raise UserError("cut", f"{begin:g} to {end:g} s", allowed)
    part = recording.section(first, last)
    return _noted(part, f"Cut to {part.t_s[0]:g} to {part.t_s[-1]:g} s.")


def detrended(recording: Recording, trends: Dict[str, str]) -> Recording:
    """Channels without their means (``constant``) or their lines of least squares (``linear``), each over all of it.

    Raises
    ------
    UserError : no such channel, or no such trend.
    """
    channels = dict(recording.channels)
    for name, trend in trends.items():
        if name not in channels:
            raise UserError(f"detrend.{name}", trend, f"no such channel; it has {', '.join(channels)}")
        if trend not in TRENDS:
            raise UserError(f"detrend.{name}", trend, f"choose one of {', '.join(TRENDS)}")
        since = recording.t_s - recording.t_s.mean()
        channels[name] = channels[name] - channels[name].mean()
        if trend == "linear":
            channels[name] = channels[name] - since * (since @ channels[name]) / (since @ since)
    said = ", ".join(f"{name} ({trend})" for name, trend in trends.items())
    return _noted(replace(recording, channels=channels), f"Detrended: {said}.")


def resampled(recording: Recording, sample_time_s: float) -> Recording:
    """The recording at a slower rate, low-passed first, each stretch alone (``scipy.signal.decimate``, zero phase).

    sample_time_s : a whole multiple of the recording's own.

    Raises
    ------
    UserError : it is none; too few samples are left of every stretch.
    """
    import numpy as np

    step_s = recording.sample_time_s
    every = round(sample_time_s / step_s) if math.isfinite(sample_time_s) else 0
    if every < 1 or not math.isclose(sample_time_s, every * step_s, rel_tol=1e-6):
        allowed = f"must be a whole multiple of the recording's own, {step_s:g} s"
        raise UserError("sample_time_s", sample_time_s, allowed)
    kept = [(a, b) for a, b in recording.stretches if len(range(a, b, every)) >= SAMPLES_MIN]
    if not kept:
        raise UserError("sample_time_s", sample_time_s, f"leaves fewer than {SAMPLES_MIN} samples of each stretch")
    if every == 1:
        return recording
    channels = {
        name: np.concatenate([_slower(values[a:b], every) for a, b in kept])
        for name, values in recording.channels.items()
    }
    ends = np.cumsum([0, *(len(range(a, b, every)) for a, b in kept)]).tolist()
    slower = replace(
        recording, t_s=np.concatenate([recording.t_s[a:b:every] for a, b in kept]), channels=channels,
        sample_time_s=every * step_s, straight=None, stretches=tuple(pairwise(ends)),
    )  # fmt: skip
    return _noted(slower, f"Resampled from {step_s:g} to {every * step_s:g} s, low-passed first.")


def _slower(values: Floats, every: int) -> Floats:
    import numpy as np
    from scipy.signal import decimate

    return np.ascontiguousarray(decimate(values, every, ftype="fir", zero_phase=True))


def _noted(recording: Recording, note: str) -> Recording:
    return replace(recording, notes=[*recording.notes, note])
