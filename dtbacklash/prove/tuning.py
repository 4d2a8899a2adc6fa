"""A rig as a plant to be moved: what drives it, what it weighs, where it swings; a PID and its fewest sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.random import Generator

from dtbacklash.arrays import Floats
from dtbacklash.physics.bodies import natural_frequencies_hz, take_apart
from dtbacklash.physics.element_kinds import GROUND
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.simulator.machine import driven_body
from dtbacklash.prove.simulator.rig import roles

#: a loop crosses 0 dB below the rate at which its samples are a tenth of a radian, or a fifth where it has a spring to
#: beat; below a share of the first mode that it would have to damp; below the motor's electrical corner
SAMPLE_SHARE, SAMPLE_SHARE_SPRING, MODE_SHARE, WINDING_SHARE = 0.1, 0.2, 0.4, 0.5
#: how far below that it is drawn; and above the frequency of a spring to the ground
SLOWEST, ABOVE_SPRING = 0.25, (1.5, 3.0)
#: the lead of a PID begins this factor below the crossing and ends as far above it; its integral ends ten times below
LEAD, INTEGRAL = 3.0, 0.1
#: a sample is a millisecond, or less where a period of the fastest mode would have fewer than so many
SAMPLE_TIME_S, SAMPLES_A_PERIOD = 1e-3, 8.0


@dataclass(frozen=True)
class Drive:
    """A rig seen from its drive.

    driven : the body that is driven, or empty. per_volt : effort on it per volt at rest, N/V or N m/V. inertia : of all
    that springs tie to it, kg or kg m^2. modes_hz : ascending, without rigid motions. grounded : whether springs hold
    every body in its place. held : whether a servo holds the driven body, so that no loop is closed around it.
    winding_rad_s : the motor's electrical corner; infinite without a winding.
    sensor : of the driven body's position, or empty.
    """

    driven: str
    per_volt: float
    inertia: float
    modes_hz: Floats
    grounded: bool
    held: bool
    winding_rad_s: float
    sensor: str

    @property
    def drifts(self) -> bool:
        """Whether a force that is not balanced makes it run away: nothing holds it, no winding brakes it."""
        return not self.grounded and math.isinf(self.winding_rad_s)


def plant_of(rig: Rig) -> Drive:
    """The rig as its drive sees it."""
    driven, circuit, actuator = driven_body(rig) or "", rig.only("motor_circuit"), rig.only("actuator")
    v = circuit.values if circuit else {}
    per_volt = v["torque_constant"] / v["resistance"] if circuit else actuator.values["gain"] if actuator else 0.0
    per_volt = rig.servo.values["position_gain"] if rig.servo else per_volt
    modes = natural_frequencies_hz(rig)
    bodies = take_apart(rig, rig.only("positioner") is not None).bodies
    shown = (n for n, s in rig.sensors.items() if s.of == driven and s.quantity == "position")
    return Drive(
        driven, per_volt, _inertia(rig, driven), modes,
        len(modes) == len(bodies.names), rig.servo is not None,
        v["resistance"] / v["inductance"] if circuit else math.inf, next(shown, ""),
    )  # fmt: skip


def _inertia(rig: Rig, start: str) -> float:
    """The inertia of a body and of all that springs tie to it, as it feels them through their levers; 0 of none."""
    moves = {start: 1.0} if start else {}  # how far each goes per unit of the first one
    waiting = list(moves)
    for name in waiting:
        for link in rig.links():
            a, b = link.neighbours["between"]
            for here, there, ratio in ((a, b, link.lever), (b, a, 1.0 / link.lever)):
                if here == name and there not in moves and there != GROUND:
                    moves[there] = ratio * moves[name]
                    waiting.append(there)
    bodies = ((rig.elements[name], ratio) for name, ratio in moves.items())
    return sum(e.values[e.trait.inertia] * ratio**2 for e, ratio in bodies if e.trait.inertia)


def in_cascade(rig: Rig) -> bool:
    """Whether the rig is a motor with a gear and a screw that carries a mass, and has the sensors of their loop."""
    screw = rig.only("screw")
    if not (rig.only("motor_circuit") and rig.only("gear") and screw and screw.neighbours.get("carries")):
        return False
    shown = {rig.elements[s.of].kind for s in rig.sensors.values() if s.quantity == "position"}
    return {"rotor", "mass"} <= shown


def sample_time_s(rig: Rig) -> float:
    """The sampling time of a concealed recording, s."""
    step, modes = SAMPLE_TIME_S, natural_frequencies_hz(rig)
    while len(modes) and step * float(modes.max()) * SAMPLES_A_PERIOD > 1.0:
        step *= 0.5
    return step


def crossing_rad_s(rng: Generator, plant: Drive, step_s: float) -> float | None:
    """Where a loop around the driven body crosses 0 dB, drawn; None where no sensor or no sampling rate allows one."""
    low = SLOWEST
    if not plant.sensor or not plant.per_volt or plant.held:
        return None
    if plant.grounded:
        first = 2.0 * math.pi * float(plant.modes_hz.min())
        low, high = (factor * first for factor in ABOVE_SPRING)
        high = min(high, SAMPLE_SHARE_SPRING / step_s)
        return float(rng.uniform(low, high)) if low < high else None
    high = min(SAMPLE_SHARE / step_s, WINDING_SHARE * plant.winding_rad_s)
    if len(plant.modes_hz):
        high = min(high, MODE_SHARE * 2.0 * math.pi * float(plant.modes_hz.min()))
    return high * math.exp(float(rng.uniform(math.log(low), 0.0)))


def pid(plant: Drive, omega: float) -> dict[str, float]:
    """Gains of a PID that crosses 0 dB at ``omega``, from the rigid-body model ``inertia s^2``.

    The rule of thumb of motion control: a lead from omega/3 to 3 omega, an integral below omega/10, and the gain that
    makes the loop one at omega (Munnig Schmidt, Schitter, Rankers, The Design of High Performance Mechatronics).
    """
    gain = plant.inertia * omega**2 / (LEAD * plant.per_volt)
    return {
        "gain": gain, "integral": INTEGRAL * omega * gain, "rate": (LEAD**2 - 1.0) * gain, "corner_rad_s": LEAD * omega,
    }  # fmt: skip


def fewest_sensors(rig: Rig) -> list[str]:
    """The fewest sensors with which the rig can be moved and diagnosed, in its order: those of its loop.

    In a cascade the motor's angle and the position of the farthest mass; else the position of the driven body, or
    where there is none any position, or any sensor.
    """
    names = list(rig.sensors)
    if in_cascade(rig):
        return [names[j] for j in sorted(roles(rig))]
    positions = [n for n, s in rig.sensors.items() if s.quantity == "position"]
    return [plant_of(rig).sensor or (positions or names)[0]]
