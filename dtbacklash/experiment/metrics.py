"""How good a response is: overshoot, settling time and peak voltage of every move of the reference.

Overshoot and settling time refer to the size of the move; the settling band is 1 % by default, the band
under which the paper's own numbers come out (30 ms, 3.5 s, 0.8 s).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

MOVE_COLUMNS = ["move", "t_s", "from_mm", "to_mm", "overshoot_pct", "settling_time_s", "peak_voltage_v"]

#: a reference counts as piecewise constant around a change if it holds this long before and after it, s
HOLD_S = 0.1


class StepMetrics(NamedTuple):
    """What one move did. `settling_time_s` is NaN if the response does not stay in the band."""

    overshoot_pct: float
    settling_time_s: float
    peak_voltage_v: float


def step_metrics(
    t_s: ArrayLike, y: ArrayLike, u: ArrayLike, target: float, start: float = 0.0, *, band: float = 0.01
) -> StepMetrics:
    """Measure one move from ``start`` to ``target``, which begins at ``t_s[0]``.

    t_s, y, u : (n,) times, s, increasing; response, in the unit of ``target``; control voltage, V; n >= 1.
    band : half-width of the settling band, as a share of the move's size ``|target - start|``.

    Returns the overshoot beyond the target (percent of the size, >= 0), the time, s, after which the response stays in
    the band (interpolated between samples; NaN if it is outside at the end), and the largest ``|u|``, V.

    Raises ValueError: the arrays are empty or differ in length, the move has no size, the band is not positive.
    """
    t, response, voltage = (np.asarray(a, dtype=float) for a in (t_s, y, u))
    size = abs(target - start)
    if not (t.ndim == 1 and t.size and t.shape == response.shape == voltage.shape):
        raise ValueError(f"t_s, y, u: one length for all, not {t.shape}, {response.shape}, {voltage.shape}")
    if not (size > 0 and math.isfinite(size)):
        raise ValueError(f"target={target}: must differ from start={start}, both finite")
    if not band > 0:
        raise ValueError(f"band={band}: must be positive")
    error = (response - target) / (target - start)  # -1 at the start, 0 at the target, > 0 beyond it
    return StepMetrics(
        overshoot_pct=float(100.0 * np.maximum(error.max(), 0.0)),
        settling_time_s=_settling_time(t, np.abs(error), band),
        peak_voltage_v=float(np.abs(voltage).max()),
    )


def _settling_time(t: NDArray[np.float64], distance: NDArray[np.float64], band: float) -> float:
    """Time from t[0] until `distance` enters the band for good; NaN if it ends outside (or is NaN there)."""
    outside = np.flatnonzero(~(distance <= band))  # written so that a NaN counts as outside
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    if last == t.size - 1:
        return math.nan
    before, after = distance[last], distance[last + 1]
    share = (before - band) / (before - after) if math.isfinite(before) else 1.0
    return float(t[last] + share * (t[last + 1] - t[last]) - t[0])


def move_table(trace: pd.DataFrame, band: float = 0.01) -> pd.DataFrame:
    """The table of moves: one row for each step of the reference, or trajectory from one rest to another.

    A change counts as a move if the reference holds for ``HOLD_S`` before and after it. Before the trace the reference
    rests at 0 mm, so that one that begins elsewhere has a move at its first sample. One that changes all the time
    (multisine, ramp) has no moves. Each move is judged from where it sets out up to the next change of the reference.

    trace : columns ``t_s, r_mm, q3_mm, u_v``, one row a sample. band : settling band as a share of the move.

    Returns ``MOVE_COLUMNS``; ``settling_time_s`` is NaN where the response does not settle before the next change.
    """
    t, r, q3, u = (trace[name].to_numpy(dtype=float) for name in ("t_s", "r_mm", "q3_mm", "u_v"))
    rows: list[tuple[float, ...]] = []
    for begin, end, there in _moves(t, r):
        start, target = (r[begin - 1] if begin else 0.0), r[there]
        found = step_metrics(t[begin:end], q3[begin:end], u[begin:end], target, start, band=band)
        rows.append((len(rows) + 1, t[begin], start, target, *found))
    kinds = {name: "int64" if name == "move" else "float64" for name in MOVE_COLUMNS}
    return pd.DataFrame(rows, columns=MOVE_COLUMNS).astype(kinds)


def _moves(t: NDArray[np.float64], r: NDArray[np.float64]) -> list[tuple[int, int, int]]:
    """Sample ranges [begin, end) of the moves, and where r arrives: a change that is held before and after it."""
    if t.size < 2:
        return []
    # a reference read from a file may carry rounding noise: 1e-9 of its range is no change
    tolerance = 1e-9 * float(np.abs(r).max())
    changing = np.flatnonzero(np.abs(np.diff(r, prepend=0.0)) > tolerance)
    if not changing.size:
        return []
    # a trajectory changes from one sample to the next: it is one move
    apart = np.flatnonzero(np.diff(changing) > 1)
    begins, there = changing[np.append(0, apart + 1)], changing[np.append(apart, changing.size - 1)]
    edges = np.append(begins, t.size)
    # the last held stretch ends with the last sample; before the trace the reference rests for ever
    ends_s = np.append(t[begins[1:]], t[-1])
    before_s = np.concatenate([[-np.inf], t[there[:-1]]])
    # half a sample of slack: a hold of exactly 0.1 s counts whatever the rounding of the time axis
    hold = HOLD_S - 0.5 * (t[1] - t[0])
    held = (ends_s - t[there] >= hold) & (t[begins] - before_s >= hold) & (r[there] != np.append(0.0, r)[begins])
    return [(int(edges[i]), int(edges[i + 1]), int(there[i])) for i in np.flatnonzero(held)]


def tracking_rms_mm(trace: pd.DataFrame) -> float:
    """Root mean square of r - q3 [mm] over the whole trace (columns `r_mm`, `q3_mm`), for any reference."""
    error = trace["r_mm"].to_numpy(dtype=float) - trace["q3_mm"].to_numpy(dtype=float)
    return float(np.sqrt(np.mean(error**2)))


def signal_range(values: ArrayLike) -> dict[str, float | None]:
    """Lowest, highest and root mean square of a signal, in its unit; None of a signal that is nowhere finite."""
    x = np.asarray(values, dtype=float)
    x = x[np.isfinite(x)]
    if not x.size:
        return {"lowest": None, "highest": None, "rms": None}
    return {"lowest": float(x.min()), "highest": float(x.max()), "rms": float(np.sqrt(np.mean(x**2)))}
