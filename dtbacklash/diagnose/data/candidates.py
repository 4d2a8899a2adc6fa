"""The effects that a rig may lack, with start values of their parameters, and how each place of a rig moves."""

from dataclasses import dataclass, field, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import Block, Record, places_of, predict
from dtbacklash.diagnose.data.pull import position_unknown
from dtbacklash.errors import UserError
from dtbacklash.physics.bodies import natural_frequencies_hz
from dtbacklash.physics.catalogue import is_found
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Bounds, Effect, Place, Values
from dtbacklash.physics.rig import SENSOR_PREFIX, Element, Rig, build_rig

#: speeds below this share of the fastest count as rest
TREMOR = 0.02


@dataclass(frozen=True)
class Candidate:
    """One effect at one place, with the values at which its signatures are simulated."""

    place: str
    effect: Effect
    grid: list[Values] = field(default_factory=list)

    @property
    def key(self) -> tuple[str, str]:
        """(place, effect's name)."""
        return self.place, self.effect.name


def candidates(rig: Rig, blocks: list[Block], moving: "PlacesInMotion") -> list[Candidate]:
    """All effects that the rig does not have and that the blocks can show."""
    places = set().union(*(places_of(rig, b) for b in blocks))
    channels = {SENSOR_PREFIX + c for b in blocks for c in b.channels}
    unseen = set().union(*(places_of(rig, b) for b in blocks if position_unknown(rig, b, moving.step_s)))
    listed = []
    for place in [*rig.elements, *sorted(p for p in places if p.startswith(SENSOR_PREFIX))]:
        if place not in channels | places:
            continue
        for effect in rig.takes(place).values():
            if place in unseen and _depends_on_position(effect):
                continue
            foreign = is_found(effect) and effect.name not in rig.config.laws  # found in another recording
            possible = not effect.is_table and not foreign and rig.effect(place, effect.name) is None
            possible = possible and _possible(rig, place, effect)
            if possible and effect.is_shown(moving(place)):
                starts, bounds = effect.start_values(moving(place)), effect.bounds_at(moving(place))
                listed.append(Candidate(place, effect, [_within(v, bounds) for v in starts]))
    return listed


def _within(values: Values, bounds: Bounds) -> Values:
    return {name: float(np.clip(v, *bounds[name])) if name in bounds else v for name, v in values.items()}


def _depends_on_position(effect: Effect) -> bool:
    return bool({"position", "angle"} & slots.asked(effect))


def _possible(rig: Rig, place: str, effect: Effect) -> bool:
    """Whether the rig can be built with the effect, and the effect can act there."""
    base = (screw := rig.only("screw")) and screw.neighbours.get("carries")
    if place == base and not (screw and rig.amount(screw.name, slots.Yielding, "compliance")):
        return False  # a rigid screw moves this mass, whatever acts on it
    try:
        rig.with_effect(place, effect.name, {effect.size.name: effect.size.typical})
    except UserError:
        return False
    return True


class PlacesInMotion:
    """How each place of a rig moves in the recordings: measured, or simulated where it is not measured.

    All are interpolated to the shortest sample time: it only says in which ranges things are looked for.
    """

    def __init__(self, rig: Rig, blocks: list[Block], records: list[Record]) -> None:
        self.rig, self.step_s = rig, min(r.sample_time_s for r in records)
        fitted = [r for r in records if r.train.any()] or records[:1]
        each = [{body: _at_step(q, r, self.step_s) for body, q in positions(rig, blocks, r).items()} for r in fitted]
        self.where = {body: np.concatenate([at[body] for at in each]) for body in each[0]}
        self.target = np.concatenate([_at_step(r.u, r, self.step_s) for r in fitted])
        self.command = np.concatenate([_at_step(r.u, r, self.step_s) for r in records])
        frequencies = natural_frequencies_hz(rig)
        modes = (float(frequencies.min()), float(frequencies.max())) if len(frequencies) else (0.0, 0.0)
        screw = rig.only("screw")
        self._everywhere = Place(
            duration_s=len(self.command) * self.step_s, sample_time_s=self.step_s, modes=modes, command=self.command,
            travel=2.0 * np.pi * screw.values["lead"] if screw else 0.0,
        )  # fmt: skip

    def __call__(self, name: str) -> Place:
        """The motion at a place, for an effect's declaration."""
        element = self.rig.elements.get(name)
        if element is None:
            return self._everywhere
        moved = self._moved(name)
        speeds = self._speeds(moved)
        fastest = float(np.quantile(speeds, 0.98))
        place = replace(
            self._everywhere, values=element.values, way=float(np.ptp(self.where.get(moved, np.zeros(1)))),
            speed=fastest, speed_slow=float(np.quantile(speeds[speeds >= TREMOR * fastest], 0.25)),
        )  # fmt: skip
        if element.trait.trait == slots.SPRING:
            stretch, rate = self._stretch(name)
            span = float(np.quantile(np.abs(stretch), 0.95))
            return replace(place, stretch=stretch, span=span, stretch_rate=rate, reach=float(np.abs(stretch).max()))
        if element.trait.trait == slots.BODY:
            return replace(place, force=self._force(name))
        if element.trait.trait == slots.SERVO:
            return replace(place, force=self._loop_effort(element))
        return place

    def lowest(self, name: str) -> float:
        """The lowest position of a place, m or rad; 0 where its motion is not known."""
        return float(self.where.get(self._moved(name), np.zeros(1)).min())

    def _moved(self, name: str) -> str:
        """The body whose motion counts at an element: itself, what a servo drives, or the motor's rotor."""
        element = self.rig.elements[name]
        if element.trait.trait == slots.SERVO:
            return str(element.neighbours["drives"])
        return name if element.trait.trait == slots.BODY else getattr(self.rig.motor_rotor(), "name", "")

    def _speeds(self, name: str) -> Floats:
        """(n,) absolute speeds of a body, m/s or rad/s; a single 0 where its motion is not known."""
        smooth = np.convolve(self.where.get(name, np.zeros(1)), np.ones(9) / 9, "same")[8:-8]
        return np.abs(np.diff(smooth)) / self.step_s if len(smooth) > 2 else np.zeros(1)

    def _stretch(self, name: str) -> tuple[Floats, float]:
        """(N,) stretch of a spring, and its usual rate."""
        zero = np.zeros(len(self.command))
        ends = self.rig.elements[name].neighbours["between"]
        a, b = (self.where.get(e, zero[: len(next(iter(self.where.values()), zero))]) for e in ends)
        stretch = b - self.rig.elements[name].lever * a
        return stretch, float(np.quantile(np.abs(np.diff(stretch)) / self.step_s, 0.9))

    def _loop_effort(self, servo: Element) -> float:
        """Nearly the largest effort that a servo's loop asks for, N or N m."""
        moved = self.where.get(servo.neighbours["drives"], np.zeros(1))
        asked = self.target - moved if len(moved) == len(self.target) else self.target
        return servo.values["position_gain"] * float(np.quantile(np.abs(asked), 0.98))

    def _force(self, name: str) -> float:
        """The usual size of the largest effort on a body, N or N m: of the springs at it, or the motor."""
        force = 0.0
        for link in self.rig.links():
            if name in link.neighbours["between"]:
                pull = link.values["stiffness"] * float(np.quantile(np.abs(self._stretch(link.name)[0]), 0.9))
                force = max(force, pull * (link.lever if link.neighbours["between"][0] == name else 1.0))
        actuator, circuit, servo = self.rig.only("actuator"), self.rig.only("motor_circuit"), self.rig.servo
        if servo and servo.neighbours["drives"] == name:
            force = max(force, self._loop_effort(servo))
        usual = float(np.std(self.command))
        if actuator and actuator.neighbours["drives"] == name:
            force = max(force, actuator.values["gain"] * usual)
        if circuit and circuit.neighbours["drives"] == name:
            force = max(force, circuit.values["torque_constant"] / circuit.values["resistance"] * usual)
        return force


def _at_step(values: Floats, record: Record, step_s: float) -> Floats:
    """A signal of a record, interpolated to another sample time."""
    if record.sample_time_s == step_s:
        return values
    times = record.sample_time_s * np.arange(len(values))
    return np.interp(np.arange(0.0, times[-1] + step_s, step_s), times, values)


def positions(rig: Rig, blocks: list[Block], record: Record) -> dict[str, Floats]:
    """Body -> (N,) position, SI: measured, or as the blocks simulate it."""
    found: dict[str, Floats] = {}
    for block in blocks:
        inside = [e.name for e in rig.bodies() if e.name in places_of(rig, block)]
        sensors = {f"_{b}": {"of": b, "quantity": "position"} for b in inside}
        config = replace(rig.config, sensors={**rig.config.sensors, **sensors})
        wide = replace(block, channels=(*block.channels, *sensors))
        y = {**record.y, **{s: np.zeros(record.samples) for s in sensors}}
        values = predict(build_rig(config), wide, replace(record, y=y))
        for j, body in enumerate(inside):
            found[body] = values[:, len(block.channels) + j]
    for name, sensor in rig.sensors.items():
        if sensor.quantity == "velocity" and name in record.y and sensor.of in found:
            found[sensor.of] = np.cumsum(record.y[name]) * record.sample_time_s
    for name, sensor in rig.sensors.items():
        if sensor.quantity == "position" and name in record.y:
            found[sensor.of] = record.y[name]
    return found
