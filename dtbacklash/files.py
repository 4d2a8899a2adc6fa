"""What is written is complete on disk or not there at all: files, JSON documents, folders of results.

Everything is written into a hidden sibling and renamed into place at the very end. Whatever goes wrong before (wrong
input, a diverging loop, a full disk, Ctrl-C), nothing is left behind, and what was there before stays.
"""

from __future__ import annotations

import errno
import json
import math
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from dtbacklash.errors import Failure, UserError

DIAGNOSIS_ENTRIES = frozenset({"diagnosis.json", "report.html", "figures", "rig.yaml", "found"})
RUN_ENTRIES = frozenset({"summary.json", "metrics.csv", "estimates.csv", "trace.parquet", "figures", "report.html"})

PARTIAL = ".partial"
#: a name of this many bytes leaves room for what makes it hidden and unique, in a file system that takes 255
NAME_BYTES = 120
TRIES = 3  # to lock in a folder that others tidy away while it is empty

#: the disk's fault, whatever the user asked for
ENVIRONMENT = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
#: the fault of the place that the user chose
PLACE = (
    errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENAMETOOLONG,
    errno.EINVAL, errno.ENOENT, errno.ELOOP, errno.ENOTEMPTY,
)  # fmt: skip
#: a file system without locks: who works at once then does some work twice, which does no harm
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP)

_created: list[Path] = []


# --- names and errors -------------------------------------------------------------------------------------------------


def hidden_sibling(path: Path, suffix: str = PARTIAL) -> Path:
    """Return a new hidden name beside ``path``, on the same disk, so that a rename is atomic."""
    return path.with_name(f".{_short(path.name)}.{uuid.uuid4().hex[:8]}{suffix}")


def lock_of(folder: Path) -> Path:
    """The file that is there, and locked, while a folder of results is written."""
    return folder.with_name(f".{_short(folder.name)}.lock")


def leftovers(path: Path, suffix: str = PARTIAL) -> list[Path]:
    """The hidden siblings of ``path`` that a process which was killed has left."""
    # not glob: a name may hold its signs
    head, length = f".{_short(path.name)}.", 8 + len(suffix)
    try:
        names = os.listdir(path.parent)
    except OSError:
        return []
    return [
        path.with_name(name)
        for name in names
        if name.startswith(head) and name.endswith(suffix) and len(name) == len(head) + length
    ]


def _short(name: str) -> str:
    return os.fsencode(name)[:NAME_BYTES].decode("utf-8", "ignore")


def reason(error: OSError) -> str:
    """Say why something could not be written, in lower case and without a path."""
    if error.errno == errno.ENOSPC:
        return "the disk is full"
    return (error.strerror or str(error)).lower()


def cannot_write(key: str, value: object, error: OSError) -> UserError:
    """Return the error to raise where the setting ``key`` led to a place that cannot be written to.

    A full disk is a :class:`~dtbacklash.errors.Failure`: nothing is wrong with what was asked.
    """
    kind = Failure if error.errno in ENVIRONMENT else UserError
    return kind(key, value, f"cannot be written: {reason(error)}")


def remove(path: Path) -> None:
    """Remove a file or a folder with all that is in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):  # where it could not be made it cannot be removed either
        path.unlink()


# --- files ------------------------------------------------------------------------------------------------------------


@contextmanager
def written(path: Path, key: str = "out", shown: object = None, parents: bool = True) -> Iterator[Path]:
    """Give a hidden sibling to write into, a file or a folder; on success it becomes ``path``, in one go.

    Parameters
    ----------
    key, shown : the setting and its value to name in errors (default: the path).
    parents : make the folders that it lies in.

    Raises
    ------
    UserError : the place cannot be written to. Failure : the disk is full.
    """
    scratch = hidden_sibling(path)
    try:
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        yield scratch
        scratch.replace(path)
    except OSError as error:
        raise cannot_write(key, path if shown is None else shown, error) from error
    finally:
        remove(scratch)


def write_bytes(path: Path, content: bytes, key: str = "out", shown: object = None) -> None:
    """Write a file, at once or not at all; errors as for :func:`written`."""
    with written(path, key, shown) as scratch:
        scratch.write_bytes(content)


def write_text(path: Path, text: str, key: str = "out", shown: object = None) -> None:
    """Write a text in UTF-8, at once or not at all; errors as for :func:`written`."""
    write_bytes(path, text.encode("utf-8"), key, shown)


def write_once(path: Path, content: bytes, key: str = "out", mode: int = 0o600) -> None:
    """Write a file unless there is one: of several processes that try, the first one's holds.

    Raises
    ------
    UserError, Failure : as for :func:`written`.
    """
    scratch = hidden_sibling(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(scratch, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(content)
        with suppress(FileExistsError):  # somebody else was quicker
            os.link(scratch, path)
    except OSError as error:
        raise cannot_write(key, path, error) from error
    finally:
        remove(scratch)


@contextmanager
def claim(lock: Path) -> Iterator[bool]:
    """Whether this process may do what this lock is of: not while another one does it, anywhere on the same disk.

    The lock ends with its holder, however that ends.

    Raises
    ------
    OSError : the place cannot be written to.
    """
    from filelock import FileLock, Timeout

    held, mine = FileLock(lock, timeout=0, fallback_to_soft=False), False
    try:
        for attempt in range(TRIES):
            lock.parent.mkdir(parents=True, exist_ok=True)
            try:
                held.acquire()
                mine = True
                break
            except Timeout:
                yield False
                return
            except OSError as error:
                if mine := error.errno in NO_LOCKS:
                    break
                if error.errno != errno.ENOENT or attempt == TRIES - 1:
                    raise  # else another campaign has just tidied away the empty folder
        yield True
    finally:
        with suppress(Timeout, OSError):
            if not mine:  # interrupted: the file may have been made
                held.acquire()
            lock.unlink()  # while it is held: who has opened it meanwhile sees that it has no name any more
        held.release(force=True)


# --- JSON -------------------------------------------------------------------------------------------------------------


def json_able(value: Any) -> Any:
    """What JSON knows: numpy's numbers and arrays become Python's; NaN and infinity, which JSON has not, null.

    A dataclass becomes a mapping of its fields.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {one.name: json_able(getattr(value, one.name)) for one in fields(value)}
    if isinstance(value, dict):
        return {str(key): json_able(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [json_able(item) for item in value]
    if hasattr(value, "tolist"):  # numpy
        return json_able(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_text(document: Any) -> str:
    """The text of a JSON document, for people too: indented, letters as they are, a line break at its end."""
    able = json_able(document)
    text = json.dumps(able, indent=2, allow_nan=False, ensure_ascii=False)
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:  # a path that is no text
        text = json.dumps(able, indent=2, allow_nan=False)
    return text + "\n"


def write_json(path: Path, document: Any, key: str = "out", shown: object = None) -> None:
    """Write a JSON document, at once or not at all; errors as for :func:`written`."""
    write_text(path, json_text(document), key, shown)


def write_parquet(path: Path, table: Any) -> None:
    """Write the columns of a DataFrame, numbers all of them, where ``path`` is a place that is ours alone.

    Without the index, and without dictionaries of values, which signals do not repeat: a fifth of the time that
    ``DataFrame.to_parquet`` takes.
    """
    import pyarrow
    from pyarrow.parquet import write_table

    columns = {str(name): table[name].to_numpy() for name in table}
    write_table(pyarrow.table(columns), path, use_dictionary=False)


def read_json(path: Path) -> dict[str, Any]:
    """A JSON document, or ``{}`` if there is none that can be read."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


# --- folders of results -----------------------------------------------------------------------------------------------


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


def remove_if_empty(folder: Path) -> None:
    """Remove a folder that holds nothing, if it is there."""
    with suppress(OSError):
        folder.rmdir()


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
    UserError : the folder holds something else, another run is being written there, or it cannot be written.
    Failure : the disk is full.
    """
    folder = folder.absolute()
    if not folder.name:
        raise UserError(key, folder, "give a folder of its own")
    note_missing(folder)
    scratch = hidden_sibling(folder)
    try:
        _check_replaceable(folder, key, mark, known)
        scratch.mkdir(parents=True)
        with claim(lock_of(folder)) as alone:
            if not alone:
                raise UserError(key, folder, "another run is being written there; give each a folder of its own")
            yield scratch
            _move_into_place(scratch, folder)
    except OSError as error:
        if error.errno not in ENVIRONMENT + PLACE:
            raise
        raise cannot_write(key, folder, error) from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if not (folder / mark).exists():
            forget_empty(folder)


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
    """Put ``scratch`` where ``folder`` is; whatever happens, one of the two is there afterwards."""
    old = hidden_sibling(folder, ".old")
    if folder.exists():
        folder.rename(old)
    try:
        scratch.rename(folder)
    except BaseException:
        if old.exists():
            old.rename(folder)
        raise
    remove(old)
