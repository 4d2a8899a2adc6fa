"""Compare: cut the rig at its measured signals and drive each part with the measurement at its border.

A motor or a carriage integrates: left alone it drifts away from its recording, and every law is then evaluated along
a motion that never was. So the simulation of such a block is pulled towards the measurement by a fixed, slow gain
(an observer), the same for every model that is compared. What is judged is the innovation: the open-loop error behind
a fixed high-pass of that bandwidth. No model can hand the measurement back, as the gain is not the model's.
"""

from dataclasses import dataclass, replace

import numba
import numpy as np

from dtbacklash.errors import UserError
from dtbacklash.physics import plant as pl
from dtbacklash.physics.assembly import compile_plant, state_names
from dtbacklash.physics.plant import Floats, Plant, State, new_state
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, build_rig
from dtbacklash.physics.sample import advance, sense
from dtbacklash.physics.simulate import rig_half_gap

#: bandwidth of the pull towards the measurement, rad/s: slow against the laws that are looked for, fast against drift
PULL_RAD_S = 15.0
#: the same where the command is integrated twice: an offset of the force shows at low frequencies only
PULL_TWICE_RAD_S = 15.0
#: a pole of the nominal block slower than this integrates, rad/s
INTEGRATES_RAD_S = 0.5
#: a contact is located to sample_time/substeps/2**EVENT_LEVELS
EVENT_LEVELS = 10
#: where a rough answer will do: substeps and levels
ROUGH = (2, 4)

MOTOR_KINDS = ("amplifier", "motor_circuit", "actuator", "rotor")


@dataclass(frozen=True)
class Record:
    """One recording on its grid: (N,) command V, (N,) measured channels in SI, which samples train and which judge."""

    sample_time_s: float
    u: Floats
    y: dict[str, Floats]
    train: np.ndarray
    held: np.ndarray

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.u)


@dataclass(frozen=True)
class Block:
    """A part of the rig between two measured signals.

    Attributes
    ----------
    name : ``motor``, ``structure`` or ``rig``. channels : the sensors that it is judged by.
    imposed : the sensor that drives it instead of the command, or None.
    pulled : the sensor towards which it is pulled, or None. gains : per sample, on its position and velocity.
    """

    name: str
    channels: tuple[str, ...]
    imposed: str | None = None
    pulled: str | None = None
    gains: tuple[float, float] = (0.0, 0.0)


def cut(rig: Rig, channels: tuple[str, ...], sample_time_s: float) -> list[Block]:
    """The blocks of a rig for the channels that were recorded.

    Raises
    ------
    UserError : none of the rig's sensors was recorded.
    """
    known = tuple(name for name in rig.sensors if name in channels)
    if not known:
        raise UserError("recording", ", ".join(channels), f"needs a channel of {', '.join(rig.sensors)}")
    angle = _angle_sensor(rig, known)
    motor_side = [n for n in known if rig.elements[rig.sensors[n].of].kind in MOTOR_KINDS]
    beyond = tuple(n for n in known if n not in motor_side)
    if angle and rig.only("screw"):
        blocks = [_pulled(Block("motor", tuple(motor_side)), rig, sample_time_s)]
        return blocks + ([Block("structure", beyond, imposed=angle)] if beyond else [])
    return [_pulled(Block("rig", known), rig, sample_time_s)]


def _angle_sensor(rig: Rig, known: tuple[str, ...]) -> str | None:
    for name in known:
        sensor = rig.sensors[name]
        if sensor.quantity == "position" and rig.elements[sensor.of].kind == "rotor":
            return name
    return None


def _pulled(block: Block, rig: Rig, sample_time_s: float) -> Block:
    """Choose the gains: one on the position per integrator, both for two (a critically damped observer)."""
    plant = compile_plant(part_of(rig, block), sample_time_s)
    poles = np.linalg.eigvals(plant.A[0 if plant.rotor < 0 else 1])
    integrators = int(np.sum(np.abs(poles) < INTEGRATES_RAD_S))
    if integrators == 0:
        return block
    names = [n for n in block.channels if rig.sensors[n].quantity == "position"]
    if not names:
        raise UserError("recording", ", ".join(block.channels), "needs a measured position where the rig integrates")
    b = PULL_RAD_S
    if integrators == 1:
        gains = (b * sample_time_s, 0.0)
    else:
        b = PULL_TWICE_RAD_S
        gains = (2 * b * sample_time_s, b**2 * sample_time_s)
    return replace(block, pulled=names[0], gains=gains)


def slowest_decay(rig: Rig, block: Block, sample_time_s: float) -> float:
    """Decay rate of the block's slowest pole that does not integrate, or of its pull, 1/s."""
    plant = compile_plant(part_of(rig, block), sample_time_s, imposed=block.imposed is not None)
    rates = -np.linalg.eigvals(plant.A[0 if plant.rotor < 0 else 1]).real
    decays = [float(r) for r in rates if r > INTEGRATES_RAD_S]
    if block.pulled:
        decays.append(block.gains[0] / sample_time_s / (2.0 if block.gains[1] else 1.0))
    return min(decays, default=1.0)


def part_of(rig: Rig, block: Block) -> Rig:
    """The rig that a block simulates: the motor alone, unless the structure pushes back on it."""
    if block.name != "motor" or reacts(rig):
        return rig
    return _motor_only(rig)


def reacts(rig: Rig) -> bool:
    """Whether the structure pushes back on the motor, so that the motor's block has to hold all of the rig."""
    screw = rig.only("screw")
    return bool(screw and rig.effect(screw.name, "load_reaction"))


def _motor_only(rig: Rig) -> Rig:
    config = rig.config
    elements = {n: s for n, s in config.elements.items() if s["kind"] in MOTOR_KINDS}
    sensors = {n: s for n, s in config.sensors.items() if s["of"] in elements}
    places = {*elements, *(SENSOR_PREFIX + n for n in sensors)}
    effects = {p: e for p, e in config.effects.items() if p in places}
    return build_rig(replace(config, elements=elements, sensors=sensors, effects=effects))


def places_of(rig: Rig, block: Block) -> set[str]:
    """The elements and sensors whose effects and parameters can change what the block predicts."""
    if block.name == "rig" or (block.name == "motor" and reacts(rig)):
        names = set(rig.elements)
    else:
        inside = block.name == "motor"
        names = {e.name for e in rig.elements.values() if (e.kind in MOTOR_KINDS) == inside}
    places = names | {SENSOR_PREFIX + c for c in block.channels}
    return places | {SENSOR_PREFIX + block.imposed} if block.imposed else places


def true_angle(rig: Rig, block: Block, record: Record) -> Floats:
    """(N,) the motor's angle behind its sensor's modelled errors, rad."""
    assert block.imposed is not None
    seen = record.y[block.imposed]
    there = rig.effects.get(SENSOR_PREFIX + block.imposed, {})
    angle = (seen - there.get("offset", {}).get("offset", 0.0)) / (
        1.0 + there.get("gain_error", {}).get("relative", 0.0)
    )
    late = there.get("delay", {}).get("time", 0.0) / record.sample_time_s
    if late > 0.0:
        at = np.arange(record.samples) + late
        angle = np.interp(at, np.arange(record.samples), angle)
    # the plant takes the angle as linear between samples, which shrinks a sine of omega by (omega h)^2/12: undone here
    angle[1:-1] -= np.diff(angle, 2) / 12.0
    return np.ascontiguousarray(angle)


@numba.njit(cache=True, error_model="numpy", _nrt=False, nogil=True)
def _track(P, S, u, gap, theta, target, pulled, where, gains, y):  # type: ignore[no-untyped-def]
    """Simulate all samples into ``y`` (N, sensors), each before it pulls the state towards ``target``."""
    n = u.shape[0]
    for k in range(n):
        sense(P, S, gap, 0.0, y[k])
        if pulled >= 0:
            e = target[k] - y[k, pulled]
            S.x[where] += gains[0] * e
            S.x[where + P.n_bodies] += gains[1] * e
        if k + 1 < n:
            advance(P, S, k * P.sample_time, u[k], gap, gap, theta[k], theta[k + 1])


def predict(rig: Rig, block: Block, record: Record, rough: bool = False) -> Floats:
    """(N, channels) what the block's channels would show, SI, each sample before the measurement pulls it."""
    part = part_of(rig, block)
    plant = compile_plant(part, record.sample_time_s, 0, EVENT_LEVELS, block.imposed is not None)
    if rough and plant.forced and plant.delay_whole + plant.delay_ticks == 0:
        plant = compile_plant(part, record.sample_time_s, *ROUGH, block.imposed is not None)
    names = list(part.sensors)
    column = names.index(block.pulled) if block.pulled else -1
    target = record.y[block.pulled] if block.pulled else np.zeros(1)
    theta = true_angle(rig, block, record) if block.imposed else np.zeros(record.samples)
    state = _start(part, plant, block, record, theta[0])
    where = int(plant.sensor[column, pl.Y_INDEX]) if block.pulled else 0
    y = np.zeros((record.samples, len(names)))
    for _ in range(state.seen.shape[0]):
        sense(plant, state, rig_half_gap(rig), 0.0, y[0])
    _track(plant, state, record.u, rig_half_gap(rig), theta, target, column, where, np.array(block.gains), y)
    return y[:, [names.index(c) for c in block.channels]]


def _start(part: Rig, plant: Plant, block: Block, record: Record, angle: float) -> State:
    """The block at rest where the recording begins."""
    state = new_state(plant)
    bodies = state_names(part, block.imposed is not None)
    lead = plant.screw[pl.S_LEAD]
    if not block.imposed and block.pulled and plant.rotor >= 0:
        angle = record.y[block.pulled][0]
    if plant.has_base:
        state.gear[0] = angle
        for j in range(plant.n_bodies):
            state.x[plant.position + j] = angle if j == plant.rotor else lead * angle
    for name in block.channels:
        sensor = part.sensors[name]
        if sensor.quantity == "position" and sensor.of in bodies and not plant.has_base:
            state.x[plant.position + bodies.index(sensor.of)] = record.y[name][0]
    return state


def residual(rig: Rig, block: Block, record: Record, rough: bool = False) -> Floats:
    """(N, channels) measured minus predicted, SI."""
    measured = np.column_stack([record.y[c] for c in block.channels])
    return measured - predict(rig, block, record, rough)
