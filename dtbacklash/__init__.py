"""A simulator of a lead-screw drive with growing backlash, its controllers, its digital twin, and a diagnosis.

The interface for Python; every name is imported when it is first used, and the import of the package changes nothing::

    import dtbacklash as dtb

    rig = dtb.load_rig("lead_screw")
    result = dtb.run("controller=nimc_twin", rig=rig)
    recording = dtb.read_recording("bench.csv", rig=rig)
    found = dtb.diagnose(recording, rig)

What each takes and gives, with shapes and units: docs/python.md.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dtbacklash.api.diagnose import Found, diagnose
    from dtbacklash.api.experiments import design, isolability
    from dtbacklash.api.recordings import plot_recording, read_recording
    from dtbacklash.api.rigs import load_rig, save_rig
    from dtbacklash.api.run import Run, run
    from dtbacklash.errors import Diverged, UserError
    from dtbacklash.physics.rig import Rig
    from dtbacklash.recording import Recording

from dtbacklash.version import __version__

__all__ = [
    "Diverged",
    "Found",
    "Recording",
    "Rig",
    "Run",
    "UserError",
    "__version__",
    "design",
    "diagnose",
    "isolability",
    "load_rig",
    "plot_recording",
    "read_recording",
    "run",
    "save_rig",
]

#: name -> the module that it is found in
_FOUND_IN = {
    "Diverged": "errors",
    "Found": "api.diagnose",
    "Recording": "recording",
    "Rig": "physics.rig",
    "Run": "api.run",
    "UserError": "errors",
    "design": "api.experiments",
    "diagnose": "api.diagnose",
    "isolability": "api.experiments",
    "load_rig": "api.rigs",
    "plot_recording": "api.recordings",
    "read_recording": "api.recordings",
    "run": "api.run",
    "save_rig": "api.rigs",
}


def __getattr__(name: str) -> Any:
    """Import a public name at its first use (PEP 562)."""
    if name not in _FOUND_IN:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_FOUND_IN[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
