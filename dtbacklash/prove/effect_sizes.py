"""How large a hidden effect may be, and the size at which it has the drawn visibility; physics beyond the catalogue."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Place
from dtbacklash.physics.element_kinds import ROTARY
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.prove import tuning
from dtbacklash.prove.excitation import turn_m
from dtbacklash.prove.simulator.machine import carried_mass, driven_body
from dtbacklash.prove.simulator.rig import Trial
from dtbacklash.prove.testbench import rms

#: largest friction or load on the motor of a cascade, as the voltage that makes the same torque at rest, V
EFFORT_MAX_V = 8.0
#: largest friction or load relative to the rms effort on a body that the motor drives, and that springs drive
EFFORT_MAX_DRIVEN, EFFORT_MAX = 1.5, 3.0
#: frequencies of a hidden mass, relative to the highest one of the excitation, on a rig without modes
HIDDEN_SHARES = (0.25, 0.6)
#: trial simulations, and the factor within which the drawn visibility is reached
TRIALS, NEAR = 7, 1.2


@dataclass(frozen=True)
class Moved:
    """How the plain rig moves under the excitation; SI, by name of link or body.

    command : (N,) V. current : rms, A. highest_hz : of the excitation. place, velocity : rms of each body. stretch,
    rate, force : rms of each link. reach : largest stretch of a link or position of a body. drive : rms effort on the
    driven body. shown : rms of each sensor's signal.
    """

    rig: Rig
    command: Floats
    current: float
    duration_s: float
    highest_hz: float
    place: dict[str, float] = field(default_factory=dict)
    velocity: dict[str, float] = field(default_factory=dict)
    stretch: dict[str, float] = field(default_factory=dict)
    rate: dict[str, float] = field(default_factory=dict)
    reach: dict[str, float] = field(default_factory=dict)
    force: dict[str, float] = field(default_factory=dict)
    drive: dict[str, float] = field(default_factory=dict)
    shown: dict[str, float] = field(default_factory=dict)

    def at(self, name: str) -> Place:
        """The motion at an element or a sensor, for an effect's declaration."""
        frequencies = natural_frequencies_hz(self.rig)
        sensor = name.removeprefix(SENSOR_PREFIX)
        low, high = (share * self.highest_hz for share in HIDDEN_SHARES)
        place = Place(
            duration_s=self.duration_s, command=self.command, current=self.current,
            travel=turn_m(self.rig) if self.rig.only("screw") else self.shown.get(sensor, 0.0),
            modes=(float(frequencies.min()), float(frequencies.max())) if len(frequencies) else (low, high),
            reach=self.reach.get(name, 0.0),
        )  # fmt: skip
        if name not in self.rig.elements:
            return place
        element = self.rig.elements[name]
        place = replace(place, values=element.values, speed=self.velocity.get(name, 0.0))
        if element.trait.trait == slots.SERVO:
            driven = element.neighbours["drives"]
            return replace(place, speed=self.velocity[driven], force=self.drive[driven])
        if element.trait.trait == slots.SPRING:
            s, rate, force = self.stretch[name], self.rate[name], self.force[name]
            return replace(place, span=s, stretch_rate=rate, force=force, force_most=EFFORT_MAX * force)
        force, most = self._moving(name)
        return replace(place, force=force, force_most=most * force)

    def _moving(self, name: str) -> tuple[float, float]:
        """Rms effort on a body, N or N m, and the largest friction or load relative to it."""
        element = self.rig.elements[name]
        if tuning.in_cascade(self.rig):
            circuit = self.rig.only("motor_circuit")
            if circuit is not None and element.trait.axis == ROTARY:
                return circuit.values["torque_constant"] / circuit.values["resistance"], EFFORT_MAX_V
            return max(self.force.values(), default=1.0), EFFORT_MAX
        if name in self.drive:
            return self.drive[name], EFFORT_MAX_DRIVEN
        pulls = [
            self.force[link.name] * (link.lever if link.neighbours["between"][0] == name else 1.0)
            for link in self.rig.links() if name in link.neighbours["between"]
        ]  # fmt: skip
        return max(pulls, default=0.0), EFFORT_MAX


def motion_of(rig: Rig, run: Trial, duration_s: float, highest_hz: float) -> Moved:
    """Measure how the rig moves in a run."""
    nb, x = len(run.bodies), run.states
    zero = np.zeros(len(x))
    q = {name: x[:, 2 + j] for j, name in enumerate(run.bodies)} | {"ground": zero}
    v = {name: x[:, 2 + nb + j] for j, name in enumerate(run.bodies)} | {"ground": zero}
    for name, place, speed in _borne(rig, run):
        q.setdefault(name, place)
        v.setdefault(name, speed)
    shown = {name: rms(values) for name, values in run.truth.items()}
    found = Moved(rig, run.u, rms(x[:, 0]), duration_s, highest_hz, shown=shown)
    for name in q:
        found.place[name], found.velocity[name] = rms(q[name]), rms(v[name])
        found.reach[name] = float(np.abs(q[name]).max())
    for link in rig.links():
        a, b = link.neighbours["between"]
        s, rate = q[b] - link.lever * q[a], v[b] - link.lever * v[a]
        found.stretch[link.name], found.rate[link.name] = rms(s), rms(rate)
        found.reach[link.name] = float(np.abs(s).max())
        force = link.values["stiffness"] * s + link.values.get("damping", 0.0) * rate
        found.force[link.name] = rms(force)
    if driven := driven_body(rig):
        per_volt = tuning.plant_of(rig).per_volt
        effort = per_volt * run.u
        if rig.servo:
            effort = per_volt * (run.u - q[driven]) - rig.servo.values.get("speed_gain", 0.0) * v[driven]
        found.drive[driven] = rms(effort)
    return found


def _borne(rig: Rig, run: Trial) -> list[tuple[str, Floats, Floats]]:
    """(name, position, velocity) of what the screw or the positioner moves rigidly."""
    screw, positioner, x = rig.only("screw"), rig.only("positioner"), run.states
    found = []
    if screw and (carried := carried_mass(rig)):
        lead = screw.values["lead"]
        found.append((carried, lead * x[:, 1], lead * x[:, 2 + len(run.bodies)]))
    if positioner:
        course = positioner.values["travel"] * run.u
        found.append((positioner.name, course, np.gradient(course, run.sample_time_s)))
    return found


def strength_for(
    visibility: Callable[[float], float], target: float, guess: float, most: float, near: float = NEAR
) -> float:
    """The strength at which an effect has the visibility ``target``, or the largest that is allowed.

    A secant search in logarithms between bounds. A loop that diverges counts as infinitely visible.
    """
    low, high = 0.0, math.inf
    strength, slope, last = min(guess, most), 1.0, None
    for _ in range(TRIALS):
        seen = visibility(strength)
        if target / near <= seen <= target * near or (seen < target and strength >= most):
            return strength
        low, high = (max(low, strength), high) if seen < target else (low, min(high, strength))
        if math.isinf(seen):
            strength = math.sqrt(low * high) if low > 0.0 else 0.1 * strength
            continue
        point = math.log(strength), math.log(max(seen, 1e-3))
        if last is not None and point[0] != last[0]:
            slope = min(max((point[1] - last[1]) / (point[0] - last[0]), 0.4), 3.0)
        last = point
        step = math.log(target / max(seen, 1e-3)) / slope
        strength = min(most, strength * math.exp(min(max(step, -6.0), 6.0)))
        if not low < strength < high:
            strength = math.sqrt(max(low, 1e-3 * high) * high)
    return low if low > 0.0 else strength


DESCRIPTIONS = {
    "position_damping": "damping against the ground that grows with the square of the position",
    "disturbance": "an unmeasured disturbance with a course of its own",
    "directional_torque": "a torque or force constant that differs by the direction of motion",
    "root_spring": "a part of the spring's force that grows with the square root of the stretch",
    "speed_stiffening": "a spring that stiffens with the rate of its stretch",
    "angular_play": "a play that depends on the angle of the screw",
    "position_mass": "a mass that changes with the position",
}
#: what each trait of an element takes; an ideal actuator has no trait
_TAKES = {
    slots.WINDING: ["directional_torque"], slots.GEAR: ["angular_play"],
    slots.SPRING: ["root_spring", "speed_stiffening"],
    slots.BODY: ["position_damping", "disturbance", "position_mass"],
}  # fmt: skip


def unknown_entries(rig: Rig) -> list[tuple[str, str]]:
    """(location, name) of the physics beyond the catalogue, wherever the rig takes it."""
    carried, found = carried_mass(rig), []
    for element in rig.elements.values():
        names = ["directional_torque"] if element.kind == "actuator" else _TAKES.get(element.trait.trait, [])
        if rig.only("gear") and element.kind == "rotor":
            names = ["disturbance"]  # it turns without limit, so that no law can depend on its position
        if element.name != carried:
            found += [(element.name, name) for name in names]
    return found


def unknown_range(rng: Generator, rig: Rig, place: str, name: str, motion: Moved) -> tuple[float, float, float]:
    """(scale of the state, first guess of the size, largest size) of physics beyond the catalogue."""
    at, speed = motion.at(place), motion.velocity.get(place, 0.0)
    if name == "disturbance":
        guess = 0.1 if tuning.in_cascade(rig) and rig.elements[place].kind == "rotor" else 0.05
        return 1.0, guess * at.force, at.force_most
    if name == "angular_play":
        return float(rng.uniform(0.4, 2.0)), 0.03, 1.0
    if name == "directional_torque":
        return 0.02 * motion.velocity[driven_body(rig) or ""], 0.1, 0.9
    if name == "root_spring":
        return motion.stretch[place], 0.05, 3.0
    if name == "speed_stiffening":
        return motion.rate[place], 0.05, 3.0
    if name == "position_mass":
        return motion.place[place], 0.05, 0.4
    return motion.place[place], 0.05 * at.force / speed, at.force_most / speed
