"""Whether a recording can judge what was fitted to another: recorded alike, and not the same samples."""

from collections.abc import Container

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.recording.model import Recording
from dtbacklash.recording.timebase import UNIFORM

#: as many rows in a row that are the same in every channel are no chance
SAME_ROWS = 100
#: a copy that was rounded differs by less than this share of each channel's range, and does so in so many of its rows
ROUNDED, MOSTLY = 1e-5, 0.5


def check_alike(
    recording: Recording, validation: Recording, sensors: Container[str] | None = None, said: object = None
) -> None:
    """Refuse a recording to judge on that has another sample time, or lacks a channel.

    sensors : of the rig; other channels need not be there. None: all channels count. said : how the user called it.

    Raises
    ------
    UserError : with the key ``validation``.
    """
    named, step = validation.name if said is None else said, recording.sample_time_s
    if abs(validation.sample_time_s / step - 1.0) > UNIFORM:
        raise UserError("validation", named, f"must have the recording's sample time {step:.6g} s")
    needed = {c for c in recording.channels if sensors is None or c == "u" or c in sensors}
    if missing := needed - set(validation.channels):
        raise UserError("validation", named, f"lacks the recording's channel {min(missing)}")


def check_apart(recording: Recording, validation: Recording) -> None:
    """Refuse a recording to judge on that repeats what is fitted to.

    Raises
    ------
    UserError : with the key ``validation``.
    """
    if shared := shared_rows(recording, validation):
        said = f"holds {shared} samples of the recording itself; what was fitted to cannot judge: give another one"
        raise UserError("validation", validation.name, said)


def shared_rows(first: Recording, second: Recording) -> int:
    """How many samples the second recording has in common with the first, at the shift at which most agree.

    The same is what agrees to the last digit in every channel that both have. The shift comes from rows that occur
    once in each: a machine at rest repeats itself. 0 below SAME_ROWS. A copy that begins where the recording does is
    known by fewer digits, too: sensors of a machine that repeats its motion differ by their noise.
    """
    names = sorted(set(first.channels) & set(second.channels))
    return max(_exactly(first, second, names), _rounded(first, second, names))


def _rounded(first: Recording, second: Recording, names: list[str]) -> int:
    """How many rows agree but for rounding where both begin together; 0 if that are not most of them."""
    length = min(first.samples, second.samples)
    alike = np.ones(length, dtype=bool)
    for name in names:
        a, b = (r.channels[name][:length] for r in (first, second))
        alike &= np.abs(a - b) <= ROUNDED * max(float(np.ptp(a)), 1e-300)
    count = int(alike.sum())
    return count if count >= max(SAME_ROWS, MOSTLY * length) else 0


def _exactly(first: Recording, second: Recording, names: list[str]) -> int:
    a, b = (_rows(r, names) for r in (first, second))
    _, at_a, at_b = np.intersect1d(a, b, return_indices=True)
    once = (_counts(a)[at_a] == 1) & (_counts(b)[at_b] == 1)
    if once.sum() < SAME_ROWS:
        return 0
    shifts, counts = np.unique(at_a[once] - at_b[once], return_counts=True)
    shift = int(shifts[np.argmax(counts)])
    a, b = a[max(shift, 0) :], b[max(-shift, 0) :]
    length = min(len(a), len(b))
    return int(np.sum(a[:length] == b[:length])) if counts.max() >= SAME_ROWS else 0


def _rows(recording: Recording, names: list[str]) -> np.ndarray:
    """(N,) a row as one value that compares byte by byte."""
    table: Floats = np.ascontiguousarray(np.column_stack([recording.channels[n] for n in names]) + 0.0)
    return table.view(np.dtype((np.void, table.dtype.itemsize * table.shape[1]))).ravel()


def _counts(rows: np.ndarray) -> np.ndarray:
    """(N,) how often each row occurs."""
    _, inverse, counts = np.unique(rows, return_inverse=True, return_counts=True)
    return counts[inverse]
