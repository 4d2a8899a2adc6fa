"""From a rig to the file of its FMU."""

from __future__ import annotations

import importlib.util
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dtbacklash.errors import UserError
from dtbacklash.files import written
from dtbacklash.fmu.interface import Export

SUFFIX = ".fmu"
SCRIPT = Path(__file__).with_name("dtbacklash_slave.py")


def check_extra() -> None:
    """Raise UserError where pythonfmu is not installed, or has no library for this platform."""
    if importlib.util.find_spec("pythonfmu") is None:
        raise UserError("export", "fmu", "needs pythonfmu: pip install 'dtbacklash[fmu]'")


def target(out: str | None, export: Export) -> Path:
    """Where the file goes: as chosen, else the rig's name here.

    Raises
    ------
    UserError : a name that is none of an FMU, a folder, a file in a folder that does not exist.
    """
    if out is None:
        return Path(export.identifier + SUFFIX).absolute()
    path = Path(out).expanduser()
    if path.is_dir():
        raise UserError("out", out, "is a folder; give a file name")
    if path.suffix != SUFFIX:
        raise UserError("out", out, f"must end in {SUFFIX}")
    if not path.absolute().parent.is_dir():
        raise UserError("out", out, "must lie in a folder that exists")
    return path.absolute()


def write_fmu(export: Export, path: Path, shown: str | None = None) -> Path:
    """Write the FMU, at once or not at all; returns its path.

    shown : the file as the user has written it.

    Raises
    ------
    UserError : pythonfmu is missing, or the file cannot be written.
    """
    check_extra()
    from pythonfmu.builder import FmuBuilder

    from dtbacklash.fmu.slave import CONTENT

    with tempfile.TemporaryDirectory() as scratch, _imports_apart():
        script = Path(scratch) / "script" / SCRIPT.name
        script.parent.mkdir()
        shutil.copy(SCRIPT, script)
        content = Path(scratch) / CONTENT
        content.write_text(export.text(), encoding="utf-8")
        # steps may be any multiples of the sample time, but an importer that shortens one would miss it
        built = FmuBuilder.build_FMU(
            script, Path(scratch) / f"built{SUFFIX}", [content], canHandleVariableCommunicationStepSize=False
        )
        with written(path, "out", shown, parents=False) as whole:
            shutil.copy(built, whole)
    return path


@contextmanager
def _imports_apart() -> Iterator[None]:
    """The builder imports the script from where it lies, and leaves that in the process: take it out again."""
    path = list(sys.path)
    try:
        yield
    finally:
        sys.path[:] = path
        sys.modules.pop(SCRIPT.stem, None)
