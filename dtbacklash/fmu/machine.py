"""A rig that is advanced from outside, sample by sample, from rest."""

from __future__ import annotations

import math

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.core.library import buffer, lib
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel.plant import new_state, place_at
from dtbacklash.physics.kernel.structs import plant_struct, state_struct
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import rig_half_gap

#: commands that are remembered where a positioner imposes them: its motion between two samples is smooth through their
#: neighbours, so that it is drawn when the second one behind is known
WINDOW, HERE = 4, 1
#: samples by which a positioner follows its command for that reason
LATE_SAMPLES = WINDOW - 1 - HERE


class Machine:
    """A rig's compiled plant and its state, at rest at first.

    rig : a checked rig. sample_time_s, substeps, event_levels : as for :func:`.assembly.compile_plant`.
    start_s : the time at which it begins. u : the command there, V, where a positioner stands. gap_rad : half-gap
    there beside the rig's own.

    Attributes
    ----------
    y : (sensors + 1,) the true values of the rig's sensors in their order, SI, and theta_d, rad.
    """

    def __init__(
        self, rig: Rig, sample_time_s: float, substeps: int = 0, event_levels: int = 16, start_s: float = 0.0,
        u: float = 0.0, gap_rad: float = 0.0,
    ) -> None:  # fmt: skip
        self.plant = compile_plant(rig, sample_time_s, substeps, event_levels)
        self.state = new_state(self.plant)
        self.start_s, self.samples = start_s, 0
        self.y: Floats = np.zeros(len(rig.sensors) + 1)
        self._own = rig_half_gap(rig)
        self._gap = gap_rad + self._own
        self._window = np.full(WINDOW, u)
        if self.plant.imposed:
            place_at(self.plant, self.state, u)
        self._hold(0, u, self._gap)

    @property
    def t_s(self) -> float:
        """The time at which it stands, s."""
        return self.start_s + self.samples * self.plant.sample_time

    def advance(self, samples: int, u: float, gap_rad: float) -> None:
        """Advance by whole samples.

        u : command held over all of them, V. gap_rad : half-gap beside the rig's own that is reached, linearly, at the
        end of the first of them.
        """
        gap = gap_rad + self._own
        self._hold(samples, u, gap)
        self._gap = gap
        self.samples += samples

    def _hold(self, samples: int, u: float, gap: float) -> None:
        lib.dtb_hold(
            plant_struct(self.plant), state_struct(self.state), self.start_s, self.samples, samples, u, self._gap, gap,
            buffer(self._window), WINDOW, HERE, buffer(self.y),
        )  # fmt: skip

    def is_finite(self) -> bool:
        """Whether every value that it shows is a number: with a wrong parameter it may run away."""
        return all(map(math.isfinite, self.y))
