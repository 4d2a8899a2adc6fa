"""What could be missing: every effect that a rig's elements take, and where its secondary parameters may lie."""

from dataclasses import dataclass, field, replace

import numpy as np

from dtbacklash.diagnose.compare import Block, Record, places_of, predict
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import Effect, effects_of
from dtbacklash.physics.elements import BODY_KINDS, LINK_KINDS, SLIDING_KINDS
from dtbacklash.physics.plant import Floats
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, build_rig

Values = dict[str, float]

#: a delay's fit has a valley for every turn of the signal: it starts from each of these
DELAYS_S = (0.7e-3, 2e-3, 5e-3, 12e-3)


@dataclass(frozen=True)
class Candidate:
    """One effect at one place, with the grid of values from which its signatures are made."""

    place: str
    effect: Effect
    grid: list[Values] = field(default_factory=list)

    @property
    def key(self) -> tuple[str, str]:
        """(place, effect's name)."""
        return self.place, self.effect.name


@dataclass(frozen=True)
class Motion:
    """How the rig moves in the recording: from which secondary parameters take their grids.

    ``command`` (N,) V. ``speed`` : of each body, its largest but for the last 2 %. ``stretch`` (N,) and ``rate`` : of
    each link. ``force`` : what drives each body, N, as large as it usually is.
    """

    command: Floats
    speed: dict[str, float]
    stretch: dict[str, Floats]
    rate: dict[str, float]
    force: dict[str, float]


def candidates(rig: Rig, blocks: list[Block], motion: Motion) -> list[Candidate]:
    """All effects that the rig does not have yet and that the blocks can show."""
    places = set().union(*(places_of(rig, b) for b in blocks))
    channels = {SENSOR_PREFIX + c for b in blocks for c in b.channels}
    found = []
    for place in [*rig.elements, *sorted(p for p in places if p.startswith(SENSOR_PREFIX))]:
        if place.startswith(SENSOR_PREFIX) and place not in channels | places:
            continue
        for effect in effects_of(rig.kind_at(place)).values():
            if rig.effect(place, effect.name) is None and _possible(rig, place, effect):
                found.append(Candidate(place, effect, _grid(rig, place, effect, motion)))
    return found


def _possible(rig: Rig, place: str, effect: Effect) -> bool:
    """Whether the rig's build takes the effect at all, and it can be seen from where the rig begins."""
    base = (screw := rig.only("screw")) and screw.neighbours.get("carries")
    if place == base and not (screw and rig.effect(screw.name, "compliance")):
        return False  # a mass on a rigid screw moves as the screw does, whatever acts on it
    try:
        rig.with_effect(place, effect.name, {effect.size.name: effect.size.typical})
    except UserError:
        return False
    return True


def _grid(rig: Rig, place: str, effect: Effect, motion: Motion) -> list[Values]:
    """Starting values; the size stands at its typical value and is scaled to the residual later."""
    base = {p.name: p.typical for p in effect.parameters}
    if (size := _size(rig, place, effect, motion)) > 0.0:
        base[effect.size.name] = float(np.clip(size, effect.size.low, effect.size.high))
    speed, stretch = motion.speed.get(place, 0.0), motion.stretch.get(place)
    if effect.name == "saturation":
        size = np.abs(motion.command[motion.command != 0.0])
        limits = [0.97 * size.max(), *np.quantile(size, (0.5, 0.8, 0.95, 0.99))] if len(size) else []
        return [{"limit": float(v)} for v in limits]
    if effect.name == "stribeck_friction" and speed > 0.0:
        return [{**base, "speed": share * speed} for share in (0.02, 0.1, 0.4)]
    if effect.name == "hysteresis" and stretch is not None:
        most = float(np.quantile(np.abs(stretch), 0.95))
        return [{**base, "displacement": share * most} for share in (0.03, 0.15, 0.6)]
    if effect.name == "bumper" and stretch is not None:
        levels = np.quantile(stretch, (0.03, 0.2, 0.5, 0.8, 0.93, 0.98, 0.995))
        return [{**base, "clearance": float(v)} for v in levels]
    if effect.name == "delay":
        return [{effect.size.name: time} for time in DELAYS_S]
    if effect.name == "absorber":
        return [{**base, "frequency": float(f)} for f in np.geomspace(1.5, 60.0, 25)]
    if effect.name == "resistance_heating":
        return [{**base, "time_constant": tau} for tau in (1.0, 5.0, 25.0)]
    return [base]


def _size(rig: Rig, place: str, effect: Effect, motion: Motion) -> float:
    """A size at which the effect would be a few percent of what moves this rig in this recording; 0 if unknown.

    The catalogue's typical sizes belong to the paper's rig; another rig can be a million times lighter.
    """
    element = rig.elements.get(place)
    if element is None:
        return 0.0
    values = element.values
    if effect.kind in LINK_KINDS:
        s = float(np.quantile(np.abs(motion.stretch[place]), 0.95)) if place in motion.stretch else 0.0
        k, rate = values["stiffness"], motion.rate.get(place, 0.0)
        if s <= 0.0 or rate <= 0.0 or k <= 0.0:
            return 0.0
        sizes = {
            "cubic_stiffness": 0.1 * k / s**2, "quadratic_damping": 0.1 * values.get("damping", k * s / rate) / rate,
            "dry_friction": 0.02 * k * s, "hysteresis": 0.1 * k * s, "bumper": k,
            "backlash": 0.2 * s,
        }  # fmt: skip
        return sizes.get(effect.name, 0.0)
    if effect.name == "absorber":
        return 0.05 * values["mass"]
    force = motion.force.get(place, 0.0)
    if effect.kind in SLIDING_KINDS and force > 0.0:
        speed = motion.speed.get(place, 0.0)
        unit = effect.size.unit
        if unit == "N":
            return 0.05 * force
        return 0.05 * force / speed if speed > 0.0 and unit == "N s/m" else 0.0
    return 0.0


def motion_of(rig: Rig, blocks: list[Block], records: list[Record]) -> Motion:
    """How bodies and links move: as measured, and as simulated where that is not measured."""
    where = positions(rig, blocks, records[0])
    step = records[0].sample_time_s
    speed: dict[str, float] = {}
    stretch: dict[str, Floats] = {}
    rate: dict[str, float] = {}
    force: dict[str, float] = {}
    for name, q in where.items():
        smooth = np.convolve(q, np.ones(9) / 9, "same")[8:-8]
        speed[name] = float(np.quantile(np.abs(np.diff(smooth)) / step, 0.98)) if len(smooth) > 2 else 0.0
    for link in rig.links():
        a, b = (where.get(e, np.zeros(records[0].samples)) for e in link.neighbours["between"])
        stretch[link.name] = b - a
        rate[link.name] = float(np.quantile(np.abs(np.diff(b - a)) / step, 0.9))
        pull = link.values["stiffness"] * float(np.quantile(np.abs(b - a), 0.9))
        for end in link.neighbours["between"]:
            force[end] = max(force.get(end, 0.0), pull)
    command = np.concatenate([r.u for r in records])
    if actuator := rig.only("actuator"):
        driven = actuator.neighbours["drives"]
        force[driven] = max(force.get(driven, 0.0), actuator.values["gain"] * float(np.std(command)))
    return Motion(command, speed, stretch, rate, force)


def positions(rig: Rig, blocks: list[Block], record: Record) -> dict[str, Floats]:
    """(N,) position of every body, SI: as the blocks simulate them, measured where they are."""
    found: dict[str, Floats] = {}
    bodies = [e.name for e in rig.elements.values() if e.kind in BODY_KINDS]
    for block in blocks:
        inside = [b for b in bodies if b in places_of(rig, block)]
        sensors = {f"_{b}": {"of": b, "quantity": "position"} for b in inside}
        config = replace(rig.config, sensors={**rig.config.sensors, **sensors})
        wide = replace(block, channels=(*block.channels, *sensors))
        y = {**record.y, **{s: np.zeros(record.samples) for s in sensors}}
        values = predict(build_rig(config), wide, replace(record, y=y))
        for j, body in enumerate(inside):
            found[body] = values[:, len(block.channels) + j]
    for name, sensor in rig.sensors.items():
        if sensor.quantity == "position" and name in record.y:
            found[sensor.of] = record.y[name]
    return found
