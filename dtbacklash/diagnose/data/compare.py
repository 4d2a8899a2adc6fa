"""Compare: cut the rig at its measured signals and drive each part with the measurement at its border.

A motor or a carriage integrates: left alone it drifts away from its recording, and every law is then evaluated along
a motion that never was. So the simulation of such a block is pulled towards the measurement by a fixed, slow gain
(an observer), the same for every model that is compared. What is judged is the innovation: the open-loop error behind
a fixed high-pass of that bandwidth. No model can hand the measurement back, as the gain is not the model's.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.first_state import Beginning, Launch
from dtbacklash.diagnose.data.track import track
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.assembly import SUBSTEPS_FORCED, compile_plant, state_names
from dtbacklash.physics.bodies import hidden_bodies
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Role
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant, State, new_state, place_at
from dtbacklash.physics.kernel.sample import sense
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, build_rig
from dtbacklash.physics.simulate import rig_half_gap

#: a contact is located to sample_time/substeps/2**EVENT_LEVELS
EVENT_LEVELS = 10
#: where a rough answer will do: substeps and levels
ROUGH = (2, 4)
#: where only differences of simulations count: a part of the substeps, and contacts still found finely
COARSER, COARSE_LEVELS = 4, 8

#: what does not decay at all is looked at for as long as if it did so at this share of the tempo
FREE_DECAY = 0.1
#: a substep turns what is periodic in a position by this angle at most, rad
PHASE_MAX = 0.1
#: what the plant takes by itself where it has to step, and the most that are worth it
SUBSTEPS_PLAIN, SUBSTEPS_MAX = 8, 64
#: as many follow the current of a winding, whose time constant is a tenth of a sample
SUBSTEPS_CURRENT = 16


Mask = np.ndarray
#: how finely a plant that is not linear is simulated
Steps = Literal["fine", "coarse", "rough"]


@dataclass(frozen=True)
class Record:
    """One recording, or one stretch of it, on its grid.

    u : (N,) command, V. y : (N,) measured channels, SI. train, held, judge : (N,) which samples are fitted to, which
    are held out to choose by, and which judge, having chosen nothing; none do unless :mod:`.parts` takes them from what
    is held out. from_s : time of its first sample since the recording began, s. begins : where it begins in motion,
    else None. stands : channel -> where it stands at its first sample if it begins at rest, SI; else that sample.
    """

    sample_time_s: float
    u: Floats
    y: dict[str, Floats]
    train: Mask
    held: Mask
    from_s: float = 0.0
    begins: Beginning | None = None
    judge: Mask = field(default_factory=lambda: np.zeros(0, dtype=bool))
    stands: dict[str, float] = field(default_factory=dict)

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
    tempo : how fast it moves, rad per sample.
    imposed : the sensor that drives it instead of the command, or None.
    pulled : the sensor towards which it is pulled, or None. gains : per sample, on its position and velocity.
    """

    name: str
    channels: tuple[str, ...]
    tempo: float
    imposed: str | None = None
    pulled: str | None = None
    gains: tuple[float, float] = (0.0, 0.0)

    @property
    def pull(self) -> float:
        """Bandwidth of the pull, rad per sample; 0 without one."""
        return self.gains[0] / (2.0 if self.gains[1] else 1.0)


def poles_of(plant: Plant) -> np.ndarray:
    """Poles of a block's linear part, in contact where it has a gear; complex, 1/s."""
    return np.linalg.eigvals(plant.A[0 if plant.rotor < 0 else 1])


def slowest_decay(plant: Plant, block: Block) -> float:
    """Decay rate of the block's slowest pole that does not integrate, or of its pull, 1/s."""
    tempo = block.tempo / plant.sample_time
    least = settings().integrator_ratio * tempo
    decays = [max(-float(p.real), least) for p in poles_of(plant) if abs(p) > least]
    if block.pull > 0.0:
        decays.append(block.pull / plant.sample_time)
    return min(decays, default=FREE_DECAY * tempo)


def part_of(rig: Rig, block: Block) -> Rig:
    """The rig that a block simulates: the motor alone, unless the structure pushes back on it."""
    if block.name != "motor" or reacts(rig):
        return rig
    return _motor_only(rig)


def reacts(rig: Rig) -> bool:
    """Whether the structure pushes back on the motor, so that the motor's block has to hold all of the rig."""
    screw = rig.only("screw")
    return bool(screw and rig.amount(screw.name, slots.Reaction, "share"))


def _motor_only(rig: Rig) -> Rig:
    config = rig.config
    elements = {n: s for n, s in config.elements.items() if rig.elements[n].trait.motor_side}
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
        names = {e.name for e in rig.elements.values() if e.trait.motor_side == inside}
    places = names | {SENSOR_PREFIX + c for c in block.channels}
    return places | {SENSOR_PREFIX + block.imposed} if block.imposed else places


def true_angle(rig: Rig, block: Block, record: Record) -> Floats:
    """(N,) the motor's angle behind its sensor's modelled errors, rad; a copy."""
    assert block.imposed is not None
    angle = _behind(rig, block.imposed, record)
    late = rig.amount(SENSOR_PREFIX + block.imposed, slots.Late, "time") / record.sample_time_s
    if late > 0.0:
        at = np.arange(record.samples) + late
        angle = np.interp(at, np.arange(record.samples), angle)
    return np.ascontiguousarray(angle)


def _behind(rig: Rig, channel: str, record: Record) -> Floats:
    """(N,) what a sensor looks at, behind its modelled errors."""
    return _unread(rig, channel, record.y[channel].copy())


def _stands(rig: Rig, channel: str, record: Record) -> float:
    """Where it stands at the first sample, behind its sensor's modelled errors."""
    return float(_unread(rig, channel, np.array([record.stands.get(channel, record.y[channel][0])]))[0])


def _unread(rig: Rig, channel: str, seen: Floats) -> Floats:
    for effect, values in sorted(
        rig.active(SENSOR_PREFIX + channel, slots.Reading), key=lambda pair: -getattr(pair[0].slot, "stage", 0)
    ):
        assert isinstance(effect.slot, slots.Reading)
        seen = effect.slot.inverse(seen, *values.values())
    return seen


def _drive(rig: Rig, block: Block, record: Record, plant: Plant) -> Floats:
    """(N,) what is imposed on the block: the motor's angle, rad, or the command of a positioner, V."""
    if not plant.imposed:
        return record.u
    angle = true_angle(rig, block, record) if block.imposed else record.u.copy()
    # what is imposed is linear in a step, which shrinks a sine of omega by (omega h)^2/12: undone here
    angle[1:-1] -= np.diff(angle, 2) / (12.0 * plant.substeps**2)
    return angle


def predict(rig: Rig, block: Block, record: Record, steps: Steps = "fine") -> Floats:
    """(N, channels) what the block's channels would show, SI, each sample before the measurement pulls it."""
    part = part_of(rig, block)
    substeps = _substeps(part, block, record)
    coarse = max(ROUGH[0], (substeps or SUBSTEPS_FORCED) // COARSER), COARSE_LEVELS
    fewer = {"fine": None, "coarse": coarse, "rough": ROUGH}[steps]
    plant = compile_plant(part, record.sample_time_s, substeps, EVENT_LEVELS, block.imposed is not None, fewer)
    theta = _drive(rig, block, record, plant)
    run = _runner(part, plant, block, record, theta)
    if record.begins is None:
        state = _start(part, plant, block, record, theta[0])
    else:
        state = _launch(part, plant, block, record, theta, record.begins).fitted(run)
    return run(state, record.samples)


def _runner(part: Rig, plant: Plant, block: Block, record: Record, theta: Floats) -> Callable[[State, int], Floats]:
    """A function that simulates so many samples from a state: (n, channels) of the block."""
    names = list(part.sensors)
    column = names.index(block.pulled) if block.pulled else -1
    target = record.y[block.pulled] if block.pulled else np.zeros(1)
    where = int(plant.sensor[column, pl.Y_INDEX]) if block.pulled else 0
    gap, gains = rig_half_gap(part), _gains_behind(part, block, record)
    chosen = [names.index(c) for c in block.channels]

    def run(state: State, samples: int) -> Floats:
        y = np.zeros((samples, len(names)))
        for _ in range(state.seen.shape[0]):
            sense(plant, state, gap, 0.0, y[0])
        track(plant, state, record.u[:samples], gap, theta, target, column, where, gains, y, record.from_s)
        return y[:, chosen]

    return run


def _gains_behind(part: Rig, block: Block, record: Record) -> Floats:
    """The block's gains behind the modelled error of the sensor that pulls.

    The pull acts on a state, but compares readings: a sensor that is modelled to read ten times too much would pull ten
    times as fast, and hand the measurement back.
    """
    gains = np.array(block.gains)
    if block.pulled and part.active(SENSOR_PREFIX + block.pulled, slots.Reading):
        seen = float(np.ptp(record.y[block.pulled]))
        gains *= float(np.ptp(_behind(part, block.pulled, record))) / seen if seen > 0.0 else 1.0
    return gains


def _substeps(part: Rig, block: Block, record: Record) -> int:
    """Enough of them for what is periodic in the position; 0 leaves the choice to the plant."""
    acting = [(e, values) for place in part.effects for e, values in part.active(place, slots.Slot)]
    waves = [values[p.name] for e, values in acting for p in e.parameters if p.role is Role.WAVE]
    sensor = block.imposed or block.pulled
    if not waves or sensor is None:
        return 0
    phase = max(waves) * _travel(record.y[sensor])
    # a power of two that is not below what is needed, nor far above the most that are worth it
    wanted = int(2 ** int(np.ceil(np.log2(np.clip(phase / PHASE_MAX, 1.0, 2.0 * SUBSTEPS_MAX)))))
    if any(isinstance(e.slot, slots.MotorTorque) for e, _ in acting):
        wanted = max(wanted, SUBSTEPS_CURRENT)  # it multiplies a current that jumps within a fraction of a sample
    return min(wanted, SUBSTEPS_MAX) if wanted > SUBSTEPS_PLAIN else 0


def _travel(seen: Floats) -> float:
    """How far a position moves within a sample, nearly at most."""
    return float(np.quantile(np.abs(np.diff(seen)), 0.99))


def _start(part: Rig, plant: Plant, block: Block, record: Record, angle: float) -> State:
    """The block at rest where the recording begins; in motion: :class:`.launch.Launch`."""
    state = new_state(plant)
    bodies = state_names(part, block.imposed is not None)
    shown = part.sensors[block.pulled].quantity == "position" if block.pulled else False
    if not block.imposed and block.pulled and shown and plant.rotor >= 0:
        angle = _stands(part, block.pulled, record)
    if plant.has_base:
        place_at(plant, state, angle)
    else:
        seen = {
            bodies.index(part.sensors[c].of): _stands(part, c, record) for c in block.channels
            if part.sensors[c].quantity == "position" and part.sensors[c].of in bodies
        }  # fmt: skip
        state.x[plant.position : plant.position + plant.n_bodies] = _at_rest(plant, seen)
    return state


def _at_rest(plant: Plant, seen: dict[int, float]) -> Floats:
    """(bodies,) where all of them stand at rest, some of which are seen: the others where no spring pulls them away."""
    places = np.zeros(plant.n_bodies)
    places[list(seen)] = list(seen.values())
    others = [j for j in range(plant.n_bodies) if j not in seen]
    if seen and others:
        q, v = plant.position, plant.position + plant.n_bodies
        # what a unit of each position accelerates
        pull = plant.A[0 if plant.rotor < 0 else 1, v : v + plant.n_bodies, q : q + plant.n_bodies][others]
        places[others] = np.linalg.lstsq(pull[:, others], -pull @ places, rcond=None)[0]
    return places


def _launch(part: Rig, plant: Plant, block: Block, record: Record, theta: Floats, begins: Beginning) -> Launch:
    """What is known of a block where the recording begins in motion, over the beginning that fits its first state."""
    rules = settings()
    moving = rules.beginning_decays / slowest_decay(plant, block)
    if block.pulled and block.gains[0] == 0.0:
        moving = max(moving, rules.beginning_integrating_ratio / block.tempo * record.sample_time_s)
    n = min(record.samples, max(rules.beginning_samples_min, round(moving / record.sample_time_s)))
    names = state_names(part, block.imposed is not None)
    owners = {b: b for b in part.elements} | {b: host[0] for b, host in hidden_bodies(part).items()}
    columns = [j for j, c in enumerate(block.channels) if c in begins.noise]
    channels = [block.channels[j] for j in columns]
    seen = {
        quantity: {
            c: (part.sensors[c].of, _behind(part, c, record)[:n])
            for c in channels if part.sensors[c].quantity == quantity and part.sensors[c].of in names
        }
        for quantity in ("position", "velocity")
    }  # fmt: skip
    late = plant.delay_whole + plant.delay_ticks + int(plant.sensor_whole.max(initial=0)) > 0
    return Launch(
        plant, {b: (owners[b], part.elements[owners[b]].trait.axis) for b in names}, rig_half_gap(part),
        theta[:n] if plant.imposed else None, record.u[:n], float(np.std(record.u)),
        seen["position"], seen["velocity"], np.column_stack([record.y[c][:n] for c in channels]), columns,
        np.array([begins.noise[c] for c in channels]), begins, min(rules.delay_reach_samples, n // 2) if late else 0,
    )  # fmt: skip


def residual(rig: Rig, block: Block, record: Record, steps: Steps = "fine") -> Floats:
    """(N, channels) measured minus predicted, SI."""
    measured = np.column_stack([record.y[c] for c in block.channels])
    return measured - predict(rig, block, record, steps)
