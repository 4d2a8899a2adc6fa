"""A rig that is advanced from outside, sample by sample, from rest."""

from __future__ import annotations

import math

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.compiled import compiled
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.kernel.dispatch import with_addresses
from dtbacklash.physics.kernel.plant import new_state, place_at
from dtbacklash.physics.kernel.sample import advance, read_sensor
from dtbacklash.physics.kernel.step import screw_angle
from dtbacklash.physics.rig import Rig
from dtbacklash.physics.simulate import rig_half_gap

#: commands that are remembered where a positioner imposes them: its motion between two samples is smooth through their
#: neighbours, so that it is drawn when the second one behind is known
WINDOW, HERE = 4, 1
#: samples by which a positioner follows its command for that reason
LATE_SAMPLES = WINDOW - 1 - HERE


@compiled
def _run(P, S, start_s, first, samples, u, gap, gap_to, window, y):
    """Run samples with the command held; the gap is at ``gap_to`` after the first of them."""
    rate = 0.0
    for k in range(first, first + samples):
        for j in range(window.shape[0] - 1):
            window[j] = window[j + 1]
        window[window.shape[0] - 1] = u
        advance(P, S, start_s + k * P.sample_time, u, gap, gap_to, window, HERE)
        rate = (gap_to - gap) / P.sample_time
        gap = gap_to
    _show(P, S, gap, rate, y)


@compiled
def _show(P, S, gap, rate, y):
    """What every sensor measures, SI, and the screw's angle behind it."""
    last = y.shape[0] - 1
    for s in range(last):
        y[s] = read_sensor(P, S, s, gap, rate)
    y[last] = screw_angle(P, S, gap) if P.rotor >= 0 else 0.0


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
        self.plant = with_addresses(compile_plant(rig, sample_time_s, substeps, event_levels))
        self.state = new_state(self.plant)
        self.start_s, self.samples = start_s, 0
        self.y: Floats = np.zeros(len(rig.sensors) + 1)
        self._own = rig_half_gap(rig)
        self._gap = gap_rad + self._own
        self._window = np.full(WINDOW, u)
        if self.plant.imposed:
            place_at(self.plant, self.state, u)
        _run(self.plant, self.state, start_s, 0, 0, u, self._gap, self._gap, self._window, self.y)

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
        arguments = (self.start_s, self.samples, samples, u, self._gap, gap, self._window, self.y)
        _run(self.plant, self.state, *arguments)
        self._gap = gap
        self.samples += samples

    def is_finite(self) -> bool:
        """Whether every value that it shows is a number: with a wrong parameter it may run away."""
        return all(map(math.isfinite, self.y))
