"""Downloads public recordings by pooch: whole and as published, or not at all."""

from __future__ import annotations

import io
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

from dtbacklash.errors import UserError
from dtbacklash.files import write_bytes
from dtbacklash.recording import locate
from dtbacklash.recording.mapping import Mapping, PublicFile
from dtbacklash.recording.refusal import Refused
from dtbacklash.recording.tables import unpacked
from dtbacklash.version import __version__

TIMEOUT_S = 30
DOWNLOAD_MAX_BYTES = 1 << 30
Progress = Callable[[float], None]


class _Bar:
    """What pooch tells of its progress, as a fraction done."""

    total = 0

    def __init__(self, progress: Progress) -> None:
        self.progress, self.received = progress, 0

    def update(self, size: int) -> None:
        self.received += size
        if self.received > DOWNLOAD_MAX_BYTES:
            raise ValueError("more than 1 GB came")
        if self.total:
            self.progress(min(1.0, self.received / self.total))

    def reset(self) -> None:
        self.received = 0

    def close(self) -> None:
        self.progress(1.0)


def fetch(mapping: Mapping, file: PublicFile, progress: Progress | None = None) -> Path:
    """Download one file of a mapping into the cache, unless it is here already; returns where it is.

    Parameters
    ----------
    progress : called with the fraction done, 0 to 1.

    Raises
    ------
    UserError : no public source, no network, not what was published, no place to write.
    """
    here = locate.find(mapping, file.name)
    if here is not None and _holds(here, file):
        return here
    if not file.url:
        raise UserError("recordings", mapping.name, f"its mapping names no public source of {file.name}")
    target = locate.cache_folder() / mapping.name / file.name
    with tempfile.TemporaryDirectory(prefix="dtbacklash-") as scratch:
        try:
            archive = _download(file.url, Path(scratch), progress or (lambda fraction: None)).read_bytes()
        except (OSError, ValueError) as error:  # what requests raises is an OSError
            raise UserError("recordings", mapping.name, _instead(mapping, file, _why(error))) from error
    content = _content(archive, file)
    if content is None or not locate.is_genuine(content, file):
        why = "what came is not the published file (its SHA-256 differs)"
        raise UserError("recordings", mapping.name, _instead(mapping, file, why))
    write_bytes(target, content, "XDG_CACHE_HOME", target.parent)
    return target


def _holds(path: Path, file: PublicFile) -> bool:
    """Whether what lies at ``path`` is what was published."""
    try:
        return locate.is_genuine(unpacked(path.read_bytes()), file)
    except (OSError, Refused):
        return False


def _download(url: str, folder: Path, progress: Progress) -> Path:
    """Get what lies at ``url``. Its checksum is unknown: those of a mapping are of the file inside an archive."""
    import pooch

    pooch.get_logger().setLevel("ERROR")  # one line comes from us
    headers = {"User-Agent": f"dtbacklash/{__version__}"}
    downloader = pooch.HTTPDownloader(progressbar=_Bar(progress), timeout=TIMEOUT_S, headers=headers)
    return Path(pooch.retrieve(url, known_hash=None, fname="download", path=folder, downloader=downloader))


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


def _why(error: Exception) -> str:
    import requests

    if isinstance(error, requests.HTTPError) and error.response is not None:
        return f"the source answers {error.response.status_code}"
    if isinstance(error, requests.Timeout):
        return "the source does not answer in time"
    if isinstance(error, requests.ConnectionError):
        return "the source cannot be reached"
    return f"the download failed ({str(error)[:80] or type(error).__name__})"


def _instead(mapping: Mapping, file: PublicFile, why: str) -> str:
    folder = locate.cache_folder() / mapping.name
    what = f"{file.name} (it comes in an archive)" if file.member else file.name
    return f"{why}; get {what} from {mapping.page or file.url} and put it into {folder} or into ${locate.FOLDER}"
