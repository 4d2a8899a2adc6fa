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
from dtbacklash.physics.plant import Floats, Plant, State, new_state, place_at
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

#: parameters that count waves over a position; a substep turns them by PHASE_MAX rad at most
WAVES, PHASE_MAX = ("periods", "wave_number"), 0.1
#: what the plant takes by itself where it has to step, and the most that are worth it
SUBSTEPS_PLAIN, SUBSTEPS_MAX = 8, 64
#: as many follow the current of a winding, whose time constant is a tenth of a sample
SUBSTEPS_CURRENT = 16

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
    """(N,) the motor's angle behind its sensor's modelled errors, rad; a copy."""
    assert block.imposed is not None
    angle = _behind(rig, block.imposed, record)
    there = rig.effects.get(SENSOR_PREFIX + block.imposed, {})
    late = there.get("delay", {}).get("time", 0.0) / record.sample_time_s
    if late > 0.0:
        at = np.arange(record.samples) + late
        angle = np.interp(at, np.arange(record.samples), angle)
    return np.ascontiguousarray(angle)


def _behind(rig: Rig, channel: str, record: Record) -> Floats:
    """(N,) what a sensor looks at, behind its modelled offset and gain."""
    there = rig.effects.get(SENSOR_PREFIX + channel, {})
    offset, gain = there.get("offset", {}).get("offset", 0.0), there.get("gain_error", {}).get("relative", 0.0)
    seen: Floats = (record.y[channel] - offset) / (1.0 + gain)
    return seen


def _drive(rig: Rig, block: Block, record: Record, plant: Plant) -> Floats:
    """(N,) what is imposed on the block: the motor's angle, rad, or the command of a positioner, V."""
    if not plant.imposed:
        return record.u
    angle = true_angle(rig, block, record) if block.imposed else record.u.copy()
    # what is imposed is linear in a step, which shrinks a sine of omega by (omega h)^2/12: undone here
    angle[1:-1] -= np.diff(angle, 2) / (12.0 * plant.substeps**2)
    return angle


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
            advance(P, S, k * P.sample_time, u[k], gap, gap, theta, k)


def predict(rig: Rig, block: Block, record: Record, rough: bool = False) -> Floats:
    """(N, channels) what the block's channels would show, SI, each sample before the measurement pulls it."""
    part = part_of(rig, block)
    substeps = _substeps(part, block, record)
    plant = compile_plant(part, record.sample_time_s, substeps, EVENT_LEVELS, block.imposed is not None)
    if rough and plant.forced and plant.delay_whole + plant.delay_ticks == 0:
        plant = compile_plant(part, record.sample_time_s, *ROUGH, block.imposed is not None)
    names = list(part.sensors)
    column = names.index(block.pulled) if block.pulled else -1
    target = record.y[block.pulled] if block.pulled else np.zeros(1)
    theta = _drive(rig, block, record, plant)
    state = _start(part, plant, block, record, theta[0])
    where = int(plant.sensor[column, pl.Y_INDEX]) if block.pulled else 0
    y = np.zeros((record.samples, len(names)))
    for _ in range(state.seen.shape[0]):
        sense(plant, state, rig_half_gap(rig), 0.0, y[0])
    _track(plant, state, record.u, rig_half_gap(rig), theta, target, column, where, np.array(block.gains), y)
    return y[:, [names.index(c) for c in block.channels]]


def _substeps(part: Rig, block: Block, record: Record) -> int:
    """Enough of them for what is periodic in the position; 0 leaves the choice to the plant."""
    waves = [v for there in part.effects.values() for values in there.values() for n, v in values.items() if n in WAVES]
    sensor = block.imposed or block.pulled
    if not waves or sensor is None:
        return 0
    phase = max(waves) * float(np.quantile(np.abs(np.diff(record.y[sensor])), 0.99))
    wanted = 2 ** int(np.ceil(np.log2(max(phase / PHASE_MAX, 1.0))))
    if any("torque_ripple" in there for there in part.effects.values()):
        wanted = max(wanted, SUBSTEPS_CURRENT)  # it multiplies a current that jumps within a fraction of a sample
    return min(wanted, SUBSTEPS_MAX) if wanted > SUBSTEPS_PLAIN else 0


def _start(part: Rig, plant: Plant, block: Block, record: Record, angle: float) -> State:
    """The block at rest where the recording begins."""
    state = new_state(plant)
    bodies = state_names(part, block.imposed is not None)
    if not block.imposed and block.pulled and plant.rotor >= 0:
        angle = _behind(part, block.pulled, record)[0]
    if plant.has_base:
        place_at(plant, state, angle)
    for name in block.channels:
        sensor = part.sensors[name]
        if sensor.quantity == "position" and sensor.of in bodies and not plant.has_base:
            state.x[plant.position + bodies.index(sensor.of)] = _behind(part, name, record)[0]
    return state


def residual(rig: Rig, block: Block, record: Record, rough: bool = False) -> Floats:
    """(N, channels) measured minus predicted, SI."""
    measured = np.column_stack([record.y[c] for c in block.channels])
    return measured - predict(rig, block, record, rough)
