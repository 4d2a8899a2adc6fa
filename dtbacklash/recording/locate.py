"""Where a recording's file lies: a path, the folder of recordings, or the download cache."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

from dtbacklash.errors import UserError
from dtbacklash.recording.mapping import Mapping, PublicFile, load_mapping, mapping_names

FOLDER = "DTB_RECORDINGS"


def cache_folder() -> Path:
    """The folder of downloaded recordings: below the user's cache folder, as the platform has it."""
    if os.environ.get("XDG_CACHE_HOME"):
        base = Path(os.environ["XDG_CACHE_HOME"])
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif os.name == "nt" and os.environ.get("LOCALAPPDATA"):
        base = Path(os.environ["LOCALAPPDATA"])
    else:
        base = Path.home() / ".cache"
    return base / "dtbacklash" / "recordings"


def places(mapping: Mapping, file: str) -> list[Path]:
    """Where the file of a mapping is looked for, in this order; each may be gzipped as well."""
    folders = []
    if os.environ.get(FOLDER):
        own = Path(os.environ[FOLDER])
        folders += [own, own / mapping.name]
    folders.append(cache_folder() / mapping.name)
    return [folder / name for folder in folders for name in (file, f"{file}.gz")]


def find(mapping: Mapping, file: str) -> Path | None:
    """Return where the file of a mapping is, or None."""
    return next((place for place in places(mapping, file) if place.is_file()), None)


def resolve(source: str, path: str | None) -> tuple[Path, Mapping | None, str, str]:
    """Find the file of ``recording=source`` (and ``recording.path=path``).

    Returns
    -------
    the file, its mapping (None: plain columns), the part asked for (empty: none), the key to name in errors.

    Raises
    ------
    UserError : neither a file nor a mapping; the file of a mapping is nowhere.
    """
    if not source:
        raise UserError("recording", "null", "give the path of a file or one of " + ", ".join(mapping_names()))
    name, _, part = source.partition(":")
    if Path(source).is_file() or (name not in mapping_names() and Path(name).suffix not in (".yaml", ".yml")):
        if path is not None:
            raise UserError("recording.path", path, f"belongs to a mapping, and recording={source} is a file")
        return _plain(source), None, "", "recording"
    mapping = load_mapping(name)
    if part and part not in mapping.parts:
        parts = "choose one of " + ", ".join(mapping.parts) if mapping.parts else f"{name} has no parts"
        raise UserError("recording", source, parts)
    if path is not None:
        return _given(mapping, path), mapping, part, "recording.path"
    if not mapping.file:
        raise UserError("recording.path", "null", f"give the file for the mapping {name}")
    found = find(mapping, mapping.file)
    if found is None:
        get = f"run `dtb recordings fetch {name}`, or " if mapping.files else ""
        raise UserError(
            "recording",
            name,
            f"{mapping.file} is not here; {get}put it into ${FOLDER}, or give recording.path=FILE",
        )
    return found, mapping, part, "recording"


def _plain(source: str) -> Path:
    path = Path(source).expanduser()
    if path.is_file():
        return path
    if path.is_dir():
        raise UserError("recording", source, "is a folder; give a file")
    known = ", ".join(mapping_names())
    raise UserError("recording", source, f"no such file; give the path of a file or one of {known}")


def _given(mapping: Mapping, path: str) -> Path:
    """A path, or the name of one of the mapping's files."""
    own = Path(path).expanduser()
    if own.is_file():
        return own
    if path in mapping.files:
        found = find(mapping, path)
        if found is not None:
            return found
        raise UserError("recording.path", path, f"is not here; run `dtb recordings fetch {mapping.name}`")
    if own.is_dir():
        raise UserError("recording.path", path, "is a folder; give a file")
    known = f" or one of {', '.join(mapping.files)}" if mapping.files else ""
    raise UserError("recording.path", path, f"no such file; give the path of a file{known}")


def is_genuine(content: bytes, file: PublicFile) -> bool:
    """Whether ``content`` (unpacked) is what was published."""
    return hashlib.sha256(content).hexdigest() == file.sha256
