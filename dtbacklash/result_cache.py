"""Results kept on disk: designs and how they look; their libraries take a quarter of a run's processor time to load.

Importing ``joblib.Memory`` for it would cost every run 70 ms.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import pickle
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

from dtbacklash import files, source_hash
from dtbacklash.errors import UserError

Result = TypeVar("Result")


def folder() -> Path:
    """Where results are kept: below the user's cache folder."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "dtbacklash" / "designs"


def kept(make: Callable[..., Result], *arguments: object) -> Result:
    """``make(*arguments)``, or the same result from the disk. ``arguments``: dataclasses, numbers, texts."""
    words = pickle.dumps((make.__module__, make.__qualname__, arguments, _state(make.__module__)))
    file = folder() / f"{hashlib.sha256(words).hexdigest()[:32]}.pickle"
    with suppress(Exception):  # no such file, or one that cannot be read: it is made anew
        found: Result = pickle.loads(file.read_bytes())
        return found
    result = make(*arguments)
    with suppress(UserError):
        files.write_bytes(file, pickle.dumps(result))
    return result


@cache
def _state(module: str) -> tuple[str, ...]:
    """The code and the libraries that decide what a function of ``module`` gives beside its arguments."""
    drawn = module.startswith("dtbacklash.report.")
    versions = map(_version, ("control", "numpy", "scipy", *["matplotlib"] * drawn))
    return (source_hash.digest((module, "result_cache.py", *["report/components/house.mplstyle"] * drawn)), *versions)


_version = cache(importlib.metadata.version)
