"""Results that are kept on disk, beside the compiled code: designs, whose libraries a run needs for nothing else.

Loading python-control and SciPy's signal processing takes a quarter of the processor time of a whole run, and the same
parameters give the same design, to the last bit.
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

from dtbacklash import files, sources
from dtbacklash.errors import UserError

Result = TypeVar("Result")

#: what decides a design beside its parameters
MADE_BY = ("control", "twin", "kept.py")
LIBRARIES = ("control", "numpy", "scipy")


def folder() -> Path:
    """Where results are kept: below the user's cache folder."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "dtbacklash" / "designs"


def kept(make: Callable[..., Result], *arguments: object) -> Result:
    """``make(*arguments)``, or what it gave before, in whatever process, with the same code, libraries and arguments.

    Where nothing can be kept it is made each time.

    Parameters
    ----------
    make : a function of its arguments alone. arguments : dataclasses, numbers, texts.
    """
    words = pickle.dumps((make.__module__, make.__qualname__, arguments, _state()))
    file = folder() / f"{hashlib.sha256(words).hexdigest()[:32]}.pickle"
    with suppress(Exception):  # no such file, or one that cannot be read: it is made anew
        found: Result = pickle.loads(file.read_bytes())
        return found
    result = make(*arguments)
    with suppress(UserError):
        files.write_bytes(file, pickle.dumps(result))
    return result


@cache
def _state() -> tuple[str, ...]:
    """The code and the libraries that a result depends on."""
    return (sources.digest(MADE_BY), *(importlib.metadata.version(name) for name in LIBRARIES))
