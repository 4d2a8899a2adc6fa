"""Channels at uneven times, brought to uniform ones where the steps are short beside what moves."""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.recording.pick import Picked
from dtbacklash.recording.refusal import SAMPLES_MIN, Refused
from dtbacklash.recording.series import Series, held_means
from dtbacklash.recording.timebase import MISSING_MAX

SHOWN = 0.99  # of a sensor's variance lies at periods that are longer than the fastest that it shows
PARTS = 4.0  # steps a fastest period, at least


def resample(picked: Picked, held: Collection[str], linear: bool) -> None:
    """Put the channels at uniform times, the median step apart, with a note; gaps stay gaps.

    A command that is held becomes its mean over each sample, all else follows a cubic spline.

    Parameters
    ----------
    held : names of commands and of the reference. linear : whether these are no steps.

    Raises
    ------
    Refused : a step is longer than a quarter of the fastest period that a sensor shows; values are missing.
    """
    assert picked.t_s is not None
    rows = np.append(np.diff(picked.t_s) > 0.0, True)  # of two rows at one time the later one counts
    t, numbers = picked.t_s[rows], np.flatnonzero(rows)
    channels = {name: values[rows] for name, values in picked.channels.items()}
    missing = next((name for name, values in channels.items() if not np.isfinite(values).all()), None)
    if missing is not None:
        raise Refused(f"sampling is uneven, and channel {missing} has missing values: leave out the rows without them")
    steps = np.diff(t)
    step = float(np.median(steps))
    cuts = [0, *(np.flatnonzero(steps > (MISSING_MAX + 1.5) * step) + 1).tolist(), len(t)]
    pieces = [(a, b) for a, b in pairwise(cuts) if b - a >= SAMPLES_MIN]
    a, b = max(pieces, key=lambda piece: piece[1] - piece[0], default=(0, len(t)))
    read = {name: values[a:b] for name, values in channels.items() if name not in held}
    period, name = min((fastest_period(t[a:b], values, step), name) for name, values in read.items())
    longest = [a + int(np.argmax(steps[a : b - 1])) for a, b in pieces]
    inside = max(longest, key=lambda k: steps[k], default=0)
    if not pieces or PARTS * steps[inside] > period:
        raise Refused(
            f"sampling is uneven: {steps[inside]:.3g} s pass before row {numbers[inside] + 2} of the numbers, more "
            f"than a quarter of the fastest period that {name} shows ({period:.3g} s): log more often, or take the "
            "rows before or after with recording.rows=[FIRST,LAST]"
        )
    from scipy.interpolate import CubicSpline

    times = [np.arange(t[a], t[b - 1] + 1e-6 * step, step) for a, b in pieces]
    for name, values in channels.items():
        parts = []
        for (a, b), new in zip(pieces, times, strict=True):
            own = Series(t[a:b], values[a:b])
            if name in held:
                parts.append(np.interp(new, *own) if linear else held_means(own, new, step))
            else:
                parts.append(CubicSpline(*own)(new))
        picked.channels[name] = np.concatenate(parts)
    picked.t_s = np.concatenate(times)
    picked.notes.append(
        f"Sampling is uneven, with steps from {steps.min():.3g} to {steps[inside]:.3g} s: the channels were resampled "
        f"to {step:.6g} s."
    )


def fastest_period(t_s: Floats, values: Floats, step_s: float) -> float:
    """The shortest period that a signal at uneven times shows, s: faster ones hold a hundredth of its variance."""
    from scipy.interpolate import CubicSpline
    from scipy.signal import detrend

    at = np.arange(t_s[0], t_s[-1], step_s)
    shown = detrend(CubicSpline(t_s, values)(at)) * np.hanning(len(at))
    power = np.cumsum(np.abs(np.fft.rfft(shown))[1:] ** 2)
    if not power[-1]:
        return np.inf
    return float(len(at) * step_s / (1 + np.searchsorted(power, SHOWN * power[-1])))
