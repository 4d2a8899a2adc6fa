"""Defects of single channels: missing values, clipping, a sensor that hangs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtbacklash.recording.model import Floats, Refused

RUN_MAX = 10  # as many missing values in a row are interpolated
MISSING_SHARE_MAX = 0.05  # of all values that may be missing
TRIM_MAX = 0.3  # share of a recording that may be cut off for missing values at its ends
CLIPPED_SHARE = 0.002  # of all samples at the limit from which clipping is reported
HANGS_SHARE = 0.05  # of a recording that a channel must stand still for it to be looked at
HANGS_END_SHARE = 0.1
JUMP = 3.0  # a step away from standing still, relative to the largest usual step


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Half-open ranges in which ``mask`` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


@dataclass
class Filled:
    """Channels without missing values: the rows that remain, and what was done."""

    rows: slice
    channels: dict[str, Floats]
    notes: list[str]


def fill(channels: dict[str, Floats], t_s: Floats, required: frozenset[str]) -> Filled:
    """Interpolate short runs of missing values and cut off missing ends.

    Raises
    ------
    Refused : too many or too long runs in a channel; a required channel without values.
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
    good = {name: np.flatnonzero(np.isfinite(values)) for name, values in kept.items()}
    first = max(index[0] for index in good.values())
    last = min(index[-1] for index in good.values()) + 1
    cut = len(t_s) - max(last - first, 0)
    if cut > TRIM_MAX * len(t_s):
        raise Refused(
            f"the channels have values at the same time in {100 * (1 - cut / len(t_s)):.0f} % of the rows only"
        )
    if cut:
        notes.append(f"{cut} rows at the ends, where a channel has no value, were cut off.")
    inside = slice(int(first), int(last))
    filled = {name: _filled(name, values[inside], t_s[inside], notes) for name, values in kept.items()}
    return Filled(inside, filled, notes)


def _filled(name: str, values: Floats, t_s: Floats, notes: list[str]) -> Floats:
    missing = ~np.isfinite(values)
    count = int(missing.sum())
    if not count:
        return values
    start, stop = max(runs(missing), key=lambda run: run[1] - run[0])
    if stop - start > RUN_MAX:
        raise Refused(
            f"channel {name} has no value for {stop - start} samples in a row at t = {t_s[start]:.6g} s; up to "
            f"{RUN_MAX} can be interpolated"
        )
    if count > MISSING_SHARE_MAX * len(values):
        raise Refused(f"channel {name} has no value in {count} of {len(values)} rows")
    notes.append(
        f"Channel {name}: {count} missing value{'s' * (count > 1)} interpolated, at most {stop - start} in a row."
    )
    return np.interp(t_s, t_s[~missing], values[~missing])


def clipping(name: str, values: Floats) -> str | None:
    """Say that a channel is clipped, or return None.

    Clipped is what runs into its own extreme at speed and stays there. What comes to rest at its extreme
    (the last steps are small), or only ever takes a few levels (a command of steps), is not.
    """
    top, bottom = values.max(), values.min()
    if top == bottom or len(np.unique(values[:: max(1, len(values) // 5000)])) <= 20:
        return None
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0.0]
    usual, quantum = float(np.sqrt(np.mean(moving**2))), float(moving.min())
    for limit, word in ((top, "top"), (bottom, "bottom")):
        stays = [run for run in runs(values == limit) if run[1] - run[0] >= 3]
        count = sum(stop - start for start, stop in stays)
        entries = [steps[start - 1] for start, _ in stays if start > 0]
        if count < CLIPPED_SHARE * len(values) or not entries:
            continue
        if float(np.median(entries)) > max(0.2 * usual, 1.5 * quantum):
            share = 100 * count / len(values)
            return f"Channel {name} is clipped at its {word} ({limit:.6g}) in {share:.2g} % of the samples; kept."
    return None


def hanging(name: str, values: Floats, u: Floats | None, t_s: Floats) -> str | None:
    """Note that a channel stands still while the input moves, or return None.

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
    at_least = max(20, int(HANGS_SHARE * len(values)))
    for start, stop in runs(steps == 0.0):
        length = stop - start
        if u is None or length < at_least or np.std(u[start:stop]) < 0.5 * np.std(u):
            continue
        where = f"from {t_s[start]:.6g} to {t_s[stop]:.6g} s"
        jumps = stop < len(steps) and steps[stop] > JUMP * usual
        forever = stop == len(steps) and length > HANGS_END_SHARE * len(values)
        if jumps or forever:
            how = "and leaves with a jump" if jumps else "and never moves again"
            raise Refused(f"channel {name} hangs {where}: it does not change while the input moves, {how}")
        return f"Channel {name} stands still {where} while the input moves: a rest (friction, a gap), or it hangs."
    return None
