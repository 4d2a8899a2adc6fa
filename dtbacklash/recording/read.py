"""Reads a recording: finds file, channels and clock, checks all of them, and says what it found."""

from __future__ import annotations

from collections.abc import Mapping as Dict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.recording import locate
from dtbacklash.recording.clean import clean
from dtbacklash.recording.command import HELD
from dtbacklash.recording.mapping import mapping_of, rows_of
from dtbacklash.recording.model import Recording, split
from dtbacklash.recording.pick import pick
from dtbacklash.recording.refusal import Refused
from dtbacklash.recording.tables import load, read_table
from dtbacklash.recording.validation import check_alike


def read_recording(
    source: str | Path,
    mapping: str | None = None,
    *,
    path: str | None = None,
    part: str | None = None,
    rig: Rig | None = None,
    sample_time_s: float | None = None,
    units: Dict[str, str] | None = None,
    trust_units: bool = False,
    command: str | None = None,
    rows: Sequence[int] | None = None,
) -> Recording:
    """Read and check a recording, as :func:`dtbacklash.read_recording` does, whose arguments these are.

    Parameters
    ----------
    source : the path of a file with plain columns; or the name of a mapping, ``name:part`` for one of its parts.
    mapping : a mapping to read the file ``source`` with.
    part : the part of the mapping to use; None: its part ``train`` if it has one, else all; "": all.

    Raises
    ------
    UserError : with the key ``recording`` or ``recording.path``: nothing there, nothing readable, or a
        defect that cannot be handled; with ``recording.units.<channel>``: no such channel or unit.
    """
    if not isinstance(source, (str, Path)):
        allowed = "must be a path or a name; a DataFrame is read by Recording.from_frame, and diagnose takes it"
        raise UserError("recording", f"a {type(source).__name__}", allowed)
    if units is not None and not isinstance(units, Dict):
        raise UserError("recording.units", units, "must be a mapping, channel: unit")
    if sample_time_s is not None and not (isinstance(sample_time_s, (int, float)) and sample_time_s > 0.0):
        raise UserError("recording.sample_time_s", sample_time_s, "must be positive s")
    if mapping is not None:
        source, path = mapping, str(source)
    taken = None if rows is None else rows_of("recording.rows", rows)
    file, found, asked, key = locate.resolve(str(source), path)
    part = part if part is not None else asked or ("train" if found and "train" in found.parts else "")
    about: dict[str, Any] = {"name": file.name}
    if found is not None:
        about = {key: getattr(found, key) for key in ("name", "citation", "licence", "rig")} | {
            "splits": dict(found.parts)
        }
    command = command or (found.command if found else HELD)
    try:
        content = load(file)
        table = read_table(content, file.name, taken)
        public = found.files.get(file.name.removesuffix(".gz")) if found else None
        if public is not None and not locate.is_genuine(content, public):
            table.notes.append(f"{file.name} differs from the published file (SHA-256).")
        picked = pick(table, rig, units or {}, found, part)
        read = clean(picked, rig, table.notes, command, sample_time_s)
    except Refused as refusal:
        raise UserError(key, file.name if key == "recording.path" else source, str(refusal)) from refusal
    recording = Recording(source=file, part=part, command=command, trust_units=trust_units, **about, **read)
    return found.prepare.of(recording) if found and found.prepare else recording


def read_pair(
    source: str | Path,
    validation: str | Path | None = None,
    share: float = 0.3,
    **how: Any,
) -> tuple[Recording, Recording]:
    """Read what to fit and what to judge on.

    To judge on is ``validation`` (a file like ``source``, or a mapping's name or part); without it the last
    ``share`` of the recording. how : the other arguments of :func:`read_recording`, which hold for both.

    Raises
    ------
    UserError : as :func:`read_recording`; for the second recording with the key ``validation``.
    """
    recording = read_recording(source, **how)
    if validation is None:
        return split(recording, share)
    name = str(source).partition(":")[0]
    mapping = mapping_of(str(source))
    own = mapping is not None and (Path(str(validation)).is_file() or str(validation) in mapping.files)
    try:
        alike = {**how, "path": None, "part": "" if own else None}
        held_out = read_recording(validation, name if own else None, **alike)
    except UserError as error:
        raise UserError("validation", validation, error.allowed) from error
    rig = how.get("rig")
    check_alike(recording, held_out, None if rig is None else rig.sensors, validation)
    return recording, held_out
