"""How the inner loops are compiled: one place for numba's options and for where the compiled code is kept."""

import os
from pathlib import Path

import numba

from dtbacklash import sources


def cache_folder() -> Path:
    """Where compiled code is kept: a folder for this very state of the sources.

    numba looks at the file of a function only, not at the files of the functions that it calls; so that a change
    in one file cannot leave stale code in another, the folder's name is a hash of all sources that are compiled. It
    also works where the package itself lies in a folder that cannot be written to.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "dtbacklash" / "numba" / f"{numba.__version__}-{sources.digest(sources.COMPILED)}"


def is_cold() -> bool:
    """Whether the first run is still to come, which compiles for about a quarter of a minute."""
    return not any(cache_folder().rglob("*.nbi"))


numba.config.CACHE_DIR = str(cache_folder())

#: Cached on disk, so that only the first run on a machine compiles; no fast-math: results repeat to the last bit.
#: ``_nrt=False`` takes the counting of references out of the loop: it may not allocate, and a call costs 1 ns
#: instead of 0.5 us (the plant is a tuple of twenty arrays, each counted at each call).
compiled = numba.njit(cache=True, error_model="numpy", _nrt=False)

#: For what the inner loop calls every time: a call that is not inlined passes the plant's two hundred words (0.15 us).
inlined = numba.njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)

#: The same for functions that allocate.
compiled_allocating = numba.njit(cache=True, error_model="numpy")

#: The laws: small enough to be part of every function that calls them.
law = numba.njit(inline="always", cache=True, error_model="numpy")


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
