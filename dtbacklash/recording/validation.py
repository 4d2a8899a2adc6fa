"""Whether a recording can judge what was fitted to another: recorded alike, and not the same samples."""

from collections.abc import Container

import numpy as np

from dtbacklash.errors import UserError
from dtbacklash.recording.model import Recording
from dtbacklash.recording.timebase import UNIFORM


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
    """How many samples two recordings share: all of the shorter one where the longer one holds it, else 0.

    The same is what is equal in every channel that both have, a sensor among them. Two runs of one command are not,
    however often their readings agree.
    """
    names = sorted(set(first.channels) & set(second.channels))
    if not set(names) - {"u"}:
        return 0
    short, long = sorted((first, second), key=lambda r: r.samples)
    return short.samples if _holds(_rows(long, names), _rows(short, names), 8 * len(names)) else 0


def _rows(recording: Recording, names: list[str]) -> bytes:
    """All samples, one after the other."""
    return np.column_stack([recording.channels[n].astype(float) + 0.0 for n in names]).tobytes()


def _holds(long: bytes, short: bytes, row: int) -> bool:
    """Whether a table holds another one, whole rows of so many bytes."""
    at = long.find(short)
    while at % row and at >= 0:
        at = long.find(short, at + 1)
    return at >= 0
