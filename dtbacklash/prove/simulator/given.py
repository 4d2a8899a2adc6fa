"""What a run of the concealing simulator is given: the loop, the sensors' errors, physics beyond the catalogue."""

import math
from dataclasses import dataclass, field

from dtbacklash.arrays import Floats
from dtbacklash.prove.simulator import columns as other

#: name of the physics that the catalogue lacks -> its kind in the compiled loop
UNKNOWNS = {
    "position_damping": other.POSITION_DAMPING, "disturbance": other.DISTURBANCE,
    "directional_torque": other.DIRECTIONAL_TORQUE, "root_spring": other.ROOT_SPRING,
    "speed_stiffening": other.SPEED_STIFFENING, "angular_play": other.ANGULAR_PLAY,
    "position_mass": other.POSITION_MASS,
}  # fmt: skip


@dataclass(frozen=True)
class Unknown:
    """Physics that no entry of the catalogue describes; ``scale`` is the size of the state at which it is judged."""

    location: str
    name: str
    size: float
    scale: float


@dataclass(frozen=True)
class Loop:
    """What drives the rig: open loop (V), or closed loop on a reference (m, rad) by a controller of :mod:`.step`.

    reference, dither, disturbance : (N+1,). filter_rad_s : of the prefilter. limit : V.
    In cascade, gain : V/rad, integral : 1/s. ``pid`` names the sensor that a PID looks at: gain in V a unit of it,
    integral in V/s, rate in V s, all a unit, corner_rad_s : of the filter of the rate.
    """

    closed: bool
    reference: Floats
    dither: Floats
    disturbance: Floats
    gain: float = 0.0
    filter_rad_s: float = 1.0
    integral: float = 0.0
    limit: float = 48.0
    pid: str = ""
    rate: float = 0.0
    corner_rad_s: float = math.inf

    @property
    def mode(self) -> int:
        """Which of the simulator's controllers it is."""
        return other.OPEN if not self.closed else other.PID if self.pid else other.CASCADE


@dataclass(frozen=True)
class Errors:
    """The sensors' errors: name -> standard deviation and size of a count, SI; ``noise`` (N+1, ns) standard normal."""

    noise: dict[str, float] = field(default_factory=dict)
    resolution: dict[str, float] = field(default_factory=dict)
    draws: Floats | None = None
