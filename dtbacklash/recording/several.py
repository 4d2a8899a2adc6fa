"""Several recordings that are diagnosed together, and what judges."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from dtbacklash.errors import UserError
from dtbacklash.recording.mapping import mapping_of
from dtbacklash.recording.model import Recording
from dtbacklash.recording.read import read_pair, read_recording
from dtbacklash.recording.sources import sources_of
from dtbacklash.recording.tables import is_frame

if TYPE_CHECKING:
    import pandas as pd

#: what is read: a path, a pattern, a list of them in brackets, a mapping's name, a DataFrame; or what has been read
Source: TypeAlias = "str | Path | Recording | pd.DataFrame"


def read_together(
    recording: Source | Sequence[Source], validation: Source | Sequence[Source] | int | None, **how: Any
) -> tuple[Recording | list[Recording], Recording | list[Recording] | int | None]:
    """Read what is diagnosed together, and what judges.

    Parameters
    ----------
    recording : one or several. validation : others; or the number (from 1), name or file of one of several, whose
        number is then given back. how : as for :func:`.read_recording`; it holds for all.

    Raises
    ------
    UserError : as :func:`.read_recording`, naming the file; a path of a mapping's file for several recordings.
    """
    sources = _listed(recording, "recording")
    if isinstance(validation, int):
        return [_read(s, "recording", how) for s in sources], validation
    judging = [] if validation is None else _listed(validation, "validation")
    if len(sources) == 1 and len(judging) < 2:
        return _one(sources[0], judging[0] if judging else None, how)
    if how.get("path") is not None:
        raise UserError("recording.path", how["path"], "is the file of one recording, and several are given")
    among = _among(sources, judging[0]) if len(judging) == 1 else None
    recordings = [_read(s, "recording", how) for s in sources]
    if validation is None or among is not None:
        return recordings, among
    return recordings, [_read(s, "validation", how) for s in judging]


def _listed(given: Source | Sequence[Source], key: str) -> list[Source]:
    """One by one."""
    if not isinstance(given, (str, Path, Recording, Sequence)) and not is_frame(given):
        raise UserError(key, given, "must be a recording, a DataFrame, a path or a name; or a list of them")
    several = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    if not several:
        raise UserError(key, "[]", "give at least one recording")
    return [one for s in several for one in (sources_of(s, key) if isinstance(s, str) else [s])]


def _one(source: Source, validation: Source | None, how: dict[str, Any]) -> tuple[Recording, Recording | None]:
    """One recording; a validation that is read is one of its mapping, if it has one."""
    if not isinstance(source, (str, Path)) or not isinstance(validation, (str, Path)):
        read = _read(source, "recording", how)
        return read, None if validation is None else _read(validation, "validation", how)
    return read_pair(source, validation, **how)


def _read(source: Source, key: str, how: dict[str, Any]) -> Recording:
    if isinstance(source, Recording):
        return source
    if is_frame(source):
        said = {key: value for key, value in how.items() if key not in ("path", "rows") and value is not None}
        return Recording.from_frame(source, **said)
    try:
        return read_recording(source, **how)
    except UserError as error:
        if key == "recording" or error.key != "recording":
            raise
        raise UserError(key, error.value, error.allowed) from error


def _among(sources: list[Source], validation: Source) -> int | None:
    """The number, from 1, of the one of several sources that a validation names; None where it is another one."""
    if not isinstance(validation, (str, Path)):
        return None
    text, here = str(validation), Path(validation).expanduser()
    if text.isdecimal() and not here.is_file():
        return int(text)
    for number, source in enumerate(sources, 1):
        if is_frame(source):
            continue
        if isinstance(source, Recording):
            names, file = [source.name], source.source
        else:
            file = Path(source).expanduser()
            names = [str(source), *([file.name] if mapping_of(str(source)) is None else [])]
        same = file is not None and file.is_file() and here.is_file() and here.samefile(file)
        if same or (text in names and not here.is_file()):
            return number
    return None
