"""The rigs that come with the package, each composed once a process."""

from functools import cache

from dtbacklash.config.compose import compose
from dtbacklash.physics.rig import Rig, build_rig


@cache
def nominal_rig(name: str = "lead_screw") -> Rig:
    """The rig of ``rig=NAME``. Rigs are immutable; who changes the description in one copies it first."""
    return build_rig(compose("controller=open_loop", f"rig={name}").rig)
