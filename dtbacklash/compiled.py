"""How the inner loops are compiled: one place for numba's options and for where the compiled code is kept."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
from numba.core import event

from dtbacklash import sources


def cache_folder() -> Path:
    """Where compiled code is kept: a folder for this very state of the sources.

    numba looks at the file of a function only, not at the files of the functions that it calls; so that a change
    in one file cannot leave stale code in another, the folder's name is a hash of all sources that are compiled. It
    also works where the package itself lies in a folder that cannot be written to.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR") or numba.config.CACHE_DIR:
        return Path(chosen)
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "dtbacklash" / "numba" / f"{numba.__version__}-{sources.digest(sources.COMPILED)}"


def is_cold() -> bool:
    """Whether the first run is still to come, which compiles for about a quarter of a minute."""
    return not any(cache_folder().rglob("*.nbi"))


def kept(decorator: Callable[[Callable[..., Any]], Any]) -> Callable[[Callable[..., Any]], Any]:
    """A decorator of numba whose functions are kept in :func:`cache_folder`.

    numba takes the folder from a setting of the whole process, and it does so when a function is decorated: the setting
    is ours for that moment only, and the functions of others are kept where they always were.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        before = numba.config.CACHE_DIR
        folder = str(cache_folder())
        numba.config.CACHE_DIR = folder
        try:
            return decorator(function)
        finally:
            numba.config.CACHE_DIR = before

    return decorate


@contextmanager
def compiling() -> Iterator[Callable[[], float]]:
    """Give a function that says how many seconds have been spent compiling since; loading from the cache is none."""
    with event.install_listener("numba:compile", event.TimingListener()) as listener:
        yield lambda: float(listener.duration) if listener.done else 0.0


#: Cached on disk, so that only the first run on a machine compiles; no fast-math: results repeat to the last bit.
#: ``_nrt=False`` takes the counting of references out of the loop: it may not allocate, and a call costs 1 ns
#: instead of 0.5 us (the plant is a tuple of twenty arrays, each counted at each call).
compiled = kept(numba.njit(cache=True, error_model="numpy", _nrt=False))

#: The same without the interpreter's lock, so that threads can share the work.
compiled_free = kept(numba.njit(cache=True, error_model="numpy", _nrt=False, nogil=True))

#: For what the inner loop calls every time: a call that is not inlined passes the plant's two hundred words (0.15 us).
inlined = kept(numba.njit(cache=True, error_model="numpy", _nrt=False, forceinline=True))

#: The same for functions that allocate.
compiled_allocating = kept(numba.njit(cache=True, error_model="numpy"))

#: For functions that are written while the package is imported, of which numba finds no file to keep compiled code by;
#: it is kept with the functions that call them.
generated = numba.njit(error_model="numpy", _nrt=False, forceinline=True)

#: The laws: small enough to be part of every function that calls them.
law = kept(numba.njit(inline="always", cache=True, error_model="numpy"))


@compiled
def copy(source, target):
    """target = source, element by element (a slice assignment would allocate)."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@compiled
def clear(target):
    """target = 0."""
    for i in range(target.shape[0]):
        target[i] = 0.0
