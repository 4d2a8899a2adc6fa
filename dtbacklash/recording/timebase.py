"""The time column: is it a clock, and which rows lie on a uniform grid?"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.recording.refusal import SAMPLES_MIN, Refused

UNIFORM = 1e-3  # steps that differ by less, relative, are those of one clock
JITTER_MAX = 0.45  # steps that are shorter by more are odd
MISSING_MAX = 10  # as many missing samples in a row are interpolated; more are a gap
ODD_SHARE_MAX = 0.05  # of all steps that may be longer than the usual one, or shorter
ROUNDED_MAX = 0.6  # of its last digit, by which a rounded time may be off: a half, and what the fitted clock is off
COARSE_MAX = 0.5 / (ROUNDED_MAX - 0.5)  # steps in a last digit: more would hide a lost sample, which is half a step off
BAD_STAMPS_MAX = 0.01  # of all rows that may have no time or that of the row before
STRETCH_MIN = 0.5  # stretches without a gap that are long enough must hold this share of the samples


class Uneven(Refused):
    """Times that are no uniform grid, whatever single rows are amiss."""


@dataclass
class Grid:
    """Rows of the file to use and the uniform times to bring them to.

    rows : indices into the file's rows. stamps_s : their recorded times.
    pieces : the rows between two gaps, as half-open ranges of ``rows``, and the (N,) uniform times of each.
    resample : whether values must be interpolated from ``stamps_s`` to those times.
    """

    rows: np.ndarray
    stamps_s: Floats
    pieces: list[tuple[int, int, Floats]]
    sample_time_s: float
    resample: bool
    notes: list[str]


def constant_step(rows: int, sample_time_s: float) -> Grid:
    """The grid of a recording without a time column."""
    check_length(rows)
    t_s = np.arange(rows) * np.float64(sample_time_s)
    return Grid(np.arange(rows), t_s, [(0, rows, t_s)], sample_time_s, False, [])


def uniform_grid(stamps_s: Floats) -> Grid:
    """Find the uniform grid behind recorded times.

    Small defects (rounded stamps, jitter, a few missing or double samples) are repaired and noted; a gap
    begins a new piece.

    Raises
    ------
    Refused : time runs backwards or stands still; too little between gaps; too few samples. Uneven : no uniform grid.
    """
    notes: list[str] = []
    rows = np.flatnonzero(np.isfinite(stamps_s))
    lost = len(stamps_s) - len(rows)
    if lost > BAD_STAMPS_MAX * len(stamps_s):
        raise Refused(f"{lost} of {len(stamps_s)} rows have no time")
    if lost:
        notes.append(f"{_count(lost, 'row')} without a time {_were(lost)} dropped.")
    check_length(len(rows))
    t = stamps_s[rows]
    _check_forward(t, rows)
    grid = _rounded(rows, t, notes)
    if grid is not None:
        return grid
    double = np.flatnonzero(np.diff(t) == 0.0) + 1
    if len(double) > BAD_STAMPS_MAX * len(t):
        raise Refused(
            f"{len(double)} of {len(t)} rows repeat the time of the row before: it has too few digits; if the rows are "
            "uniform, say so in a mapping without `time`: `sample_time_s: SECONDS`"
        )
    if len(double):
        rows, t = np.delete(rows, double - 1), np.delete(t, double - 1)
        notes.append(f"Of {_count(len(double), 'pair')} of rows at one time the later one counts.")
    return _repaired(rows, t, notes)


def of_the_grid(t_s: Floats) -> np.ndarray | None:
    """(N,) which rows make a uniform grid, where others lie at the same times or in between; None where none do.

    A simulation writes its grid, and a row before and after each event.
    """
    steps = np.diff(t_s)
    steps = steps[steps > 0.0]
    if len(steps) < SAMPLES_MIN or (len(steps) == len(t_s) - 1 and steps.min() > 0.5 * np.median(steps)):
        return None
    bins = np.round(steps / (UNIFORM * steps.max())).astype(np.int64)
    usual = float(np.median(steps[bins == np.bincount(bins).argmax()]))
    count = round(float(t_s[-1] - t_s[0]) / usual)
    at = (t_s - t_s[0]) / (t_s[-1] - t_s[0]) * count
    on = np.abs(at - np.rint(at)) < UNIFORM
    return on if len(np.unique(np.rint(at[on]))) == count + 1 else None


def check_length(samples: int) -> None:
    """Refuse a recording that is too short (raises Refused)."""
    if samples < SAMPLES_MIN:
        raise Refused(f"is too short: {samples} samples, at least {SAMPLES_MIN} are needed")


def _check_forward(t: Floats, rows: np.ndarray) -> None:
    back = np.flatnonzero(np.diff(t) < 0.0)
    if len(back):
        k = back[0]
        times = "once" if len(back) == 1 else f"{len(back)} times"
        raise Refused(
            f"time runs backwards {times}, first in row {rows[k] + 2} (from {t[k]:.6g} s to {t[k + 1]:.6g} s)"
        )


def _rounded(rows: np.ndarray, t: Floats, notes: list[str]) -> Grid | None:
    """The grid if the stamps are those of a uniform clock, written with the digits they have; else None."""
    step = (t[-1] - t[0]) / (len(t) - 1)
    if step <= 0.0:
        raise Refused("time stands still")
    line = t[0] + step * np.arange(len(t))
    off = float(np.abs(t - line).max())
    if off > UNIFORM * step:
        steps = np.diff(t)
        if np.mean(np.abs(steps - np.median(steps)) > UNIFORM * step) < ODD_SHARE_MAX:
            return None  # rounding shows everywhere; here single rows are amiss
        digits = next((d for d in range(10) if np.abs(t - np.round(t, d)).max() < 1e-9 * max(1.0, abs(t[-1]))), None)
        if digits is None or digits > 8:
            return None
        k = np.arange(len(t))
        step, start = np.polyfit(k, t, 1)
        off = float(np.abs(t - (start + step * k)).max())
        if off > ROUNDED_MAX * 10.0**-digits or 10.0**-digits >= COARSE_MAX * step:
            return None
        line = start + step * k
        notes.append(
            f"The times are rounded to {10.0**-digits:g} s; the samples are taken as uniform, {step:.6g} s apart."
        )
    return Grid(rows, t, [(0, len(t), line)], float(step), False, notes)


def _repaired(rows: np.ndarray, t: Floats, notes: list[str]) -> Grid:
    """Cut at gaps, then resample."""
    steps = np.diff(t)
    usual = float(np.median(steps))
    long = steps > 1.5 * usual
    if long.mean() > ODD_SHARE_MAX:
        raise Uneven(f"sampling is uneven: steps from {steps.min():.3g} to {steps.max():.3g} s")
    bounds = _between_gaps(t, (MISSING_MAX + 1.5) * usual, notes)
    inside = np.ones(len(steps), dtype=bool)
    inside[[a - 1 for a, _ in bounds if a > 0]] = False
    inside[[b - 1 for _, b in bounds if b < len(t)]] = False
    short = steps < (1.0 - JITTER_MAX) * usual
    if short.mean() > ODD_SHARE_MAX:
        raise Uneven(f"sampling is uneven: steps from {steps[~long].min():.3g} to {steps[~long].max():.3g} s")
    # a sample that came late, with the next ones in time again, is not missing: short steps make up for the long one
    missing = max(0, int(np.round(steps[(long | short) & inside] / usual - 1.0).sum()))
    if missing:
        notes.append(f"{_count(missing, 'missing sample')} {_were(missing)} interpolated.")
    spread = float(np.abs(steps[~long & inside] / usual - 1.0).max())
    counts = [round((t[b - 1] - t[a]) / usual) for a, b in bounds]
    step = float(sum(t[b - 1] - t[a] for a, b in bounds) / sum(counts))
    if spread > UNIFORM:
        notes.append(
            f"Sampling is uneven by up to {100 * spread:.2g} % of a step; the channels were resampled linearly to "
            f"{step:.6g} s."
        )
    pieces = [(a, b, t[a] + step * np.arange(n + 1)) for (a, b), n in zip(bounds, counts, strict=True)]
    return Grid(rows, t, pieces, step, bool(missing) or spread > UNIFORM, notes)


def _between_gaps(t: Floats, gap_s: float, notes: list[str]) -> list[tuple[int, int]]:
    """Half-open ranges of rows between steps longer than ``gap_s``, those that are long enough."""
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > gap_s)
    if not len(gaps):
        return [(0, len(t))]
    cuts = [0, *(gaps + 1).tolist(), len(t)]
    found = [(a, b) for a, b in pairwise(cuts) if b - a >= SAMPLES_MIN]
    used = sum(b - a for a, b in found)
    widest = gaps[np.argmax(steps[gaps])]
    what = f"{_count(len(gaps), 'gap')}, the widest {steps[widest]:.3g} s at t = {t[widest]:.6g} s"
    if used < STRETCH_MIN * len(t):
        raise Refused(
            f"has {what}; stretches of at least {SAMPLES_MIN} samples between them hold {100 * used / len(t):.0f} % of "
            "it"
        )
    notes.append(f"There {'is' if len(gaps) == 1 else 'are'} {what}.")
    return found


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")


def _were(number: int) -> str:
    return "was" if number == 1 else "were"
