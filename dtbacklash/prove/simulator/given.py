"""The inputs of a run of the concealing simulator: loop, errors of the sensors, physics beyond the catalogue."""

import math
from dataclasses import dataclass, field

from dtbacklash.arrays import Floats
from dtbacklash.prove.simulator.library import lib


@dataclass(frozen=True)
class Unlisted:
    """Physics that the catalogue lacks; its kind is the constant of ``machine.h`` with its name in capitals.

    scale : the typical size of the state that it depends on, or the second ripple's share of the first.
    wave, phase, second, shift : wave number and phase of a ripple, and of a second one. seed : of its course.
    """

    location: str
    name: str
    size: float
    scale: float = 1.0
    wave: float = 0.0
    phase: float = 0.0
    second: float = 0.0
    shift: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Loop:
    """What drives the rig: open loop (V), or closed loop on a reference (m, rad) by a controller of ``simulator.c``.

    reference, dither : (N+1,). disturbance : the same, or (N+1, number of unknown laws). filter_rad_s : of the
    prefilter. limit : V.
    gain, integral : of a cascade in V/rad and 1/s; of a PID in V and V/s per unit of the sensor ``pid``. rate : V s per
    unit. corner_rad_s : of the filter of the rate.
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
        """The number of the simulator's controller."""
        return int(lib.OPEN if not self.closed else lib.PID if self.pid else lib.CASCADE)


@dataclass(frozen=True)
class Errors:
    """The sensors' errors: name -> standard deviation and size of a count, SI; ``noise`` (N+1, ns) standard normal."""

    noise: dict[str, float] = field(default_factory=dict)
    resolution: dict[str, float] = field(default_factory=dict)
    draws: Floats | None = None
