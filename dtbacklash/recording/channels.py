"""Defects of single channels: missing values, clipping, a sensor that hangs."""

from __future__ import annotations

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.recording.refusal import SAMPLES_MIN, Refused

RUN_MAX = 10  # as many missing values in a row are interpolated; at more the recording is cut
MISSING_SHARE_MAX = 0.05  # of all values that may be missing
TRIM_MAX = 0.3  # share of a recording that may be cut out for missing values
CLIPPED_SHARE = 0.002  # of all samples at the limit from which clipping is reported
LIMIT_SPEED = 0.2  # of the usual speed in motion (rms): what reaches or leaves its extreme faster goes on beyond it
LIMIT_COUNTS = 1.5  # a sample: as slow as one count a sample anything may come to rest; a count is its smallest step
REST_SAMPLES = 8  # before an extreme value, from which is read how the motion that reaches it ends
REST_BEYOND = 0.005  # of a channel's range: what would have ended so soon beyond its extreme value rests there
REST_RETURNS = 2.0  # times as long as a motion that is only cut off takes to come back: what stays longer rests
HANGS_SHARE = 0.05  # of a recording that a channel must stand still for it to be looked at
HANGS_END_SHARE = 0.1
JUMP = 3.0  # a step away from standing still, relative to the largest usual step


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Half-open ranges in which ``mask`` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def filled(values: Floats) -> Floats:
    """(N,) the values with straight lines over those that are missing (NaN); 0 where all are."""
    read = np.isfinite(values)
    if read.all():
        return values
    at = np.arange(len(values))
    return np.interp(at, at[read], values[read]) if read.any() else np.zeros(len(values))


def fill(
    channels: dict[str, Floats], t_s: Floats, required: frozenset[str], pieces: list[tuple[int, int]]
) -> tuple[list[tuple[int, int]], dict[str, Floats], list[str]]:
    """Interpolate short runs of missing values, cut off missing ends, and cut at long runs.

    ``pieces`` : half-open ranges of rows that follow one another in time.

    Returns
    -------
    The stretches of rows that remain, half-open; the channels, without missing values in these; what was done.

    Raises
    ------
    Refused : too many values are missing; a required channel without values.
    """
    notes: list[str] = []
    kept: dict[str, Floats] = {}
    for name, values in channels.items():
        if np.isfinite(values).mean() > 0.5:
            kept[name] = values
        elif name in required:
            share = 100 * (1 - np.isfinite(values).mean())
            raise Refused(f"channel {name} has no value in {share:.0f} % of the rows")
        else:
            notes.append(f"Channel {name} has hardly any values and is not used.")
    stretches = [found for a, b in pieces for found in _stretches(kept, a, b)]
    rows = sum(b - a for a, b in pieces)
    used = sum(b - a for a, b in stretches)
    if used < (1.0 - TRIM_MAX) * rows:
        share = f"{100 * used / rows:.0f} % of the rows only"
        early = " ".join(_stops(kept, t_s))
        raise Refused(
            f"the channels have values at the same time, in stretches without holes, in {share}"
            + (f". {early} The rows before can be taken with recording.rows=[FIRST,LAST]" if early else "")
        )
    _note_losses(kept, t_s, pieces, stretches, notes)
    return stretches, {name: _bridged(name, values, t_s, stretches, notes) for name, values in kept.items()}, notes


def _stretches(channels: dict[str, Floats], start: int, stop: int) -> list[tuple[int, int]]:
    """What lies between the long runs of missing values of any channel, without missing ends, where long enough."""
    lost = np.zeros(stop - start, dtype=bool)
    finite = [np.isfinite(values[start:stop]) for values in channels.values()]
    for good in finite:
        for a, b in runs(~good):
            lost[a:b] |= b - a > RUN_MAX
    found = []
    for a, b in runs(~lost):
        whole = [np.flatnonzero(f[a:b]) for f in finite]
        if not all(len(index) for index in whole):
            continue
        first, last = a + max(index[0] for index in whole), a + min(index[-1] for index in whole) + 1
        if last - first >= SAMPLES_MIN or (first, last) == (0, stop - start):
            found.append((start + int(first), start + int(last)))
    return found


def _note_losses(
    channels: dict[str, Floats], t_s: Floats, pieces: list[tuple[int, int]], stretches: list[tuple[int, int]],
    notes: list[str],
) -> None:  # fmt: skip
    """Say what is cut off at the ends, which channels stop early, and where they drop out in between."""
    first, last = stretches[0][0], stretches[-1][1]
    ends = sum(b - a for a, b in pieces) - sum(max(0, min(b, last) - max(a, first)) for a, b in pieces)
    if ends:
        cut = f"{ends} rows at the ends, where a channel has no value, were cut off."
        notes.append(" ".join([cut, *_stops(channels, t_s)]))
    for name, values in channels.items():
        out = [(first + a, first + b) for a, b in runs(~np.isfinite(values[first:last])) if b - a > RUN_MAX]
        if out:
            a, b = max(out, key=lambda run: run[1] - run[0])
            where = f"up to {b - a} samples in a row, first" if len(out) > 1 else f"{b - a} samples in a row"
            times = "once" if len(out) == 1 else f"{len(out)} times"
            notes.append(f"Channel {name} drops out {times}, for {where} at t = {t_s[out[0][0]]:.6g} s.")


def _stops(channels: dict[str, Floats], t_s: Floats) -> list[str]:
    """A sentence on each channel that has no more values from a time on, before the times end."""
    ends = {name: int(np.flatnonzero(np.isfinite(values))[-1]) for name, values in channels.items()}
    return [
        f"Channel {name} stops at t = {t_s[end]:.6g} s, and the recording at {t_s[-1]:.6g} s."
        for name, end in ends.items()
        if end < len(t_s) - 1
    ]


def _bridged(name: str, values: Floats, t_s: Floats, stretches: list[tuple[int, int]], notes: list[str]) -> Floats:
    """The channel with its short runs of missing values interpolated within each stretch."""
    values, count, longest = values.copy(), 0, 0
    for a, b in stretches:
        missing = ~np.isfinite(values[a:b])
        if missing.any():
            count += int(missing.sum())
            longest = max(longest, *(stop - start for start, stop in runs(missing)))
            values[a:b] = np.interp(t_s[a:b], t_s[a:b][~missing], values[a:b][~missing])
    if count > MISSING_SHARE_MAX * sum(b - a for a, b in stretches):
        raise Refused(
            f"channel {name} has no value in {count} of {len(values)} rows, and at most {100 * MISSING_SHARE_MAX:g} % "
            "are interpolated: leave out the rows without one"
        )
    if count:
        plural = "s" * (count > 1)
        notes.append(f"Channel {name}: {count} missing value{plural} interpolated, at most {longest} in a row.")
    return values


def idle_command(channels: dict[str, Floats], unit: str) -> list[str]:
    """A sentence where the command never changes and something moves, in which case it may be another column; or none.

    What moves changes less from one sample to the next than in all.
    """
    u = channels.get("u")
    if u is None or not len(u) or np.ptp(u) > 0.0:
        return []
    read = {name: values[np.isfinite(values)] for name, values in channels.items() if name not in ("u", "r")}
    moving = [n for n, v in read.items() if len(v) > 1 and np.ptp(v) > 0.0 and np.std(np.diff(v)) < np.std(v)]
    if not moving:
        return []
    size = f"constant, {u[0]:.6g} {unit}," if u[0] else "0 from beginning to end"
    none = "" if u[0] else " If nothing was commanded, say recording.command=none."
    return [f"The command u is {size} while {' and '.join(moving)} moves: check that u is the command's column.{none}"]


def clipping(name: str, values: Floats) -> str | None:
    """Say that a channel is clipped, or return None."""
    for word, mask in clipped(values):
        limit, share = float(values[mask][0]), 100 * float(mask.mean())
        return f"Channel {name} is clipped at its {word} ({limit:.6g}) in {share:.2g} % of the samples; kept."
    return None


def clipped(values: Floats) -> list[tuple[str, np.ndarray]]:
    """The ends at which a channel is clipped: ``top`` or ``bottom``, and (N,) which samples are.

    Clipped is what runs into its own extreme at speed, stays there and leaves it at speed: the motion went on beyond.
    What comes to rest at its extreme (the last steps are small, or become smaller as those of a motion that friction
    ends, or it sets off slowly, as all that has mass), or only ever takes a few levels (a command of steps), is not.
    """
    top, bottom = values.max(), values.min()
    if top == bottom or len(np.unique(values[:: max(1, len(values) // 5000)])) <= 20:
        return []
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0.0]
    at_speed = max(LIMIT_SPEED * float(np.sqrt(np.mean(moving**2))), LIMIT_COUNTS * float(moving.min()))
    found = []
    for limit, word in ((top, "top"), (bottom, "bottom")):
        stays = [run for run in runs(values == limit) if run[1] - run[0] >= 3 and not _rests(values, *run)]
        mask = np.zeros(len(values), dtype=bool)
        for start, stop in stays:
            mask[start:stop] = True
        # the step at the limit is cut short by it: the one beside it tells the speed as well
        entries = [steps[max(start - 2, 0) : start].max() for start, _ in stays if start > 0]
        exits = [steps[stop - 1 : stop + 1].max() for _, stop in stays if stop < len(values)]
        if mask.sum() < CLIPPED_SHARE * len(values) or not entries:
            continue
        if all(float(np.median(speeds)) > at_speed for speeds in (entries, exits) if speeds):
            found.append((word, mask))
    return found


def _rests(values: Floats, start: int, stop: int) -> bool:
    """Whether what stays at its extreme in ``[start, stop)`` came to rest there: it slowed down, and stays for long."""
    if start < REST_SAMPLES + 2:
        return False
    # the step that reaches the limit is left out: a limit cuts it short
    slows = np.abs(np.diff(values[start - 2 - REST_SAMPLES : start - 1]))
    slope, _ = np.polyfit(np.arange(REST_SAMPLES), slows, 1)
    speed = max(float(slows.mean() + slope * (REST_SAMPLES + 1) / 2), 0.0)
    if slope >= 0.0:
        return False
    left = speed / -slope  # samples in which it would have stood still, or turned to be back after as many again
    beyond = 0.5 * speed * left
    return bool(beyond <= REST_BEYOND * np.ptp(values) and stop - start > REST_RETURNS * 2.0 * left)


def hanging(name: str, values: Floats, u: Floats | None, t_s: Floats, samples: int | None = None) -> str | None:
    """Note that a channel stands still while the input moves, or return None.

    ``samples`` : of the whole recording, where this is one stretch of it.

    Raises
    ------
    Refused : it never moves, or it hangs: it leaves with a jump, or not at all.
    """
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0.0]
    if not len(moving):
        if u is not None and np.ptp(u) == 0.0:
            return f"Channel {name} never changes, and neither does the input."
        raise Refused(f"channel {name} never changes")
    usual = float(np.quantile(moving, 0.999))
    samples = samples or len(values)
    at_least = max(20, int(HANGS_SHARE * samples))
    for start, stop in runs(steps == 0.0):
        length = stop - start
        if u is None or length < at_least or np.std(u[start:stop]) <= 0.5 * np.std(u):
            continue
        where = f"from {t_s[start]:.6g} to {t_s[stop]:.6g} s"
        jumps = stop < len(steps) and steps[stop] > JUMP * usual
        forever = stop == len(steps) and length > HANGS_END_SHARE * samples
        if jumps or forever:
            how = "and leaves with a jump" if jumps else "and never moves again"
            raise Refused(f"channel {name} hangs {where}: it does not change while the input moves, {how}")
        return f"Channel {name} stands still {where} while the input moves: a rest (friction, a gap), or it hangs."
    return None
