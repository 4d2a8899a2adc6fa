"""The time column: is it a clock, and which rows lie on a uniform grid?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtbacklash.recording.model import SAMPLES_MIN, Floats, Refused

UNIFORM = 1e-3  # steps that differ by less, relative, are those of one clock
JITTER_MAX = 0.45  # steps that differ by more are refused
MISSING_MAX = 10  # as many missing samples in a row are interpolated; more are a gap
ODD_SHARE_MAX = 0.05  # of all steps that may be longer than the usual one
BAD_STAMPS_MAX = 0.01  # of all rows that may have no time or that of the row before
STRETCH_MIN = 0.5  # the longest stretch without a gap must hold this share of the samples
STEP_MAX_S = 0.1  # a mechanical rig is not recorded this slowly: the unit of the time is wrong


@dataclass
class Grid:
    """Rows of the file to use and the uniform times to bring them to.

    rows : indices into the file's rows. stamps_s : their recorded times. t_s : (N,) the uniform grid.
    resample : whether values must be interpolated from ``stamps_s`` to ``t_s``.
    """

    rows: np.ndarray
    stamps_s: Floats
    t_s: Floats
    sample_time_s: float
    resample: bool
    notes: list[str]


def constant_step(rows: int, sample_time_s: float) -> Grid:
    """The grid of a recording without a time column."""
    check_length(rows)
    _check_step(sample_time_s)
    t_s = np.arange(rows) * np.float64(sample_time_s)
    return Grid(np.arange(rows), t_s, t_s, sample_time_s, False, [])


def uniform_grid(stamps_s: Floats) -> Grid:
    """Find the uniform grid behind recorded times.

    Small defects (rounded stamps, jitter, a few missing or double samples) are repaired and noted; a gap
    leaves the longest stretch.

    Raises
    ------
    Refused : time runs backwards, stands still or is too uneven; gaps everywhere; too few samples.
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
            f"{len(double)} of {len(t)} rows repeat the time of the row before: is it written with enough digits?"
        )
    if len(double):
        rows, t = np.delete(rows, double), np.delete(t, double)
        verb = "repeats" if len(double) == 1 else "repeat"
        notes.append(
            f"{_count(len(double), 'row')} that {verb} the time of the row before {_were(len(double))} dropped."
        )
    return _repaired(rows, t, notes)


def check_length(samples: int) -> None:
    """Refuse a recording that is too short (raises Refused)."""
    if samples < SAMPLES_MIN:
        raise Refused(f"is too short: {samples} samples, at least {SAMPLES_MIN} are needed")


def _check_step(step_s: float) -> None:
    if step_s >= STEP_MAX_S:
        raise Refused(
            f"time advances by {step_s:.4g} s a sample, too slow for a machine: is it in ms or a row number? "
            "Name the column t_ms, or give the unit in a mapping"
        )


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
        if off > 0.6 * 10.0**-digits or 10.0**-digits >= step:
            return None
        line = start + step * k
        notes.append(
            f"The times are rounded to {10.0**-digits:g} s; the samples are taken as uniform, {step:.6g} s apart."
        )
    _check_step(step)
    return Grid(rows, t, line, float(step), False, notes)


def _repaired(rows: np.ndarray, t: Floats, notes: list[str]) -> Grid:
    """Drop what lies beyond gaps, then resample."""
    steps = np.diff(t)
    usual = float(np.median(steps))
    _check_step(usual)
    long = steps > 1.5 * usual
    if long.mean() > ODD_SHARE_MAX:
        raise Refused(f"sampling is uneven: steps from {steps.min():.3g} to {steps.max():.3g} s")
    gaps = np.flatnonzero(steps > (MISSING_MAX + 1.5) * usual)
    if len(gaps):
        bounds = np.concatenate(([0], gaps + 1, [len(t)]))
        longest = int(np.argmax(np.diff(bounds)))
        a, b = int(bounds[longest]), int(bounds[longest + 1])
        widest = gaps[np.argmax(steps[gaps])]
        what = f"{_count(len(gaps), 'gap')}, the widest {steps[widest]:.3g} s at t = {t[widest]:.6g} s"
        if b - a < STRETCH_MIN * len(t):
            raise Refused(f"has {what}; the longest stretch without one holds {100 * (b - a) / len(t):.0f} % of it")
        notes.append(
            f"There {'is' if len(gaps) == 1 else 'are'} {what}; only the longest stretch is used, {t[a]:.6g} to "
            f"{t[b - 1]:.6g} s."
        )
        rows, t = rows[a:b], t[a:b]
        check_length(len(t))
        steps = np.diff(t)
        long = steps > 1.5 * usual
    missing = int(np.round(steps[long] / usual - 1.0).sum())
    if missing:
        notes.append(f"{_count(missing, 'missing sample')} {_were(missing)} interpolated.")
    spread = float(np.abs(steps[~long] / usual - 1.0).max())
    if spread > JITTER_MAX:
        raise Refused(f"sampling is uneven: steps from {steps[~long].min():.3g} to {steps[~long].max():.3g} s")
    count = round((t[-1] - t[0]) / usual)
    step = float((t[-1] - t[0]) / count)
    if spread > UNIFORM:
        notes.append(
            f"Sampling is uneven by up to {100 * spread:.2g} % of a step; the channels were resampled linearly to "
            f"{step:.6g} s."
        )
    return Grid(rows, t, t[0] + step * np.arange(count + 1), step, bool(missing) or spread > UNIFORM, notes)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")


def _were(number: int) -> str:
    return "was" if number == 1 else "were"
