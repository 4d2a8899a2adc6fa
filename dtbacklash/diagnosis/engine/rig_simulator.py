"""The compiled rig as a simulator that a predictor can ask."""

import numpy as np
from scipy.linalg import expm

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.passes import observe, onwards, shown
from dtbacklash.diagnosis.engine.resampling import Samples, between, first_read
from dtbacklash.diagnosis.engine.simulator import Linear, Pass
from dtbacklash.physics.assembly import compile_plant, state_names
from dtbacklash.physics.effects import slots
from dtbacklash.physics.element_kinds import GROUND
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.exponential import discretise
from dtbacklash.physics.kernel.plant import Plant, State, new_state
from dtbacklash.physics.kernel.simulation import amplify, sense
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.physics.simulate import rig_half_gap

#: substeps of a sample, and levels to which an event is located, where forces act beside the linear plant; the fine
#: ones where that matters
STEPS, STEPS_FINE = (2, 10), (8, 10)
#: a late sensor's readings are moved by whole samples; less than this is left to the simulation (samples)
ROUNDING = 1e-6
#: a state is moved by so much to see what sensors show of it
MOVED = 1e-3


@np.errstate(over="ignore", invalid="ignore")
def linear_of(rig: Rig, sample_time_s: float, channels: tuple[str, ...]) -> Linear:
    """The linear model of a rig at a sample time, as its laws do nothing."""
    p = compile_plant(rig, sample_time_s, 1, 1)
    names, sensors = state_names(rig, p.imposed), list(rig.sensors)
    nb, n, q, v = p.n_bodies, p.A.shape[1], p.position, p.position + p.n_bodies
    modes = (0, 1) if p.rotor >= 0 else (0, 0)
    shown = [sensors.index(c) for c in channels]
    C = np.array([_shown(p, contact and p.rotor >= 0, shown) for contact in (False, True)])
    D, volt_at_once = np.zeros((len(channels), nb)), np.zeros(len(channels))
    for r, channel in enumerate(channels):
        rest = late_by(rig, channel, sample_time_s)[1]
        for mode, contact in enumerate(modes) if rest > 0.0 else ():  # what it was a part of a sample ago
            C[mode, r] = C[mode, r] @ expm(-rest * p.A[contact])
    for r, s in enumerate(shown):
        if p.sensor[s, pl.Y_INDEX] == pl.ACCELERATION:
            at = v + int(p.sensor[s, pl.Y_PLACE])
            D[r], volt_at_once[r] = p.G[modes[1], pl.CH_F : pl.CH_F + nb, at], p.G[modes[1], pl.CH_V, at]
    forces = slice(pl.CH_F, pl.CH_F + nb)
    states = [*(["current"] if q else []), *(f"{b} q" for b in names), *(f"{b} v" for b in names)]
    states += [f"memory {k}" for k in range(n - len(states))]
    per_force = np.array([p.G[modes[1], pl.CH_F + j, v + j] for j in range(nb)])
    return Linear(
        np.array([p.E[c, 0].T for c in modes]), np.array([p.P1[c, 0].T[:, forces] for c in modes]), C, D,
        np.array([p.P1[c, 0].T[:, pl.CH_V] for c in modes]), volt_at_once,
        tuple(states), tuple(names), 1.0 / np.maximum(per_force, 1e-300), v,
    )  # fmt: skip


def late_by(rig: Rig, channel: str, sample_time_s: float) -> tuple[int, float]:
    """How late a sensor is: whole samples, and the rest, s."""
    time = rig.amount(SENSOR_PREFIX + channel, slots.Late, "time")
    whole = int(time / sample_time_s + ROUNDING)
    rest = time - whole * sample_time_s
    return whole, rest if rest > ROUNDING * sample_time_s else 0.0


def _shown(p: Plant, contact: bool, shown: list[int]) -> Floats:
    """(m, n) what the sensors show of small moves of the state, at once, and where no law but their own acts."""
    n, y, own = p.A.shape[1], np.zeros((2, len(p.sensor))), p.slot[pl.READING]
    p = p._replace(
        first=np.clip(p.first, p.first[own], p.first[own + len(p.sensor)]), friction_ends=p.friction_ends[:0],
        sensor_whole=0 * p.sensor_whole, sensor_tick=0 * p.sensor_tick, sensor_part=0.0 * p.sensor_part,
        sensor_play=0.0 * p.sensor_play,
    )  # fmt: skip
    C = np.zeros((len(shown), n))
    for i in range(n):
        for side, by in enumerate((0.0, MOVED)):
            state = new_state(p)
            if p.has_base and not p.imposed:
                state.mode[0] = pl.PLUS if contact else pl.FREE
            state.x[i] = by
            if contact:
                state.gear[0] = state.x[p.position + p.rotor]
            sense(p, state, 0.0, 0.0, y[side])
        C[:, i] = (y[1] - y[0])[shown] / MOVED
    return C


class Simulated:
    """The compiled rig on one stretch of a recording: a :class:`.simulator.Simulator`."""

    def __init__(self, readings: Samples, finely: bool = False) -> None:
        self.readings, self.finely = readings, finely

    def on(self, readings: Samples) -> "Simulated":
        """The same on other readings."""
        return Simulated(readings, self.finely)

    def _here(self, rig: Rig) -> Rig:
        """The rig as it is in this recording."""
        return rig.of(self.readings.recording)

    def linear(self, rig: Rig) -> Linear:
        """Its linear part; recordings that are sampled alike share it."""
        here, r = self._here(rig), self.readings
        key = "linear", r.sample_time_s, r.channels
        return here.once(key, lambda: linear_of(here, r.sample_time_s, r.channels))

    def observe(self, rig: Rig, K: Floats, W: Floats, opening: int, which: np.ndarray | None = None) -> Pass:
        """Predict and correct, sample by sample, by gains of the rig's linear states; others are not corrected.

        opening, which : see :meth:`.simulator.Simulator.observe`.
        """
        rig, Y = self._in_time(self._here(rig))
        u, rise, rig = self._driven(rig)
        if self.readings.step.any():
            Y = Y - np.outer(self.readings.step, self.linear(rig).volt_at_once)
        p, state, chan = self._ready(rig, Y)
        n = len(state.x)
        if n > K.shape[2]:
            K = np.concatenate([K, np.zeros((*K.shape[:2], n - K.shape[2], K.shape[3]))], axis=2)
        shape = Y.shape
        found = Pass(np.zeros(shape), np.zeros(shape), np.zeros((len(u), n)), state.x.copy())
        theta = u if p.imposed else np.zeros(1)
        observe(
            p, state, u, rise, self._ramp(p), self._half_gap(rig), theta, Y, K[:, :, :n], W,
            self.readings.which(opening, Y) if which is None else which, chan, found.E, found.X, found.D,
        )  # fmt: skip
        return found

    def onwards(self, rig: Rig, Z: Floats) -> Floats:
        """(N, n) where one sample leads from each state; the last row is 0."""
        u, _, rig = self._driven(self._in_time(self._here(rig))[0])
        p, state, _ = self._ready(rig, self.readings.y)
        X = np.zeros_like(Z)
        onwards(p, state, u, self._half_gap(rig), u if p.imposed else np.zeros(1), Z, X)
        return X

    def shown(self, rig: Rig, Z: Floats) -> Floats:
        """(N, m) what the sensors show of states at once."""
        p, state, chan = self._ready(self._here(rig), self.readings.y)
        Y = np.zeros((len(Z), len(rig.sensors)))
        shown(p, state, self._half_gap(rig), Z, Y)
        return Y[:, chan]

    def loads(self, rig: Rig, Z: Floats) -> Floats:
        """Of a simulator's model only: a rig's drives say themselves what they exert."""
        raise NotImplementedError

    def there(self, rig: Rig) -> np.ndarray:
        """(N, m) whether each reading is, where a rig moves those of late sensors to."""
        return np.isfinite(self._in_time(self._here(rig))[1])

    def as_read(self, rig: Rig, D: Floats) -> Floats:
        """(N, m) innovations of a pass at the samples at which they were read; NaN where there is none."""
        out = np.where(self.there(rig), D, np.nan)
        for j, channel in enumerate(self.readings.channels):
            whole, _ = self._moved_by(self._here(rig), channel)
            if whole:
                out[:, j] = np.concatenate([np.full(whole, np.nan), out[:-whole, j]])
        return out

    def _moved_by(self, rig: Rig, channel: str) -> tuple[int, float]:
        """How many samples a late sensor's readings are moved by, if few of all; and the rest of its delay, s."""
        whole, rest = late_by(rig, channel, self.readings.sample_time_s)
        return (whole if whole < len(self.readings.y) // 4 else 0), rest

    def _in_time(self, rig: Rig) -> tuple[Rig, Floats]:
        """Readings from the sensors' zeros, late ones earlier by whole samples; the rig that is late by the rest only.

        A correction by what a sensor saw long ago would meet the wrong state.
        """
        r = self.readings
        zeros = np.array([rig.sensors[channel].zero for channel in r.channels])
        read = r.y - zeros if zeros.any() else r.y
        Y = read
        for j, channel in enumerate(r.channels):
            place, (whole, rest) = SENSOR_PREFIX + channel, self._moved_by(rig, channel)
            if not whole:
                continue
            Y = Y.copy() if Y is read else Y
            Y[:-whole, j], Y[-whole:, j] = read[whole:, j], np.nan
            for effect, values in rig.active(place, slots.Late):
                assert isinstance(effect.slot, slots.Late)
                rig = rig.with_effect(place, effect.name, {**values, effect.slot.time: rest} if rest else None)
        return rig, Y

    def _half_gap(self, rig: Rig) -> float:
        """That of the rig, opened by as much as the stretch has it."""
        return max(rig_half_gap(rig) + self.readings.opened, 0.0)

    def _ramp(self, p: Plant) -> Floats:
        """(n,) what a command that rises by 1 about its mean adds within a sample."""
        if self.readings.every == 1:
            return np.zeros(p.A.shape[1])
        _, P1, P2 = discretise(p.A, p.G, self.readings.sample_time_s, 1)
        mode = 1 if p.rotor >= 0 else 0
        ramp: Floats = P2[mode, 0, pl.CH_V] - 0.5 * P1[mode, 0, pl.CH_V]
        return ramp

    def _driven(self, rig: Rig) -> tuple[Floats, Floats, Rig]:
        """The command that leaves the amplifier, its rise, and the rig without the laws that made it, if averaged."""
        r = self.readings
        amplifier = rig.only("amplifier")
        laws = rig.active(amplifier.name, slots.Command) if amplifier and r.every > 1 else []
        if not laws or amplifier is None:
            return r.u, r.rise, rig
        out = np.zeros_like(r.recorded)
        amplify(compile_plant(rig, r.sample_time_s, 1, 1), r.recorded, out)
        for effect, _ in laws:
            rig = rig.with_effect(amplifier.name, effect.name, None)
        u, rise = between(out, r.every)
        return u[: len(r.u)], rise[: len(r.u)], rig

    def _ready(self, rig: Rig, Y: Floats) -> tuple[Plant, State, np.ndarray]:
        """The compiled rig in its first state: positions as they were read first, at rest."""
        r = self.readings
        steps = STEPS_FINE if self.finely else STEPS
        key = "plant", r.sample_time_s, steps
        p = rig.once(key, lambda: compile_plant(rig, r.sample_time_s, 0, 10, False, steps))
        state, sensors = new_state(p), list(rig.sensors)
        chan = np.array([sensors.index(c) for c in r.channels])
        first = np.array([first_read(y) for y in Y.T])
        state.seen[:, chan] = state.played[chan] = first
        known = {}
        for channel, value in zip(r.channels, first.tolist(), strict=True):
            if rig.sensors[channel].quantity == "position":
                known[rig.sensors[channel].of] = value
        names = state_names(rig, p.imposed)
        at = _at_rest(rig, names, known, float(r.u[0]) if p.imposed else None, self._half_gap(rig), p)
        state.x[p.position : p.position + p.n_bodies] = at[:-1]
        if p.has_base:
            state.gear[0] = at[-1]
            if p.rotor >= 0 and self._half_gap(rig) > 0.0:
                state.mode[0] = pl.FREE
        for channel, j, value in zip(r.channels, chan, first, strict=True):
            i, sensor = p.sensor[j, pl.Y_INDEX], rig.sensors[channel]
            filtered = i >= p.position + 2 * p.n_bodies
            if i >= 0 and (filtered or sensor.quantity in ("velocity", "current")):
                state.x[int(i) : int(i) + (int(p.sensor[j, pl.Y_PLACE]) if filtered else 1)] = value
            if filtered and sensor.quantity == "velocity":
                state.x[p.position + p.n_bodies + names.index(sensor.of)] = value
        return p, state, chan


def _at_rest(
    rig: Rig, names: list[str], known: dict[str, float], imposed: float | None, gap: float, p: Plant
) -> Floats:
    """(bodies + 1,) positions that leave springs unstretched as far as they were not read; last the screw's angle."""
    screw = rig.only("screw")
    lead, carried = float(p.screw[pl.S_LEAD]), screw.neighbours.get("carries") if screw else None
    rotor = names[p.rotor] if p.rotor >= 0 else None
    angle, behind = imposed, _unstretched(rig, {GROUND: 0.0, **known}).get(carried or "")
    if angle is None and p.has_base and lead:
        angle = known.get(rotor or "", behind / lead if behind is not None else 0.0)
        if behind is not None and rotor in known:  # within the gap the screw stands where it was left
            angle = min(max(behind / lead, angle - gap), angle + gap)
    found = {GROUND: 0.0, **known}
    if p.has_base and angle is not None:
        found.setdefault(rotor or "", angle)
        positioner = rig.only("positioner")
        base = carried if carried else (positioner.name if positioner else "")
        found.setdefault(base, lead * angle)
    found = _unstretched(rig, found)
    return np.array([*(found.get(n, 0.0) for n in names), angle or 0.0])


def _unstretched(rig: Rig, found: dict[str, float]) -> dict[str, float]:
    """Positions of more bodies, where no spring between two is stretched."""
    found = dict(found)
    for _ in rig.links():
        for spring in rig.links():
            a, b = spring.neighbours["between"]
            if a in found and b not in found:
                found[b] = spring.lever * found[a]
            elif b in found and a not in found and spring.lever:
                found[a] = found[b] / spring.lever
    return found
