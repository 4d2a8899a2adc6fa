"""Simulate a part of the rig between two measured signals (a block), and compare it with its recording.

A motor or a carriage integrates: without feedback its simulation drifts away from the recording, and every law is
evaluated along a wrong motion. So such a block is pulled towards the measurement by a fixed, slow gain (an observer),
the same for every model that is compared. The residual is the innovation: the open-loop error behind a high-pass of
that bandwidth.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.first_state import Beginning, Launch
from dtbacklash.diagnose.data.track import track
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.assembly import SUBSTEPS_FORCED, compile_plant, state_names
from dtbacklash.physics.bodies import hidden_bodies
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Role
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant, State, new_state, place_at
from dtbacklash.physics.kernel.sample import sense
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig, build_rig
from dtbacklash.physics.simulate import rig_half_gap

#: the first state is fitted until what it adds has died out to a twentieth (slowest decays)
BEGINNING_DECAYS = 3.0
#: and as long where an integrator runs freely: its first speed counts to the end (1/tempo)
BEGINNING_INTEGRATING_RATIO = 25.0

#: a contact is located to sample_time/substeps/2**EVENT_LEVELS
EVENT_LEVELS = 10
#: substeps and event levels of a rough simulation
ROUGH = (2, 4)
#: divisor of the substeps, and event levels, of a coarse one, which is used for differences of simulations
COARSER, COARSE_LEVELS = 4, 8
#: decay rate of a block without decay, as a share of its tempo
FREE_DECAY = 0.1
#: a substep advances the phase of a periodic law by this angle at most, rad
PHASE_MAX = 0.1
#: the plant's own number of substeps, and the largest one
SUBSTEPS_PLAIN, SUBSTEPS_MAX = 8, 64
#: the current of a winding has a time constant of a tenth of a sample and needs at least so many
SUBSTEPS_CURRENT = 16

Mask = np.ndarray
#: how finely a plant that is not linear is simulated
Steps = Literal["fine", "coarse", "rough"]


@dataclass(frozen=True)
class Record:
    """One recording, or one stretch of it, on its grid.

    u : (N,) command, V. y : channel -> (N,) measured, SI. train, held, judge : (N,) masks of the samples that are
    fitted to, that are held out to choose between models, and that only judge the last model. from_s : time of its
    first sample since the recording began, s. begins : None where it begins at rest. stands : position channel ->
    position at the first sample, SI, where the noise is averaged out. recording : the number of the recording that it
    is or belongs to, from 0. own_zero : whether the positions of that recording are counted from zeros of its own
    (:mod:`.zeros`); zero : position channel -> what was taken off for that, SI.
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
    recording: int = 0
    own_zero: bool = False
    zero: dict[str, float] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.u)

    @property
    def used(self) -> Mask:
        """(N,) mask of the samples that are fitted to or held out."""
        used: Mask = self.train | self.held
        return used


def longest_step_s(records: list[Record]) -> float:
    """The longest sample time of the records, s, to which what a block has per sample refers."""
    return max(r.sample_time_s for r in records)


def usual_step_s(records: list[Record]) -> float:
    """The sample time at which most is fitted to, s: what needs one rate takes the records that have it."""
    counts: dict[float, int] = {}
    for r in records:
        counts[r.sample_time_s] = counts.get(r.sample_time_s, 0) + int(r.train.sum())
    return max(counts, key=lambda step: counts[step])


@dataclass(frozen=True)
class Block:
    """A part of the rig between two measured signals.

    Attributes
    ----------
    name : ``motor``, ``structure`` or ``rig``. channels : the sensors whose residuals it has.
    tempo : how fast it moves, rad per sample. imposed : the sensor that drives it instead of the command.
    pulled : the sensor towards which it is pulled. gains : per sample, on its position and velocity.
    step_s : the sample that tempo and gains are per, s; 0: that of whatever is simulated.
    zeros : position channels whose zero is free in each recording that has its own (:mod:`.zeros`).
    """

    name: str
    channels: tuple[str, ...]
    tempo: float
    imposed: str | None = None
    pulled: str | None = None
    gains: tuple[float, float] = (0.0, 0.0)
    step_s: float = 0.0
    zeros: tuple[str, ...] = ()

    def at(self, sample_time_s: float) -> "Block":
        """The same per sample of another length: as fast, and pulled as fast, in seconds."""
        if self.step_s in (0.0, sample_time_s):
            return self
        ratio = sample_time_s / self.step_s
        gains = ratio * self.gains[0], ratio * self.gains[1]
        return replace(self, tempo=ratio * self.tempo, gains=gains, step_s=sample_time_s)

    @property
    def pull(self) -> float:
        """Bandwidth of the pull, rad per sample; 0 without one."""
        return self.gains[0] / (2.0 if self.gains[1] else 1.0)


def poles_of(plant: Plant) -> np.ndarray:
    """(states,) complex poles of a block's linear part, with the gear in contact, 1/s."""
    return np.linalg.eigvals(plant.A[0 if plant.rotor < 0 else 1])


def slowest_decay(plant: Plant, block: Block) -> float:
    """Decay rate of the block's slowest pole that does not integrate, or of its pull, 1/s."""
    tempo = block.tempo / plant.sample_time
    least = SETTINGS.integrator_ratio * tempo
    decays = [max(-float(p.real), least) for p in poles_of(plant) if abs(p) > least]
    if block.pull > 0.0:
        decays.append(block.pull / plant.sample_time)
    return min(decays, default=FREE_DECAY * tempo)


def part_of(rig: Rig, block: Block) -> Rig:
    """The rig that a block simulates: the motor alone, unless the structure pushes back on it."""
    if block.name != "motor" or reacts(rig):
        return rig
    config = rig.config
    elements = {n: s for n, s in config.elements.items() if rig.elements[n].trait.motor_side}
    sensors = {n: s for n, s in config.sensors.items() if s["of"] in elements}
    places = {*elements, *(SENSOR_PREFIX + n for n in sensors)}
    effects = {p: e for p, e in config.effects.items() if p in places}
    return build_rig(replace(config, elements=elements, sensors=sensors, effects=effects))


def reacts(rig: Rig) -> bool:
    """Whether the structure acts back on the motor, so that the motor's block contains the whole rig."""
    screw = rig.only("screw")
    return bool(screw and (rig.active(screw.name, slots.Reaction) or rig.active(screw.name, slots.Passing)))


def places_of(rig: Rig, block: Block) -> set[str]:
    """The elements and sensors whose effects and parameters can change the block's prediction."""
    if block.name == "rig" or (block.name == "motor" and reacts(rig)):
        names = set(rig.elements)
    else:
        inside = block.name == "motor"
        names = {e.name for e in rig.elements.values() if e.trait.motor_side == inside}
    places = names | {SENSOR_PREFIX + c for c in block.channels}
    return places | {SENSOR_PREFIX + block.imposed} if block.imposed else places


def true_angle(rig: Rig, block: Block, record: Record) -> Floats:
    """(N,) the motor's angle without its sensor's modelled errors, rad; a copy."""
    assert block.imposed is not None
    angle = _without_errors(rig, block.imposed, record.y[block.imposed].copy())
    late = rig.amount(SENSOR_PREFIX + block.imposed, slots.Late, "time") / record.sample_time_s
    if late > 0.0:
        at = np.arange(record.samples) + late
        angle = np.interp(at, np.arange(record.samples), angle)
    return np.ascontiguousarray(angle)


def _stands(rig: Rig, channel: str, record: Record) -> float:
    """Position at the first sample, without the sensor's modelled errors."""
    return float(_without_errors(rig, channel, np.array([record.stands.get(channel, record.y[channel][0])]))[0])


def _without_errors(rig: Rig, channel: str, seen: Floats) -> Floats:
    """(n,) what a sensor measures, from its readings ``seen`` with modelled errors."""
    for effect, values in sorted(
        rig.active(SENSOR_PREFIX + channel, slots.Reading), key=lambda pair: -getattr(pair[0].slot, "stage", 0)
    ):
        assert isinstance(effect.slot, slots.Reading)
        seen = effect.slot.inverse(seen, *values.values())
    return seen


def _drive(rig: Rig, block: Block, record: Record, plant: Plant) -> Floats:
    """(N,) what drives the block: the motor's angle, rad, or the command, V."""
    if not plant.imposed:
        return record.u
    angle = true_angle(rig, block, record) if block.imposed else record.u.copy()
    # the simulation takes it as linear within a step, which shrinks a sine of omega by (omega h)^2/12: undone here
    angle[1:-1] -= np.diff(angle, 2) / (12.0 * plant.substeps**2)
    return angle


def predict(rig: Rig, block: Block, record: Record, steps: Steps = "fine") -> Floats:
    """(N, channels) prediction of the block's channels, SI; each sample before the measurement pulls it."""
    part, block = part_of(rig, block), block.at(record.sample_time_s)
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
    """A function (state, n) -> (n, channels) that simulates the block from a state, which it changes."""
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
    """(2,) the block's gains, corrected for the modelled error of the sensor that pulls.

    The pull compares readings but acts on a state: a sensor that reads ten times too much would pull ten times as fast.
    """
    gains = np.array(block.gains)
    if block.pulled and part.active(SENSOR_PREFIX + block.pulled, slots.Reading):
        seen = float(np.ptp(record.y[block.pulled]))
        true = _without_errors(part, block.pulled, record.y[block.pulled].copy())
        gains *= float(np.ptp(true)) / seen if seen > 0.0 else 1.0
    return gains


def _substeps(part: Rig, block: Block, record: Record) -> int:
    """Substeps that the periodic laws need; 0 leaves the choice to the plant."""
    acting = [(e, values) for place in part.effects for e, values in part.active(place, slots.Slot)]
    waves = [values[p.name] for e, values in acting for p in e.parameters if p.role is Role.WAVE]
    sensor = block.imposed or block.pulled
    if not waves or sensor is None:
        return 0
    phase = max(waves) * float(np.quantile(np.abs(np.diff(record.y[sensor])), 0.99))  # per sample, nearly at most
    # a power of two
    wanted = int(2 ** int(np.ceil(np.log2(np.clip(phase / PHASE_MAX, 1.0, 2.0 * SUBSTEPS_MAX)))))
    if any(isinstance(e.slot, slots.MotorTorque) for e, _ in acting):
        wanted = max(wanted, SUBSTEPS_CURRENT)
    return min(wanted, SUBSTEPS_MAX) if wanted > SUBSTEPS_PLAIN else 0


def _start(part: Rig, plant: Plant, block: Block, record: Record, angle: float) -> State:
    """The state of a block at rest where the recording begins; for one in motion see :func:`_launch`."""
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
    """(bodies,) positions at rest, of which some are measured (``seen``); on the others the springs' forces vanish."""
    places = np.zeros(plant.n_bodies)
    places[list(seen)] = list(seen.values())
    others = [j for j in range(plant.n_bodies) if j not in seen]
    if seen and others:
        q, v = plant.position, plant.position + plant.n_bodies
        # acceleration by a unit of each position
        pull = plant.A[0 if plant.rotor < 0 else 1, v : v + plant.n_bodies, q : q + plant.n_bodies][others]
        places[others] = np.linalg.lstsq(pull[:, others], -pull @ places, rcond=None)[0]
    return places


def _launch(part: Rig, plant: Plant, block: Block, record: Record, theta: Floats, begins: Beginning) -> Launch:
    """The data to which the first state of a block is fitted, where the recording begins in motion."""
    moving = BEGINNING_DECAYS / slowest_decay(plant, block)
    if block.pulled and block.gains[0] == 0.0:
        moving = max(moving, BEGINNING_INTEGRATING_RATIO / block.tempo * record.sample_time_s)
    n = min(record.samples, max(SETTINGS.beginning_samples_min, round(moving / record.sample_time_s)))
    names = state_names(part, block.imposed is not None)
    owners = {b: b for b in part.elements} | {b: host[0] for b, host in hidden_bodies(part).items()}
    columns = [j for j, c in enumerate(block.channels) if c in begins.noise]
    channels = [block.channels[j] for j in columns]
    seen = {
        quantity: {
            c: (part.sensors[c].of, _without_errors(part, c, record.y[c].copy())[:n])
            for c in channels if part.sensors[c].quantity == quantity and part.sensors[c].of in names
        }
        for quantity in ("position", "velocity")
    }  # fmt: skip
    late = plant.delay_whole + plant.delay_ticks + plant.delay_part + int(plant.sensor_whole.max(initial=0)) > 0
    return Launch(
        plant, {b: (owners[b], part.elements[owners[b]].trait.axis) for b in names}, rig_half_gap(part),
        theta[:n] if plant.imposed else None, record.u[:n], float(np.std(record.u)),
        seen["position"], seen["velocity"], np.column_stack([record.y[c][:n] for c in channels]), columns,
        np.array([begins.noise[c] for c in channels]), begins, min(SETTINGS.delay_reach_samples, n // 2) if late else 0,
    )  # fmt: skip


def residual(rig: Rig, block: Block, record: Record, steps: Steps = "fine") -> Floats:
    """(N, channels) measured minus predicted, SI."""
    measured = np.column_stack([record.y[c] for c in block.channels])
    return measured - predict(rig, block, record, steps)
