"""Where a recording's file lies: a path, the folder of recordings, or the download cache."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from dtbacklash.errors import UserError
from dtbacklash.recording.mapping import Mapping, PublicFile, mapping_names, mapping_of

FOLDER = "DTB_RECORDINGS"


def cache_folder() -> Path:
    """The folder of downloaded recordings: below the user's cache folder, as the platform has it."""
    import pooch

    return Path(pooch.os_cache("dtbacklash")) / "recordings"


def places(mapping: Mapping, file: str) -> list[Path]:
    """Where the file of a mapping is looked for, in this order; each may be gzipped as well.

    A mapping of the user's own has its files beside it or where ``dtb`` was started; then come the folder
    ``$DTB_RECORDINGS`` and the download cache.
    """
    folders = [mapping.folder, Path()] if mapping.folder is not None else []
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
    mapping = mapping_of(source)
    if mapping is None:
        if path is not None:
            raise UserError("recording.path", path, f"belongs to a mapping, and recording={source} is a file")
        return _file("recording", source, ", ".join(mapping_names())), None, "", "recording"
    if part and part not in mapping.parts:
        if not mapping.parts:
            raise UserError("recording", source, f"{name} has no parts: write recording={name}")
        raise UserError("recording", source, "choose one of " + ", ".join(mapping.parts))
    if path is not None:
        return _given(mapping, path), mapping, part, "recording.path"
    if not mapping.file:
        raise UserError("recording.path", "null", f"give the file for the mapping {name}")
    found = find(mapping, mapping.file)
    if found is None:
        public = any(file.url for file in mapping.files.values())
        get = f"run `dtb recordings fetch {name}`, or " if public else ""
        beside = "beside the mapping, " if mapping.folder else ""
        get += f"put it {beside}into ${FOLDER}, or give recording.path=FILE"
        raise UserError("recording", name, f"{mapping.file} is not here; {get}")
    return found, mapping, part, "recording"


def _given(mapping: Mapping, path: str) -> Path:
    """A path, or the name of one of the mapping's files."""
    if path not in mapping.files or Path(path).expanduser().is_file():
        return _file("recording.path", path, ", ".join(mapping.files))
    found = find(mapping, path)
    if found is None:
        get = f"run `dtb recordings fetch {mapping.name}`" if mapping.files[path].url else "give the path of the file"
        raise UserError("recording.path", path, f"is not here; {get}")
    return found


def _file(key: str, text: str, known: str) -> Path:
    """The file at a path. known : what else may be said."""
    path = Path(text).expanduser()
    if path.is_dir():
        raise UserError(key, text, "is a folder; give a file")
    if not path.is_file():
        raise UserError(key, text, "no such file; give the path of a file" + (f" or one of {known}" if known else ""))
    return path


def is_genuine(content: bytes, file: PublicFile) -> bool:
    """Whether ``content`` (unpacked) is what was published; anything is, where no checksum is known."""
    return not file.sha256 or hashlib.sha256(content).hexdigest() == file.sha256
