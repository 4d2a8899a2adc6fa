"""Channels with rows, or a clock, of their own: what a message bus, a scope or a slow sensor records.

A command holds until the next one. A sensor is taken where it was read; in between it is missing (NaN).
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.recording.pick import COMMAND, REFERENCE, Picked
from dtbacklash.recording.refusal import SAMPLES_MIN, Refused
from dtbacklash.recording.timebase import BAD_STAMPS_MAX, of_the_grid

#: a channel that has a value in every second of the rows, or more seldom, has rows of its own
ROWS_APART = 2
#: a sensor that is read so much more seldom than the grid is not interpolated (steps of the grid)
SLOW = 1.5
#: of the rows at one time, in which a sensor shows the same where a command steps, and not because it rests (share)
SAME_AT_EVENTS = 0.95


class Series(NamedTuple):
    """A channel's own times, s, and its values."""

    t_s: Floats
    values: Floats


def own_paces(picked: Picked) -> dict[str, Series]:
    """Take the channels with times or rows of their own out of what was picked; what remains has a value in each row.

    The times of what remains are the grid: without such channels those of the sensor with most readings.

    Raises
    ------
    Refused : a channel has hardly any values of its own.
    """
    apart = {name: _series(name, clock, picked) for name, clock in picked.clocks.items()}
    t = picked.t_s
    if t is not None:
        for name, values in picked.channels.items():
            rows = np.flatnonzero(np.isfinite(values) & np.isfinite(t))
            if name not in apart and len(rows) > 1 and np.median(np.diff(rows)) >= ROWS_APART:
                apart[name] = _series(name, t, picked)
    if not apart:
        return {}
    for name in apart:
        del picked.channels[name]
    dense = [np.isfinite(values) for name, values in picked.channels.items() if name != REFERENCE]
    if dense and t is not None:
        rows = np.any(dense, axis=0)
        picked.t_s, picked.channels = t[rows], {name: values[rows] for name, values in picked.channels.items()}
    else:
        base = max(apart, key=lambda name: (len(apart[name].t_s), name != COMMAND))
        picked.t_s, picked.channels[base] = apart.pop(base)
    first = apart[COMMAND].t_s[0] if COMMAND in apart else -np.inf
    known = ~(picked.t_s < first)
    picked.t_s, picked.channels = picked.t_s[known], {name: values[known] for name, values in picked.channels.items()}
    return apart


def events(picked: Picked) -> dict[str, Series]:
    """The command with its changes at rows beside the grid's, where there are such rows; they are taken out.

    Rows at one time are events if only the command tells them apart. Where sensors do as well, the times are rounded.
    """
    t, u = picked.t_s, picked.channels.get(COMMAND)
    on = None if t is None or u is None or not np.isfinite(t).all() else of_the_grid(t)
    if t is None or u is None or on is None or not np.isfinite(u).all():
        return {}
    double = np.diff(t) == 0.0
    if double.sum() > BAD_STAMPS_MAX * len(t):
        sensors = [
            np.diff(values) == 0.0 for name, values in picked.channels.items() if name not in (COMMAND, REFERENCE)
        ]
        if not any(same[double].mean() >= SAME_AT_EVENTS > same[~double].mean() for same in sensors):
            return {}
    last = np.append(~double, True)
    apart = {COMMAND: Series(t[last], u[last])}
    on &= last
    picked.t_s, picked.channels = t[on], {name: values[on] for name, values in picked.channels.items()}
    pairs, others = int(double.sum()), int((last & ~on).sum())
    if pairs:
        picked.notes.append(f"Of {pairs} pair{'s' * (pairs > 1)} of rows at one time the later one counts.")
    if others:
        picked.notes.append(f"{others} rows between the samples are events: the command after each holds from there.")
    return apart


def _series(name: str, t_s: Floats, picked: Picked) -> Series:
    values = picked.channels[name]
    rows = np.isfinite(values) & np.isfinite(t_s)
    if rows.sum() < 2 or (name != COMMAND and rows.sum() < SAMPLES_MIN):
        raise Refused(f"channel {name} has {rows.sum()} values; at least {SAMPLES_MIN} are needed")
    stamps = t_s[rows]
    if np.any(np.diff(stamps) < 0.0):
        raise Refused(f"the times of channel {name} run backwards")
    last = np.append(np.diff(stamps) > 0.0, True)  # of two values at one time the later one counts
    return Series(stamps[last], values[rows][last])


def on_grid(series: Series, t_s: Floats, step_s: float, held: bool) -> Floats:
    """(N,) a channel at the times of a uniform grid.

    A held command is its mean over the sample that begins there: what is done where it changes within a sample.
    """
    stamps, values = series
    if held:
        return held_means(series, t_s, step_s)
    own = float(np.median(np.diff(stamps)))
    shown = np.interp(t_s, stamps, values)
    near = np.zeros(len(t_s), dtype=bool)
    if own > SLOW * step_s:
        at = np.rint((stamps - t_s[0]) / step_s).astype(np.int64)
        near[at[(at >= 0) & (at < len(t_s))]] = True
    else:
        after = np.clip(np.searchsorted(stamps, t_s), 1, len(stamps) - 1)
        near = np.minimum(abs(t_s - stamps[after - 1]), abs(stamps[after] - t_s)) <= SLOW * own
    return np.where(near, shown, np.nan)


def straight(series: Series, t_s: Floats, step_s: float) -> Floats | None:
    """(N,) a command that goes straight from each value to the next, where these are further apart than the samples.

    Its value is that of the middle of the sample that begins at each time. None where the log has all of it.
    """
    seldom = float(np.median(np.diff(series.t_s))) > SLOW * step_s
    return np.interp(t_s + 0.5 * step_s, series.t_s, series.values) if seldom else None


def held_means(series: Series, t_s: Floats, step_s: float) -> Floats:
    """(N,) means, over the sample that begins at each time, of values that hold until the next one."""
    stamps, values = series
    sums = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(stamps))))

    def until(t: Floats) -> Floats:
        at = np.clip(np.searchsorted(stamps, t, "right") - 1, 0, None)
        return sums[at] + values[at] * (t - stamps[at])

    at = np.clip(np.searchsorted(stamps, t_s, "right") - 1, 0, None)
    changes = np.searchsorted(stamps, t_s + step_s) - 1 > at  # else it is that value, to the last digit
    return np.where(changes, (until(t_s + step_s) - until(t_s)) / step_s, values[at])


def paces_said(apart: dict[str, Series], step_s: float, held: Collection[str]) -> list[str]:
    """A sentence on each channel that was recorded at its own times. held : the commands, and the reference."""
    notes = []
    for name, series in apart.items():
        own = float(np.median(np.diff(series.t_s)))
        how = "held until the next value" if name in held else "taken where it was read"
        if name not in held and own <= SLOW * step_s:
            how = "brought to the others' times"
        gap = (
            " What it did in between is not in the file."
            if name in held and name != REFERENCE and own > SLOW * step_s
            else ""
        )
        count = f"{len(series.t_s)} values, {own:.4g} s apart"
        notes.append(f"Channel {name} has times of its own ({count}): it is {how}.{gap}")
    return notes
