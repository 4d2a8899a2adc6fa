"""The two inputs of an experiment over time: the reference r and the gap of the gear.

Every function takes the sample times ``t_s`` (shape ``(N + 1,)``, seconds, increasing from 0) and returns an
array of the same shape. Files are checked row by row before anything is simulated.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from dtbacklash.config.run import ProfileConfig, ReferenceConfig
from dtbacklash.errors import UserError

Array = NDArray[np.float64]

#: columns of a command, as a recording has them: s, and the unit of the rig's command
COMMAND = ("t", "u")
GAP_LIMIT_DEG = 360.0  # a gap of more than a turn is a mistake of unit
REGULAR_SHARE = 0.9  # a file is regularly sampled if this share of its time steps equals their median ...
HOLE_FACTOR = 1.5  # ... and then a longer step than this times the median is a hole
REGULAR_ROWS = 10
EDGE = 1e-9  # relative to the period: a sample at k*period belongs to the next period despite rounding


def reference(config: ReferenceConfig, t_s: Array, seed: int = 0, command: bool = False) -> Array:
    """Return r at ``t_s`` in mm, shape of ``t_s``.

    command : whether r is the rig's command, as in open loop; a file may then have the columns ``t,u`` of a recording.

    Raises UserError: a CSV that is unreadable, has NaN, holes, or does not cover ``t_s`` (key ``reference.path``).
    """
    if config.kind == "csv" or (config.kind == "trajectory" and config.path is not None):
        columns = COMMAND if command and has_command(config.path) else ("t_s", "r_mm")
        times_s, values_mm = read_columns("reference.path", config.path, columns, t_s)
        if config.interpolation == "linear" or config.kind == "trajectory":
            return np.interp(t_s, times_s, values_mm)
        tolerance_s = EDGE * max(1.0, float(t_s[-1]))
        row = np.searchsorted(times_s, t_s + tolerance_s, side="right") - 1
        return np.asarray(values_mm[row])
    return config.offset_mm + _REFERENCES[config.kind](config, t_s, seed)


def has_command(path: str | None) -> bool:
    """Whether a CSV file has the columns of a command, ``t,u``; not where it cannot be read."""
    try:
        with Path(path or "").open(encoding="utf-8-sig") as file:
            names = [name.strip() for name in file.readline().split(",")]
    except (OSError, ValueError):
        return False
    return all(name in names for name in COMMAND)


def span_of(key: str, path: str, step_s: float) -> tuple[float, float]:
    """Duration and sample time of a file with a command, s.

    step_s : of a file that has no sample time of its own, being written by hand. Raises UserError as a reference does.
    """
    times_s, _ = _read_pair(key, path, COMMAND)
    steps = np.diff(times_s)
    median = float(np.median(steps))
    step_s = median if _regular(steps) else step_s
    samples = int((times_s[-1] - times_s[0]) / step_s + REGULAR_SHARE)
    return samples * step_s, step_s


def gap_profile(config: ProfileConfig, t_s: Array) -> Array:
    """Return the gap at ``t_s`` in degrees (>= 0), shape of ``t_s``.

    The growing kinds go from ``start_deg`` to ``end_deg`` between ``t_start_s`` and ``t_end_s`` by a growth
    law g(x), x = 0..1, g(0) = 0, g(1) = 1, and rest before and after: ``ramp`` g = x; ``s_curve`` the
    minimum-jerk g = 10x^3 - 15x^4 + 6x^5 (Flash and Hogan, 1985); ``step`` jumps at ``t_start_s``;
    ``wear`` see :func:`wear_growth`.

    Raises UserError: a CSV that is unreadable, has NaN, holes, a negative gap or one above 360 deg, or does not cover
    ``t_s`` (key ``profile.path``).
    """
    if config.kind == "csv":
        key, path = "profile.path", config.path
        times_s, gaps_deg = read_columns(key, path, ("t_s", "gap_deg"), t_s)
        _refuse(key, path, gaps_deg < 0, lambda j: f"gap_deg must not be negative; row {j + 1} has {gaps_deg[j]:g}")
        most = f"gap_deg must be at most {GAP_LIMIT_DEG:g} (in degrees)"
        _refuse(key, path, gaps_deg > GAP_LIMIT_DEG, lambda j: f"{most}; row {j + 1} has {gaps_deg[j]:g}")
        return np.interp(t_s, times_s, gaps_deg)
    if config.kind == "constant":
        return np.full(t_s.shape, float(config.start_deg))
    if config.kind == "step":
        return np.where(_reached(t_s, config.t_start_s), config.end_deg, config.start_deg).astype(float)
    x = np.clip((t_s - config.t_start_s) / (config.t_end_s - config.t_start_s), 0.0, 1.0)
    return config.start_deg + (config.end_deg - config.start_deg) * _GROWTHS[config.kind](config, x)


def wear_growth(config: ProfileConfig, x: Array) -> Array:
    """Return the classical three-phase wear curve g(x), from 0 at x = 0 to 1 at x = 1, never falling.

    Running-in saturates exponentially (its share of the growth is ``running_in_share``, its time constant
    ``running_in_span``), steady wear is linear, and severe wear (``severe_share``) grows with the cube of the
    time since ``severe_from``. Form after Kragelsky, Friction and Wear (1965): three phases of the wear rate.
    """
    running_in = np.expm1(-x / config.running_in_span) / np.expm1(-1.0 / config.running_in_span)
    severe = np.clip((x - config.severe_from) / (1.0 - config.severe_from), 0.0, None) ** 3
    steady_share = 1.0 - config.running_in_share - config.severe_share
    return np.asarray(config.running_in_share * running_in + steady_share * x + config.severe_share * severe)


def _square(config: ReferenceConfig, t_s: Array, seed: int) -> Array:
    half = np.floor(2.0 * t_s / config.period_s + EDGE).astype(np.int64)
    return np.where(half % 2 == 0, config.amplitude_mm, -config.amplitude_mm).astype(float)


def _trajectory(config: ReferenceConfig, t_s: Array, seed: int) -> Array:
    """The levels of the square wave, by moves of least jerk (Flash and Hogan, 1985)."""
    after = t_s - 0.5 * config.period_s * np.floor(2.0 * t_s / config.period_s + EDGE)
    x = np.clip(after / config.move_s, 0.0, 1.0)
    now = _square(config, t_s, seed)
    before = np.where(t_s < 0.5 * config.period_s * (1.0 - EDGE), 0.0, -now)
    return before + (now - before) * x**3 * (10.0 + x * (6.0 * x - 15.0))


def _step(config: ReferenceConfig, t_s: Array, seed: int) -> Array:
    return np.where(_reached(t_s, config.t_start_s), config.amplitude_mm, 0.0).astype(float)


def _staircase(config: ReferenceConfig, t_s: Array, seed: int) -> Array:
    tread = np.floor(t_s / config.dwell_s + EDGE) + 1.0  # the first step is at t = 0
    level = config.levels - np.abs(tread % (2 * config.levels) - config.levels)
    return np.asarray(config.step_mm * level)


def _multisine(config: ReferenceConfig, t_s: Array, seed: int) -> Array:
    """Sum equal harmonics of 1/period_s in the band, with random phases (Pintelon and Schoukens)."""
    first = int(np.ceil(config.f_min_hz * config.period_s - EDGE))
    last = int(np.floor(config.f_max_hz * config.period_s + EDGE))
    if last < max(first, 1):
        allowed = f"must be long enough for a line in the band {config.f_min_hz:g} to {config.f_max_hz:g} Hz"
        raise UserError("reference.period_s", config.period_s, allowed)
    lines = np.arange(max(first, 1), last + 1)
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, lines.size)
    total = np.zeros(t_s.shape)
    for line, phase in zip(lines, phases, strict=True):  # one line at a time: lines x samples would not fit
        total += np.cos(2.0 * np.pi * line / config.period_s * t_s + phase)
    return total * (config.rms_mm * np.sqrt(2.0 / lines.size))


_REFERENCES = {
    "square": _square,
    "trajectory": _trajectory,
    "step": _step,
    "staircase": _staircase,
    "multisine": _multisine,
}
_GROWTHS: dict[str, Callable[[ProfileConfig, Array], Array]] = {
    "ramp": lambda config, x: x,
    "s_curve": lambda config, x: x**3 * (10.0 + x * (6.0 * x - 15.0)),
    "wear": wear_growth,
}


def _reached(t_s: Array, at_s: float) -> NDArray[np.bool_]:
    """Whether ``t_s`` has reached ``at_s``, a sample on it included despite rounding."""
    return t_s >= at_s - EDGE * max(1.0, at_s)


def read_columns(key: str, path: str | None, columns: tuple[str, str], t_s: Array) -> tuple[Array, Array]:
    """Read two columns of a CSV file: the time, and a value that must be known over all of ``t_s``.

    Raises UserError: in the name of ``key``, with the row that is wrong.
    """
    times, values = _read_pair(key, path, columns)
    slack_s = EDGE * max(1.0, float(t_s[-1]))
    if times[0] > t_s[0] + slack_s or times[-1] < t_s[-1] - slack_s:
        span = f"{times[0]:g} to {times[-1]:g} s"
        raise UserError(key, path, f"covers {span}, but the run needs {t_s[0]:g} to {t_s[-1]:g} s")
    return times, values


def _read_pair(key: str, path: str | None, columns: tuple[str, str]) -> tuple[Array, Array]:
    """Two columns of a CSV file, the first of which increases without holes."""
    table = _read_csv(key, path, columns)
    times, values = (_finite_column(key, path, table[name]) for name in columns)
    if times.size < 2:
        raise UserError(key, path, "needs at least two rows")
    steps = np.diff(times)
    name = columns[0]
    _refuse(
        key, path, steps <= 0,
        lambda j: f"{name} must increase, but does not in row {j + 2} (t = {times[j + 1]:g} s)",
    )  # fmt: skip
    median = float(np.median(steps))
    # a few rows that were written by hand may have any spacing; a sampled file has no holes
    _refuse(
        key, path, _regular(steps) & (steps > HOLE_FACTOR * median),
        lambda j: f"has a hole from {times[j]:g} to {times[j + 1]:g} s; it is sampled every {median:g} s otherwise",
    )  # fmt: skip
    return times, values


def _regular(steps: Array) -> bool:
    """Whether a file is sampled: most of its time steps equal their median."""
    median = float(np.median(steps))
    return bool(steps.size >= REGULAR_ROWS and np.mean(np.abs(steps - median) <= 0.01 * median) >= REGULAR_SHARE)


def _read_csv(key: str, path: str | None, columns: tuple[str, str]) -> pd.DataFrame:
    wanted = ",".join(columns)
    if path is None or not Path(path).is_file():
        raise UserError(key, path, f"is not a file; give a CSV file with the columns {wanted}")
    as_text: dict[str, Any] = {"dtype": str, "keep_default_na": False, "index_col": False, "skipinitialspace": True}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # a row longer than the header is a mistake
            table = pd.read_csv(path, encoding="utf-8-sig", **as_text)
    except (OSError, ValueError, pd.errors.ParserWarning) as error:  # parser and decoding errors are ValueErrors
        reason = " ".join(str(error).split())[:80]
        raise UserError(key, path, f"is not a readable CSV file with the columns {wanted} ({reason})") from error
    table.columns = [str(name).strip() for name in table.columns]
    if any(list(table.columns).count(name) != 1 for name in columns):
        found = ",".join(table.columns)[:60]
        raise UserError(key, path, f"must have the columns {wanted} once each; it has {found}")
    return table


def _finite_column(key: str, path: str | None, column: pd.Series) -> Array:
    text = column.fillna("")
    values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float)
    said = f"{column.name} must be a finite number in every row"
    _refuse(key, path, ~np.isfinite(values), lambda j: f"{said}; row {j + 1} has {repr(str(text.iloc[j]))[:30]}")
    return values


def _refuse(key: str, path: str | None, wrong: NDArray[np.bool_], said: Callable[[int], str]) -> None:
    """Raise UserError at the first place where something is wrong, with what is ``said`` about its index."""
    if wrong.any():
        raise UserError(key, path, said(int(np.argmax(wrong))))
