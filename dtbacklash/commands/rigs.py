"""A rig that was chosen on the command line, as others can choose it again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.config.compose import compose
from dtbacklash.config.groups import options
from dtbacklash.config.rig import RigConfig

if TYPE_CHECKING:
    from dtbacklash.physics.rig import Rig

FILE = "rig.yaml"


def called(rig: RigConfig) -> str | None:
    """The option of ``rig=`` that is this rig, with nothing changed in it; None if there is none."""
    if rig.name in options("rig") and compose("controller=open_loop", f"rig={rig.name}").rig == rig:
        return rig.name
    return None


def write(rig: Rig, folder: Path) -> Path:
    """Write the rig into a folder, as a file that ``rig=`` takes."""
    from dtbacklash.physics.rig_file import rig_yaml

    file = folder / FILE
    file.write_text(rig_yaml(rig), encoding="utf-8")
    return file
