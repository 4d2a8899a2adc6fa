"""What a small law adds along a motion, without simulating it: efforts on bodies, voltages, changes of readings.

Its effect on the innovations follows from the linear plant, so that hundreds of hypotheses cost one pass each of a few
states. What is no effort over states (a play, a delay, a memory) is simulated instead.
"""

from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.core.library import buffer, copied, lib
from dtbacklash.diagnosis.engine.hypotheses import Hypothesis
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.effects.table import KNOTS, SHAPES, STATES
from dtbacklash.physics.kernel.laws import values_of
from dtbacklash.physics.rig import SENSOR_PREFIX, Element, Rig

#: a law is looked at with so much of its start (share)
SMALL = 0.2


@dataclass(frozen=True)
class Entry:
    """Where an effort enters: bodies with factors, the voltage, a channel's reading, or a model's actuator."""

    bodies: dict[str, float]
    voltage: bool = False
    channel: str = ""
    drive: str = ""


def _rubbing(effect: Effect, values: Values, speed: Floats, load: Floats) -> Floats:
    """(N,) what a dry friction does at these speeds."""
    side = np.where(speed > 0.0, 1.0, -1.0)
    level = _law_values(effect, values, slip_speed=np.abs(speed), direction=side, load=load)
    return np.where(speed != 0.0, -side * level, 0.0)


def _law_values(effect: Effect, values: Values, **states: Floats | float) -> Floats:
    """(N,) a law of some values at these states."""
    return values_of(effect, values, **states)


def efforts(h: Hypothesis, rig: Rig, motion: Motion) -> tuple[Floats, Entry] | None:
    """(columns, N) of what a hypothesis adds per unit of its size or of each value of a table; None where no effort is.

    Of a phase that goes with the size the columns are its sine and its cosine. A hypothesis as it is adds all of
    itself: along the motion where a law is over the command, which does not depend on the motion, or where passes are
    dear, in a simulator's model.
    """
    if h.as_it_is and not rig.config.model and not isinstance(h.effect.slot, slots.Command):
        return None
    element = rig.elements.get(h.place)
    where = _entry(h, rig, motion, element)
    if where is None:
        return None
    if h.effect.is_table:
        return _table(h, motion), where
    size, found = h.effect.size, []
    for phase in (0.0, 0.5 * np.pi) if h.angle else (None,):
        values = {**h.values, size.name: (1.0 if h.as_it_is else SMALL) * h.values[size.name]}
        if phase is not None:
            values[h.angle] = phase
        if not values[size.name]:
            return None
        F = _law(h, values, rig, motion, element)
        if F is None:
            return None
        found.append(F if h.as_it_is else F / values[size.name])
    return np.array(found), where


def _entry(h: Hypothesis, rig: Rig, motion: Motion, element: Element | None) -> Entry | None:
    """Where the efforts of a place enter."""
    if h.place.startswith(SENSOR_PREFIX):
        return Entry({}, channel=h.place.removeprefix(SENSOR_PREFIX))
    if element is None:
        return None
    if element.trait.trait == slots.JOINT_DRIVE and isinstance(h.effect.slot, (slots.Command, slots.Late)):
        return Entry({}, drive=h.place)
    if isinstance(h.effect.slot, slots.Command):
        return Entry({}, voltage=True)
    if element.trait.trait == slots.SPRING:
        a, b = element.neighbours["between"]
        bodies = {body: f for body, f in ((b, -1.0), (a, element.lever)) if body in motion.position}
        return Entry(bodies) if bodies else None
    body = h.place if h.place in motion.position else element.neighbours.get("drives")
    return Entry({body: 1.0}) if body in motion.position else None


def _law(h: Hypothesis, values: Values, rig: Rig, motion: Motion, element: Element | None) -> Floats | None:
    """(N,) the effort of a law along the motion; None where it is none over states."""
    slot, states, n = h.effect.slot, motion.states(h.place), len(motion.command)
    if isinstance(slot, slots.Reading):
        shown = motion.shown.get(h.place.removeprefix(SENSOR_PREFIX))
        return None if shown is None else _law_values(h.effect, values, reading=shown) - shown
    if element is None:
        return None
    if isinstance(slot, slots.Late) and element.trait.trait == slots.JOINT_DRIVE:
        return _late(h, values[slot.time], motion)
    if isinstance(slot, slots.Command):
        return motion.averaged(lambda u: _law_values(h.effect, values, command=u) - u, h.place)
    if isinstance(slot, slots.BodyDamping):
        return -values[slot.coefficient] * states["speed"]
    if isinstance(slot, slots.BodyEffort):
        at = {"position": states["position"], "velocity": states["speed"]}
        return _law_values(h.effect, values, **at, time=motion.time, command=motion.command)
    if isinstance(slot, slots.SpringForce):
        spring = {name: element.values.get(name, 0.0) for name in ("stiffness", "damping")}
        return _law_values(
            h.effect, values, stretch=states["stretch"], stretch_rate=states["stretch rate"], time=motion.time,
            spring_stiffness=spring["stiffness"], spring_damping=spring["damping"],
        )  # fmt: skip
    if isinstance(slot, slots.Contact):
        return _friction(h, values, motion, element, n)
    if isinstance(slot, slots.MotorTorque) and motion.current is not None:
        body = element.neighbours["drives"]
        return _law_values(
            h.effect, values, current=motion.current, position=motion.position[body],
            torque_constant=element.values["torque_constant"],
        )  # fmt: skip
    if isinstance(slot, slots.HiddenBody):
        return _absorber(values[slot.mass], values[slot.frequency], values[slot.damping_ratio], h.place, motion)
    return None


def _late(h: Hypothesis, time_s: float, motion: Motion) -> Floats:
    """(N,) what a delay of an actuator's command changes."""
    samples = time_s / motion.recorded_s

    def moved(u: Floats) -> Floats:
        at = np.arange(len(u))
        return np.asarray(np.interp(at - samples, at, u) - u)

    return motion.averaged(moved, h.place)


def _friction(h: Hypothesis, values: Values, motion: Motion, element: Element, n: int) -> Floats | None:
    """(N,) dry friction, of a body, across a spring, or of what a drive or a spring passes on."""
    states, load = motion.states(h.place), np.zeros(n)
    if element.trait.trait == slots.SPRING:
        load = element.values["stiffness"] * states["stretch"]
        if isinstance(h.effect.slot, slots.Passing):
            return None  # it brakes one of two bodies, which one depends on what drives
        return -_rubbing(h.effect, values, states["stretch rate"], load)
    body = h.place if h.place in motion.position else element.neighbours.get("drives")
    if body not in motion.position or element.trait.trait == slots.SCREW:
        return None
    if isinstance(h.effect.slot, slots.Passing):
        effort = motion.driving(element)
        if effort is None:
            return None
        load = effort
    return _rubbing(h.effect, values, motion.speed[body], load)


def _absorber(mass: float, frequency_hz: float, damping_ratio: float, place: str, motion: Motion) -> Floats:
    """(N,) force of a hidden mass on a spring, from the acceleration of the body that carries it."""
    F, moved = np.empty(len(motion.command)), motion.acceleration[place]
    lib.dtb_absorber(
        len(F), mass, 2.0 * np.pi * frequency_hz, damping_ratio, motion.step_s, copied(moved, len(F)), buffer(F)
    )
    return F


def _table(h: Hypothesis, motion: Motion) -> Floats:
    """(KNOTS, N) what each value of a table adds."""
    shape, states = SHAPES[h.effect.name], motion.states(h.place)
    F, knots = np.empty((KNOTS, len(motion.command))), np.array([h.values[n] for n in STATES])
    lib.dtb_table_weights(F.shape[1], copied(states[shape.over], F.shape[1]), copied(knots, KNOTS), buffer(F))
    return F * states[shape.times] if shape.times else F
