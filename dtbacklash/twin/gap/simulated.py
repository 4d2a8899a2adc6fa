"""The twin's full simulation: what it believes of the structure, effects included, driven by the measured motor angle.

The linear twin compares filtered signals, ``eps = den/chi q3 - num/chi theta_d`` (:mod:`.observer`). As G2 = num/den,
that is ``den/chi (q3 - G2 theta_d)``, and here a simulation with all that is believed stands for ``G2 theta_d``. The
filter stays: it takes out how the structure was moving when the buffer began, as far as that is linear.

What the effects change in the output hangs little on the gap. So the best gap is sought by simulation, and the guard
then sees the buffer with that change taken out (:func:`corrected`): what is left is the linear twin's problem.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.belief import bending
from dtbacklash.core.library import buffer, copied, lib
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.bodies import take_apart
from dtbacklash.physics.kernel.plant import Plant, State, new_state
from dtbacklash.physics.kernel.structs import plant_struct, state_struct
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, Sensor
from dtbacklash.twin.gap import observer
from dtbacklash.twin.gap.estimate import OptimizerLike, Problem, default_start, estimate_gap
from dtbacklash.twin.gap.observer import TwinModel

#: steps a sample and halvings to a contact: the twin's error lies far below that of any sensor
SUBSTEPS, EVENT_LEVELS = 4, 8
#: half-width of the differences by which derivatives are taken, rad (0.02 deg), and rad/s for the growth
STEP_RAD, STEP_RAD_S = 3.5e-4, 3.5e-4


def follow(P: Plant, S: State, theta_m: Floats, gap: Floats, index: int, y: Floats, q3: Floats) -> None:
    """q3 at every sample of the buffer; the gap's own change does not push the screw before the motor does.

    theta_m, gap : (N,) rad. index : of the sensor. y : (sensors,) room. q3 : (N,) filled.
    """
    N = len(theta_m)
    lib.dtb_follow(
        plant_struct(P), state_struct(S), N, copied(theta_m, N), copied(gap, N), index, buffer(y, len(P.sensor)),
        buffer(q3, N),
    )  # fmt: skip


@dataclass(frozen=True)
class Structure:
    """What moves behind the gear, for the core.

    index : of the output's sensor. rest_by_travel, rest_by_output : (bodies,) where the bodies rest per m of the
    screw's travel and per m of the output, where that is held: dry friction can hold it off its balance.
    """

    plant: Plant
    index: int
    rest_by_travel: Floats
    rest_by_output: Floats
    lead: float

    @classmethod
    def of(cls, rig: Rig, sensor: Sensor, sample_time_s: float, linear: bool = False) -> Structure:
        """From a believed rig; its backlash is what the twin looks for, and its sensors are taken to be right.

        linear : without the effects that bend it.
        """
        gear, bent = rig.only("gear"), bending(rig) if linear else []
        for place, name in [(p, n) for p, there in rig.effects.items() for n in there]:
            if (gear and place == gear.name) or place.startswith(SENSOR_PREFIX) or (place, name) in bent:
                rig = rig.with_effect(place, name, None)
        plant = compile_plant(rig, sample_time_s, SUBSTEPS, EVENT_LEVELS, imposed=True)
        bodies = take_apart(rig, imposed=True).bodies
        screw = rig.only("screw")
        assert screw is not None
        held = bodies.names.index(sensor.of)
        free = [j for j in range(len(bodies.names)) if j != held]
        by_travel, by_output = np.zeros(len(bodies.names)), np.zeros(len(bodies.names))
        by_output[held] = 1.0
        inner = bodies.K[np.ix_(free, free)]
        by_travel[free] = np.linalg.solve(inner, bodies.base_k[free])
        by_output[free] = np.linalg.solve(inner, -bodies.K[free, held])
        return cls(plant, list(rig.sensors).index(sensor.name), by_travel, by_output, screw.values["lead"])

    def position(self, theta_m: Floats, half_gap: Floats, theta_d0: float, q3_0: float) -> Floats:
        """(N,) position of the output, m, from rest at ``q3_0``, m, behind ``theta_d0``, rad.

        theta_m, half_gap : (N,) rad.
        """
        plant, state = self.plant, new_state(self.plant)
        state.gear[0] = min(max(theta_d0, theta_m[0] - half_gap[0]), theta_m[0] + half_gap[0])
        rest = self.rest_by_travel * self.lead * state.gear[0] + self.rest_by_output * q3_0
        state.x[plant.position : plant.position + plant.n_bodies] = rest
        q3 = np.empty(len(theta_m))
        follow(plant, state, theta_m, half_gap, self.index, np.zeros(len(plant.sensor)), q3)
        return q3


class SimulatedProblem(Problem):
    """A buffer, explained by a simulation of all that is believed; arguments as of :class:`.estimate.Problem`.

    structure : what is believed. linear : the same without the effects that bend it.
    """

    def __init__(
        self, theta_m_rad: Floats, q3_m: Floats, model: TwinModel, structure: Structure, linear: Structure,
        gap_max_rad: float = np.pi,
    ) -> None:  # fmt: skip
        super().__init__(theta_m_rad, q3_m, model, gap_max_rad)
        self.structure, self.linear = structure, linear
        self._middle = 0.5 * (self.theta_m.size - 1)

    def cost(self, gap_rad: float, theta_d0_rad: float) -> float:
        """Mean square output error, m^2."""
        return float(np.mean(self._error(abs(gap_rad), theta_d0_rad, 0.0) ** 2))

    def cost_and_gradient(self, gap_rad: float, theta_d0_rad: float) -> tuple[float, float, float]:
        """Mean square output error, m^2, and its derivatives by gap and theta_d0, m^2/rad."""
        error, by_gap, by_start = self._differences(gap_rad, theta_d0_rad)[:3]
        scale = 2.0 / error.size
        return float(np.mean(error**2)), scale * float(error @ by_gap), scale * float(error @ by_start)

    def simulation(self) -> dict[str, Any]:
        """See :meth:`.estimate.Problem.simulation`."""
        room = np.empty((4, self.counted))

        def cost(_: Any, gap: float, start: float, out: Any) -> None:
            out[0], out[1], out[2] = self.cost_and_gradient(gap, start)

        def rows(_: Any, gap: float, start: float, growth: float, _out: Any) -> None:
            room[:] = self.rows(gap, start, growth)

        return {
            "cost": self.calls("void(void *, double, double, double *)", cost),
            "rows": self.calls("void(void *, double, double, double, double *)", rows),
            "simulated": room.ravel(),
        }

    def rows(self, gap_rad: float, theta_d0_rad: float, growth_rad_s: float = 0.0) -> Floats:
        """Output error and its derivatives by gap, theta_d0 and growth: (4, counted samples), SI."""
        return np.array(self._differences(gap_rad, theta_d0_rad, growth_rad_s, growth=True))

    def position(self, structure: Structure, gap_rad: float, theta_d0_rad: float, growth_rad_s: float) -> Floats:
        """(N,) output of a structure behind a gap that grows, m; gap in the middle of the buffer."""
        after_s = (np.arange(self.theta_m.size) - self._middle) * self.model.sample_time_s
        gap = np.maximum(gap_rad + growth_rad_s * after_s, 0.0)
        return structure.position(self.theta_m, gap, theta_d0_rad, float(self.q3[0]))

    def _error(self, gap_rad: float, theta_d0_rad: float, growth_rad_s: float) -> Floats:
        simulated = self.position(self.structure, gap_rad, theta_d0_rad, growth_rad_s)
        error: Floats = (self.eps_q - observer.filtered(simulated, self.model.from_q3))[self.model.settle :]
        return error

    def _differences(
        self, gap_rad: float, theta_d0_rad: float, growth_rad_s: float = 0.0, growth: bool = False
    ) -> list[Floats]:
        """The error and central differences of it. The cost is even in the gap: its slope turns with the gap's sign."""
        size, sign = abs(gap_rad), -1.0 if gap_rad < 0.0 else 1.0
        h = STEP_RAD

        def slope(change: Callable[[float], Floats], step: float) -> Floats:
            return (change(step) - change(-step)) / (2.0 * step)

        low = max(size - h, 0.0)
        high = size + h
        by_gap = self._error(high, theta_d0_rad, growth_rad_s) - self._error(low, theta_d0_rad, growth_rad_s)
        found = [
            self._error(size, theta_d0_rad, growth_rad_s),
            sign * by_gap / (high - low),
            slope(lambda d: self._error(size, theta_d0_rad + d, growth_rad_s), h),
        ]
        if growth:
            found.append(slope(lambda d: self._error(size, theta_d0_rad, growth_rad_s + d), STEP_RAD_S))
        return found


def corrected(problem: SimulatedProblem, optimizer: OptimizerLike, present_rad: float) -> Problem:
    """The buffer for the linear twin, with what the effects change at the best simulated estimate taken out.

    Sought from the gap in force and from the linear twin's estimate, ``present_rad`` : the former, rad.
    """
    plain = Problem(problem.theta_m, problem.q3, problem.model, problem.gap_max_rad)
    linear = estimate_gap(plain, optimizer, default_start(plain, present_rad))
    starts = [default_start(problem, present_rad), (linear.fit_gap_rad, linear.theta_d0_rad)]
    best = min((estimate_gap(problem, optimizer, start) for start in starts), key=lambda e: e.cost_m2)
    point = best.gap_rad, best.theta_d0_rad, best.growth_rad_s
    changed = problem.position(problem.structure, *point) - problem.position(problem.linear, *point)
    return Problem(problem.theta_m, problem.q3 - changed, problem.model, problem.gap_max_rad)
