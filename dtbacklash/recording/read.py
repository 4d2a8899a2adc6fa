"""Reads a recording: finds file, channels and clock, checks all of them, and says what it found."""

from __future__ import annotations

from collections.abc import Mapping as Dict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.errors import UserError
from dtbacklash.recording import channels as checks
from dtbacklash.recording import locate, timebase, units
from dtbacklash.recording.command import HELD
from dtbacklash.recording.mapping import Mapping, load_mapping, mapping_names
from dtbacklash.recording.model import Floats, Recording, Refused, split
from dtbacklash.recording.plausible import Expectation, check_units, expectations
from dtbacklash.recording.tables import Table, load, read_table

if TYPE_CHECKING:
    from dtbacklash.physics.rig import Rig

COMMAND, REFERENCE = "u", "r"


@dataclass
class _Picked:
    """Columns chosen as channels, in SI, before any check."""

    t_s: Floats | None
    sample_time_s: float | None
    channels: dict[str, Floats]
    units: dict[str, str]
    notes: list[str]


def read_recording(
    source: str | Path,
    mapping: str | None = None,
    *,
    path: str | None = None,
    part: str | None = None,
    rig: Rig | None = None,
    expect: Dict[str, Expectation] | None = None,
    sample_time_s: float | None = None,
) -> Recording:
    """Read and check a recording.

    Parameters
    ----------
    source : the path of a file with plain columns; or the name of a mapping, ``name:part`` for one of its parts.
    mapping : a mapping to read the file ``source`` with.
    path : the file of a mapping, where it is not in the usual places; or the name of one of its public files.
    part : the part of the mapping to use; None: its part ``train`` if it has one, else all; "": all.
    rig : tells which sensors there are and in which units, and what signals to expect.
    expect : channel -> rms size or nominal signal (SI), in addition to what the rig lets expect.
    sample_time_s : for a file without a time column.

    Raises
    ------
    UserError : with the key ``recording`` or ``recording.path``: nothing there, nothing readable, or a
        defect that cannot be handled.
    """
    if mapping is not None:
        source, path = mapping, str(source)
    file, found, asked, key = locate.resolve(str(source), path)
    try:
        return _read(file, found, part if part is not None else asked or None, rig, expect, sample_time_s)
    except Refused as refusal:
        raise UserError(key, file.name if key == "recording.path" else source, str(refusal)) from refusal


def read_pair(
    source: str | Path,
    validation: str | Path | None = None,
    share: float = 0.3,
    *,
    path: str | None = None,
    rig: Rig | None = None,
    sample_time_s: float | None = None,
) -> tuple[Recording, Recording]:
    """Read what to fit and what to judge on.

    To judge on is ``validation`` (a file like ``source``, or a mapping's name or part); without it the last
    ``share`` of the recording.

    Raises
    ------
    UserError : as :func:`read_recording`; for the second recording with the key ``validation``.
    """
    recording = read_recording(source, path=path, rig=rig, sample_time_s=sample_time_s)
    if validation is None:
        return split(recording, share)
    name = str(source).partition(":")[0]
    mapped = not Path(str(source)).is_file() and name in mapping_names()
    own = mapped and (Path(str(validation)).is_file() or str(validation) in load_mapping(name).files)
    try:
        held_out = read_recording(
            validation, name if own else None, part="" if own else None, rig=rig, sample_time_s=sample_time_s
        )
    except UserError as error:
        raise UserError("validation", validation, error.allowed) from error
    step = recording.sample_time_s
    if abs(held_out.sample_time_s / step - 1.0) > timebase.UNIFORM:
        raise UserError("validation", validation, f"must have the recording's sample time {step:.6g} s")
    missing = set(recording.channels) - set(held_out.channels)
    if missing:
        raise UserError("validation", validation, f"lacks the recording's channel {min(missing)}")
    return recording, held_out


def _read(
    file: Path,
    mapping: Mapping | None,
    part: str | None,
    rig: Rig | None,
    expect: Dict[str, Expectation] | None,
    sample_time_s: float | None,
) -> Recording:
    content = load(file)
    table = read_table(content, file.name)
    public = mapping.files.get(file.name.removesuffix(".gz")) if mapping else None
    if public is not None and not locate.is_genuine(content, public):
        table.notes.append(f"{file.name} differs from the published file (SHA-256).")
    if mapping is not None and part is None:
        part = "train" if "train" in mapping.parts else ""
    picked = _mapped(table, mapping, part or "") if mapping else _plain(table, rig)
    _check_present(picked, rig)
    step = sample_time_s or picked.sample_time_s
    rows = len(next(iter(picked.channels.values())))
    if picked.t_s is not None:
        grid = timebase.uniform_grid(picked.t_s)
    elif step is not None:
        grid = timebase.constant_step(rows, step)
    else:
        raise Refused("has no time column: add a column t [s], or give the sample time")
    required = frozenset({COMMAND, *(rig.sensors if rig else ())})
    filled = checks.fill({n: v[grid.rows] for n, v in picked.channels.items()}, grid.stamps_s, required)
    t_s, values = _on_grid(grid, filled)
    notes = table.notes + picked.notes + grid.notes + filled.notes + _defects(values, t_s)
    recording = Recording(
        name=mapping.name if mapping else file.name,
        source=file,
        sample_time_s=grid.sample_time_s,
        t_s=t_s,
        channels=values,
        units={name: picked.units[name] for name in values},
        notes=notes,
        citation=mapping.citation if mapping else "",
        licence=mapping.licence if mapping else "",
        rig=mapping.rig if mapping else None,
        splits=dict(mapping.parts) if mapping else {},
        part=part or "",
        command=mapping.command if mapping else HELD,
    )
    check_units(recording, {**(expectations(rig, recording) if rig else {}), **(expect or {})})
    return recording


def _plain(table: Table, rig: Rig | None) -> _Picked:
    """Channels by their names."""
    sensors = {s.name: s.unit for s in rig.sensors.values()} if rig else {}
    picked = _Picked(None, table.constants.get("dt"), {}, {}, [])
    unused = []
    for column, values in table.columns.items():
        inner = column.rpartition(".")[2]  # of a structure
        found = units.parse(inner, sensors, table.units.get(column, ""))
        if found is None:
            unused.append(column)
            continue
        name, unit, factor = found
        wanted = units.plain_si(name, sensors)
        if unit != wanted:
            raise Refused(f"column {column} is in {unit}, and {name} is measured in {wanted}")
        if name in picked.channels or (name == "t" and picked.t_s is not None):
            raise Refused(f"has two columns for {name}")
        if name == "t":
            picked.t_s = values * factor
        else:
            picked.channels[name], picked.units[name] = values * factor, unit
    if unused:
        shown = ", ".join(unused[:8]) + (" ..." if len(unused) > 8 else "")
        picked.notes.append(f"Columns that are no channels of the rig are not used: {shown}.")
    r, u = picked.channels.get(REFERENCE), picked.channels.get(COMMAND)
    if (
        r is not None and u is not None and np.allclose(r * 1e3, u, rtol=1e-12, atol=0.0)
    ):  # open loop: the reference is the command
        picked.channels[REFERENCE], picked.units[REFERENCE] = u, "V"
    return picked


def _mapped(table: Table, mapping: Mapping, part: str) -> _Picked:
    """Channels by a mapping, cut to one of its parts."""
    rows = slice(*mapping.parts[part]) if part else slice(None)
    if part and mapping.parts[part][1] > table.rows:
        raise Refused(f"has {table.rows} rows, and the part {part} ends at row {mapping.parts[part][1]}")
    columns = {name: values[rows] for name, values in table.columns.items()}
    by_lower = {name.lower(): values for name, values in columns.items()}

    def column(name: str) -> Floats:
        values = columns.get(name, by_lower.get(name.lower()))
        if values is None:
            known = ", ".join(list(columns)[:12])
            raise Refused(f"has no column {name}, which the mapping {mapping.name} needs; it has {known}")
        return values

    time = mapping.time
    return _Picked(
        column(time.column) * time.scale if time else None,
        mapping.sample_time_s,
        {name: column(channel.column) * channel.scale for name, channel in mapping.channels.items()},
        {name: channel.unit for name, channel in mapping.channels.items()},
        list(mapping.notes),
    )


def _check_present(picked: _Picked, rig: Rig | None) -> None:
    names = list(picked.channels)
    has = "it has " + ", ".join(names) if names else "it has none of the names t, u, theta_m, q3, ..."
    if COMMAND not in picked.channels:
        raise Refused(f"lacks the column {COMMAND} (the command); {has}")
    sensors = [name for name in names if name not in (COMMAND, REFERENCE)]
    if rig is not None:
        sensors = [name for name in sensors if name in rig.sensors]
        if not sensors:
            raise Refused(f"holds none of the sensors of {rig.config.name} ({', '.join(rig.sensors)}); {has}")
    if not sensors:
        raise Refused(f"lacks a measured channel beside the command; {has}")


def _on_grid(grid: timebase.Grid, filled: checks.Filled) -> tuple[Floats, dict[str, Floats]]:
    stamps = grid.stamps_s[filled.rows]
    if not grid.resample:
        t_s = grid.t_s[filled.rows]
        values = filled.channels
    else:
        slack = 1e-6 * grid.sample_time_s
        t_s = grid.t_s[(grid.t_s >= stamps[0] - slack) & (grid.t_s <= stamps[-1] + slack)]
        values = {name: np.interp(t_s, stamps, column) for name, column in filled.channels.items()}
    timebase.check_length(len(t_s))
    return t_s, {name: np.ascontiguousarray(column) for name, column in values.items()}


def _defects(values: dict[str, Floats], t_s: Floats) -> list[str]:
    found = []
    for name, column in values.items():
        if name == REFERENCE:
            continue
        clipped = checks.clipping(name, column)
        found.append(clipped)
        if name != COMMAND and clipped is None:
            found.append(checks.hanging(name, column, values.get(COMMAND), t_s))
    return [note for note in found if note]
