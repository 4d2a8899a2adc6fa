"""From chosen columns to channels on a uniform time grid: the clock, missing values, defects of sensors."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.choices import COMMANDS
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.recording import channels as checks
from dtbacklash.recording import timebase
from dtbacklash.recording.command import BAND_LIMITED, NONE
from dtbacklash.recording.heads import TIME
from dtbacklash.recording.pick import (
    ASSUMED,
    COMMAND,
    REFERENCE,
    Picked,
    check_present,
    unit_notes,
    without_command,
)
from dtbacklash.recording.refusal import CHANGE_MIN, VALUE_MAX, Refused
from dtbacklash.recording.series import events, on_grid, own_paces, paces_said, straight
from dtbacklash.recording.uneven import resample

SAID = 3  # as many stretches are told one by one
STEP_ASSUMED_MAX_S = 0.1  # nobody records a machine this slowly who does not say so: the unit of the time is wrong


def clean(
    picked: Picked, rig: Rig | None, notes: list[str], command: str, sample_time_s: float | None
) -> dict[str, Any]:
    """Bring the channels to a uniform grid and check them.

    Parameters
    ----------
    notes : what had to be said before. command : see :mod:`.command`. sample_time_s : for columns without times.

    Returns
    -------
    What a :class:`.model.Recording` holds of it, by the names of its fields.

    Raises
    ------
    Refused : a defect that cannot be handled.
    UserError : no such command.
    """
    if command not in COMMANDS:
        raise UserError("recording.command", command, "choose one of " + ", ".join(COMMANDS))
    if command == NONE:
        without_command(picked)
    check_present(picked, rig)
    with np.errstate(all="ignore"):  # squares of values like 1e-300 are zero; nothing here depends on them
        for name, column in {"t": picked.t_s, **picked.channels}.items():
            if column is not None:
                _check_sizes(name, column)
        apart = own_paces(picked) or events(picked)
        commands = {COMMAND, *(rig.config.commands if rig else ())}
        required, held = frozenset({*commands, *(rig.sensors if rig else ())}), {*commands, REFERENCE}
        try:
            grid = _grid(picked, sample_time_s)
        except timebase.Uneven:
            resample(picked, held, command == BAND_LIMITED)
            grid = _grid(picked, sample_time_s)
        pieces = [(a, b) for a, b, _ in grid.pieces]
        rows = {n: v[grid.rows] for n, v in picked.channels.items()}
        used, filled, lost = checks.fill(rows, grid.stamps_s, required, pieces)
        t_s, values, stretches = _on_grid(grid, used, filled)
        values |= {
            n: on_grid(own, t_s, grid.sample_time_s, n in held and command != BAND_LIMITED) for n, own in apart.items()
        }
        seldom = straight(apart[COMMAND], t_s, grid.sample_time_s) if COMMAND in apart else None
        said = paces_said({n: own for n, own in apart.items() if n not in picked.channels}, grid.sample_time_s, held)
        idle = [] if command == NONE or len(commands) > 1 else checks.idle_command(values, picked.units[COMMAND])
        notes = idle + notes + picked.notes + said + grid.notes + lost + _defects(values, t_s, stretches)
        if len(stretches) > 1:
            notes.append(_said(t_s, stretches))
    assumed = {name: said for name, said in picked.assumed.items() if name in values or name == "t"}
    return {
        "sample_time_s": grid.sample_time_s, "t_s": t_s, "channels": values, "stretches": stretches,
        "units": {name: picked.units[name] for name in values}, "assumed_units": assumed, "columns": picked.columns,
        "notes": notes + unit_notes(assumed), "straight": seldom,
    }  # fmt: skip


def _check_sizes(name: str, values: Floats) -> None:
    what = "the time" if name == "t" else f"channel {name}"
    if 0.0 < float(np.nanmax(values, initial=-np.inf) - np.nanmin(values, initial=np.inf)) < CHANGE_MIN:
        raise Refused(f"{what} never changes by more than {CHANGE_MIN:g}")
    large = np.flatnonzero(np.abs(values) > VALUE_MAX)  # an inf is no missing value
    if len(large):
        times = f", and {len(large) - 1} more like it" if len(large) > 1 else ""
        where = f"(SI) in row {large[0] + 1} of the numbers{times}"
        raise Refused(f"{what} is {values[large[0]]:.3g} {where}; at most {VALUE_MAX:g} is read")


def _grid(picked: Picked, sample_time_s: float | None) -> timebase.Grid:
    step = sample_time_s or picked.sample_time_s
    if picked.t_s is not None:
        grid = timebase.uniform_grid(picked.t_s)
        if sample_time_s and abs(grid.sample_time_s / sample_time_s - 1.0) > timebase.UNIFORM:
            allowed = f"the file has times, {grid.sample_time_s:.6g} s apart, and they count; leave it out"
            raise UserError("recording.sample_time_s", sample_time_s, allowed)
        if grid.sample_time_s >= STEP_ASSUMED_MAX_S and picked.assumed.get(TIME, "").endswith(f"({ASSUMED})"):
            raise Refused(
                f"time advances by {grid.sample_time_s:.4g} s a sample if it is in s, which nothing says: is it in ms, "
                "or a row number? Name the column t_s or t_ms, or give the unit in a mapping"
            )
        return grid
    if step is not None:
        if not 0.0 < step < np.inf:
            raise UserError("recording.sample_time_s", step, "must be positive s")
        return timebase.constant_step(len(next(iter(picked.channels.values()))), step)
    if picked.no_times:
        raise Refused(
            f"has no values in its time column {picked.no_times} (formulas that were never calculated?): fill it, or "
            "give recording.sample_time_s=SECONDS"
        )
    raise Refused(
        "has no time column: call it t [s], or name it in a mapping (time: COLUMN), or give "
        "recording.sample_time_s=SECONDS"
    )


def _on_grid(
    grid: timebase.Grid, used: list[tuple[int, int]], filled: dict[str, Floats]
) -> tuple[Floats, dict[str, Floats], tuple[tuple[int, int], ...]]:
    """Times, channels, and the stretches that they consist of. used : of the rows, half-open."""
    times, columns, ends = list[Floats](), {name: list[Floats]() for name in filled}, [0]
    slack = 1e-6 * grid.sample_time_s
    for first, last, t_s in grid.pieces:
        for a, b in ((a, b) for a, b in used if first <= a < last):
            stamps, t = grid.stamps_s[a:b], t_s[a - first : b - first]
            if grid.resample:
                t = t_s[(t_s >= stamps[0] - slack) & (t_s <= stamps[-1] + slack)]
            for name, column in filled.items():
                columns[name].append(np.interp(t, stamps, column[a:b]) if grid.resample else column[a:b])
            times.append(t)
            ends.append(ends[-1] + len(t))
    timebase.check_length(ends[-1])
    channels = {name: np.ascontiguousarray(np.concatenate(parts)) for name, parts in columns.items()}
    return np.concatenate(times), channels, tuple(pairwise(ends))


def _said(t_s: Floats, stretches: tuple[tuple[int, int], ...]) -> str:
    listed = [f"{t_s[a]:.6g} to {t_s[b - 1]:.6g} s" for a, b in stretches[:SAID]]
    more = f", and {len(stretches) - SAID} more" if len(stretches) > SAID else ""
    return f"{len(stretches)} stretches are used: {', '.join(listed)}{more}; together {len(t_s)} samples."


def _defects(values: dict[str, Floats], t_s: Floats, stretches: tuple[tuple[int, int], ...]) -> list[str]:
    found = []
    for name, read in values.items():
        if name == REFERENCE:
            continue
        column = read[np.isfinite(read)]
        clipped = checks.clipping(name, column)
        found.append(clipped)
        if name != COMMAND and clipped is None:
            u = values.get(COMMAND)
            for a, b in stretches if np.ptp(column) > 0.0 else [(0, len(t_s))]:
                here = a + np.flatnonzero(np.isfinite(read[a:b]))
                part = None if u is None else u[here]
                found.append(checks.hanging(name, read[here], part, t_s[here], len(t_s)))
    return [note for note in found if note]
