"""The files of a proof: JSON that is complete on disk or not there at all."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from dtbacklash.errors import UserError
from dtbacklash.runfolder import PARTIAL, hidden_sibling, reason


def plain(value: Any) -> Any:
    """What JSON knows: numpy's numbers and arrays become Python's, what is not finite becomes None."""
    if isinstance(value, dict):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Write a document, at once or not at all.

    Raises
    ------
    UserError : the disk is full, or the folder cannot be written to.
    """
    text = json.dumps(plain(document), indent=2, allow_nan=False, ensure_ascii=False)
    write_text(path, text + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text, at once or not at all; errors as for :func:`write_json`."""
    scratch = hidden_sibling(path, PARTIAL)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch.write_text(text, encoding="utf-8")
        scratch.replace(path)
    except OSError as error:
        raise UserError("out", path, f"cannot be written: {reason(error)}") from error
    finally:
        scratch.unlink(missing_ok=True)


def read_json(path: Path) -> dict[str, Any]:
    """A document, or ``{}`` if there is none that can be read."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
