"""Physics that the catalogue does not have: where a rig takes it, and how large it may be."""

from __future__ import annotations

from numpy.random import Generator

from dtbacklash.physics.effects import slots
from dtbacklash.physics.rig import Rig
from dtbacklash.prove import tuning
from dtbacklash.prove.simulator.machine import carried_mass, driven_body
from dtbacklash.prove.sizes import Motion

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


def unknown_range(rng: Generator, rig: Rig, place: str, name: str, motion: Motion) -> tuple[float, float, float]:
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
