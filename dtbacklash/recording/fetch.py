"""Downloads public recordings: whole and as published, or not at all."""

from __future__ import annotations

import http.client
import io
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from dtbacklash import __version__
from dtbacklash.errors import UserError
from dtbacklash.recording import locate
from dtbacklash.recording.mapping import Mapping, PublicFile
from dtbacklash.recording.model import Refused
from dtbacklash.recording.tables import unpacked
from dtbacklash.runfolder import PARTIAL, hidden_sibling, reason

TIMEOUT_S = 30
CHUNK_BYTES = 1 << 16
DOWNLOAD_MAX_BYTES = 1 << 30
Progress = Callable[[float], None]


def fetch(mapping: Mapping, file: PublicFile, progress: Progress | None = None) -> Path:
    """Download one file of a mapping into the cache, unless it is here already; returns where it is.

    Parameters
    ----------
    progress : called with the fraction done, 0 to 1.

    Raises
    ------
    UserError : no network, not what was published, no place to write.
    """
    here = locate.find(mapping, file.name)
    if here is not None and _holds(here, file):
        return here
    target = locate.cache_folder() / mapping.name / file.name
    try:
        archive = _download(file.url, progress or (lambda fraction: None))
    except (OSError, ValueError, http.client.HTTPException) as error:  # URLError and HTTPError are OSErrors
        raise UserError("recordings", mapping.name, _instead(mapping, file, _why(error))) from error
    content = _content(archive, file)
    if content is None or not locate.is_genuine(content, file):
        why = "what came is not the published file (its SHA-256 differs)"
        raise UserError("recordings", mapping.name, _instead(mapping, file, why))
    _write(target, content)
    return target


def _holds(path: Path, file: PublicFile) -> bool:
    """Whether what lies at ``path`` is what was published."""
    try:
        return locate.is_genuine(unpacked(path.read_bytes()), file)
    except (OSError, Refused):
        return False


def _download(url: str, progress: Progress) -> bytes:
    request = urllib.request.Request(url, headers={"User-Agent": f"dtbacklash/{__version__}"})
    with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
        size = int(answer.headers.get("Content-Length") or 0)
        received = io.BytesIO()
        while chunk := answer.read(CHUNK_BYTES):
            received.write(chunk)
            if received.tell() > DOWNLOAD_MAX_BYTES:
                raise ValueError("more than 1 GB came")
            if size:
                progress(min(1.0, received.tell() / size))
    return received.getvalue()


def _content(archive: bytes, file: PublicFile) -> bytes | None:
    """The file out of what was downloaded, or None if it is not in it."""
    try:
        if not archive.startswith(b"PK\x03\x04"):
            return unpacked(archive)
        with zipfile.ZipFile(io.BytesIO(archive)) as zipped:
            wanted = file.member or file.name
            last = wanted.rpartition("/")[2]
            names = [name for name in zipped.namelist() if name == wanted or name.rpartition("/")[2] == last]
            return zipped.read(names[0]) if names else None
    except (Refused, zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError):
        return None


def _write(target: Path, content: bytes) -> None:
    scratch = hidden_sibling(target, PARTIAL)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch.write_bytes(content)
        scratch.replace(target)
    except OSError as error:
        raise UserError("XDG_CACHE_HOME", target.parent, f"cannot be written: {reason(error)}") from error
    finally:
        with suppress(OSError):
            scratch.unlink()


def _why(error: Exception) -> str:
    if isinstance(error, urllib.error.HTTPError):
        return f"the source answers {error.code}"
    if isinstance(error, urllib.error.URLError):
        return "the source cannot be reached"
    return f"the download failed ({str(error) or type(error).__name__})"


def _instead(mapping: Mapping, file: PublicFile, why: str) -> str:
    folder = locate.cache_folder() / mapping.name
    what = f"{file.name} (it comes in an archive)" if file.member else file.name
    return f"{why}; get {what} from {mapping.page or file.url} and put it into {folder} or into ${locate.FOLDER}"
