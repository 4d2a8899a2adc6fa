"""Recordings in: read, checked, in SI units on a uniform time grid.

Each name is imported at its first use: whether a file is there is known before the libraries that read it are loaded.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dtbacklash.recording.mapping import Mapping, load_mapping, mapping_names, mapping_of
    from dtbacklash.recording.model import Recording, refined, split
    from dtbacklash.recording.read import read_pair, read_recording
    from dtbacklash.recording.several import read_together
    from dtbacklash.recording.sources import sources_of

__all__ = [
    "Mapping",
    "Recording",
    "load_mapping",
    "mapping_names",
    "mapping_of",
    "read_pair",
    "read_recording",
    "read_together",
    "refined",
    "sources_of",
    "split",
]

#: name -> the module that it is found in
_FOUND_IN = {
    **dict.fromkeys(("Mapping", "load_mapping", "mapping_names", "mapping_of"), "mapping"),
    **dict.fromkeys(("Recording", "refined", "split"), "model"),
    **dict.fromkeys(("read_pair", "read_recording"), "read"),
    "read_together": "several",
    "sources_of": "sources",
}


def __getattr__(name: str) -> Any:
    """Import a name at its first use (PEP 562)."""
    if name not in _FOUND_IN:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_FOUND_IN[name]}"), name)
    globals()[name] = value
    return value
