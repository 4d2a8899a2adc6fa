"""A folder of results that is complete or not there at all.

A command writes into a hidden sibling of its run folder and renames it into place at the very end. Whatever
goes wrong before (wrong input, a diverging loop, a full disk, Ctrl-C), nothing is left behind.
"""

from __future__ import annotations

import errno
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dtbacklash.errors import UserError

RUN_ENTRIES = frozenset({"summary.json", "metrics.csv", "estimates.csv", "trace.parquet", "figures", "report.html"})

PARTIAL = ".partial"

_created: list[Path] = []


def hidden_sibling(path: Path, suffix: str) -> Path:
    """Return a new hidden name beside ``path``, on the same disk, so that a rename is atomic."""
    return path.with_name(f".{path.name[:100]}.{uuid.uuid4().hex[:8]}{suffix}")


def first_missing(folder: Path) -> Path | None:
    """Return the outermost folder that would have to be created for ``folder`` to exist, or None."""
    missing = None
    for candidate in (folder, *folder.parents):
        if candidate.exists():
            break
        missing = candidate
    return missing


def note_missing(folder: Path) -> None:
    """Remember which folders do not exist yet, because somebody else (Hydra) is about to create them."""
    outermost = first_missing(folder.absolute())
    if outermost is not None:
        _created.append(outermost)


def forget_empty(folder: Path) -> None:
    """Remove ``folder`` and the folders noted as created for it, as far as they are empty."""
    outermost = next((path for path in _created if path == folder or path in folder.parents), None)
    if outermost is None:
        return
    for candidate in (folder, *folder.parents):
        try:
            candidate.rmdir()
        except FileNotFoundError:
            pass  # its parent may be there
        except OSError:
            return  # not empty: somebody else's results
        if candidate == outermost:
            return


@contextmanager
def run_folder(
    folder: Path, key: str = "hydra.run.dir", mark: str = "summary.json", known: frozenset[str] = RUN_ENTRIES
) -> Iterator[Path]:
    """Give a temporary folder to write into; on success it becomes ``folder``, else nothing is left.

    Parameters
    ----------
    folder : where the results belong. A complete earlier run there is replaced in one go.
    key : the setting to name in errors.
    mark : the file by which a complete earlier run is recognised.
    known : the entries that such a run may hold; a folder with anything else in it is not ours to replace.

    Raises
    ------
    UserError : the folder holds something else, cannot be written, or the disk is full.
    """
    folder = folder.absolute()
    if not folder.name:
        raise UserError(key, folder, "give a folder of its own")
    note_missing(folder)
    scratch = hidden_sibling(folder, PARTIAL)
    try:
        _check_replaceable(folder, key, mark, known)
        scratch.mkdir(parents=True)
        yield scratch
        _move_into_place(scratch, folder)
    except OSError as error:
        if not _about_writing(error):
            raise
        raise UserError(key, folder, f"cannot be written: {reason(error)}") from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if not (folder / mark).exists():
            forget_empty(folder)


def reason(error: OSError) -> str:
    """Say why something could not be written, in lower case and without a path."""
    if error.errno == errno.ENOSPC:
        return "the disk is full"
    return (error.strerror or str(error)).lower()


def _about_writing(error: OSError) -> bool:
    codes = (
        errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES, errno.EPERM, errno.EROFS, errno.EIO,
        errno.ENOTDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.EINVAL, errno.ENOENT, errno.ELOOP,
    )  # fmt: skip
    return error.errno in codes


def _check_replaceable(folder: Path, key: str, mark: str, known: frozenset[str]) -> None:
    here = Path.cwd()
    if folder.resolve() in (here, *here.parents):  # renaming it away would leave the user's shell nowhere
        raise UserError(key, folder, "give a folder below the current one, or elsewhere")
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UserError(key, folder, "is a file; give a folder")
    entries = set(os.listdir(folder))
    if entries and not (mark in entries and entries <= known):
        raise UserError(key, folder, "holds files that are not an earlier run; give an empty or a new folder")


def _move_into_place(scratch: Path, folder: Path) -> None:
    try:
        scratch.rename(folder)  # replaces an empty folder, atomically
        return
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
    old = hidden_sibling(folder, ".old")
    folder.rename(old)
    try:
        scratch.rename(folder)
    except BaseException:
        old.rename(folder)
        raise
    shutil.rmtree(old, ignore_errors=True)
