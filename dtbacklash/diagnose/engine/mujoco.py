"""A MuJoCo model as a simulator that a predictor can ask: stepped as it is, with the rig's laws as applied forces.

Positions and speeds of its joints are the states. Between two readings the model takes its own steps, contacts and
limits as they are, by the Runge-Kutta method: a semi-implicit step shows positions half a step too early, which a
predictor takes for late sensors; it is taken where readings are ``as_stepped``. Dry friction is MuJoCo's own
(``frictionloss``), as hard as its step allows; efforts are held over a step, at the positions in its middle. Gains and
columns are those of the model about its mean position.
"""

import copy
import math
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.engine.mujoco_passes import (
    QUANTITIES,
    VELOCITY,
    Compiled,
    functions,
    laws,
    observe,
    onwards,
    show,
    told_by,
)
from dtbacklash.diagnose.engine.readings import Readings, first_read
from dtbacklash.diagnose.engine.simulated import Simulated, late_by
from dtbacklash.diagnose.engine.simulator import Linear, Pass
from dtbacklash.errors import UserError
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.mjcf import (
    ACTUATOR_PREFIX,
    FRICTION_IMPEDANCE,
    FRICTION_STEPS,
    model_of,
    number_of,
    set_number,
    steps_of,
)
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

#: without dry friction the Runge-Kutta method needs no more than a step for so many of the model's, or so many parts of
#: one where that matters
ROUGH, FINE = 2, 2
#: differences of states and of efforts for the linear part
MOVED, PUSHED = 1e-5, 1e-3
#: a joint is looked for in readings up to 2 to this power samples later
HORIZON = 12
#: the slots whose laws are simulated
JOINTS = slots.BodyEffort, slots.Contact
KNOWN = (*JOINTS, slots.BodyDamping, slots.Command, slots.Late, slots.Reading)


class Stepped(Simulated):
    """A MuJoCo model on one stretch of a recording: a :class:`.simulator.Simulator`.

    Raises UserError where the model's step is no divisor of a sample.
    """

    def __init__(self, readings: Readings, rig: Rig, finely: bool = False) -> None:
        import mujoco

        super().__init__(readings)
        self.finely, self._rig, self._mj, self._nominal = finely, rig, mujoco, model_of(rig.config)
        self._own = steps_of(self._nominal, rig.config.model, readings.sample_time_s / readings.every)
        self._joints = [e.name for e in rig.bodies()]
        self._linears: dict[Any, Linear] = {}

    def on(self, readings: Readings) -> "Stepped":
        """The same on other readings."""
        return Stepped(readings, self._rig, self.finely)

    def linear(self, rig: Rig) -> Linear:
        """Its linear part, about the mean of the recorded positions, where no dry friction, contact or limit acts."""
        rig = self._here(rig)
        r, mj = self.readings, self._mj
        kinds = slots.BodyDamping, slots.Reading, slots.Late
        linear = [(p, e.name, *v.values()) for p in rig.effects for kind in kinds for e, v in rig.active(p, kind)]
        key = (*(p.value for p in rig.config.parameters.values()), *linear)
        if key in self._linears:
            return self._linears[key]
        m, d, c = self._model(rig, bare=True)
        n, step = len(self._joints), r.sample_time_s
        m.dof_frictionloss[:] = 0.0
        m.opt.disableflags |= mj.mjtDisableBit.mjDSBL_CONTACT | mj.mjtDisableBit.mjDSBL_LIMIT
        middle, u = self._start(rig, np.nan_to_num(np.nanmean(r.y, axis=0))), c.U.mean(axis=0)

        def go(z: Floats, force: Floats, far: bool) -> Floats:
            mj.mj_resetData(m, d)
            d.qpos[:], d.qvel[:], d.qfrc_applied[:], d.ctrl[:] = z[:n], z[n:], force, u
            if far:
                mj.mj_step(m, d, nstep=c.whole)
                return np.concatenate([d.qpos, d.qvel])
            y = np.zeros(len(r.channels))
            show(c, y)
            return y

        def slopes(far: bool) -> tuple[Floats, Floats]:
            rest, none, out = np.concatenate([middle, np.zeros(n)]), np.zeros(n), []
            for size, moves, pushes in ((MOVED, np.eye(2 * n), np.zeros((2 * n, n))),
                                        (PUSHED, np.zeros((n, 2 * n)), np.eye(n))):  # fmt: skip
                out.append(np.array([
                    (go(rest + size * z, none + size * f, far) - go(rest - size * z, none - size * f, far)) / (2 * size)
                    for z, f in zip(moves, pushes, strict=True)
                ]).T)  # fmt: skip
            return out[0], out[1]

        (A, B), (C, D) = slopes(True), slopes(False)
        states = (*(f"{b} q" for b in self._joints), *(f"{b} v" for b in self._joints))
        found = Linear(
            np.array([A, A]), np.array([B, B]), np.array([C, C]), D, np.zeros((2, 2 * n)), np.zeros(len(r.channels)),
            states, tuple(self._joints), step / np.diag(B[n:]), n,
        )  # fmt: skip
        self._check_seen(A, C)
        self._linears[key] = found
        return found

    def _check_seen(self, A: Floats, C: Floats) -> None:
        """Refuse a joint whose speed never shows in any reading."""
        n, shown = len(self._joints), np.zeros(len(A), dtype=bool)
        for _ in range(HORIZON):
            shown |= (C @ A).any(axis=0)
            A = A @ A / max(float(np.abs(A).max()), 1.0)
        for joint, seen in zip(self._joints, shown[n:], strict=True):
            if not seen:
                read = ", ".join(self.readings.channels)
                allowed = f"joint {joint} moves none of them: give it a sensor, or fix it (fixed: [{joint}])"
                raise UserError("rig.sensors", read, allowed)

    def observe(self, rig: Rig, K: Floats, W: Floats, opening: int) -> Pass:
        """Predict and correct, sample by sample."""
        rig, Y = self._in_time(self._here(rig))
        _, d, c = self._model(rig)
        which, n = self.readings.which(opening, Y), len(self._joints)
        D, X = np.zeros(Y.shape), np.zeros((len(Y), 2 * n))
        d.qpos[:] = self._start(rig, np.array([first_read(y) for y in Y.T]))
        first = np.concatenate([d.qpos, d.qvel])
        observe(c, Y, K[1], which, D, X)
        E = np.einsum("kij,kj->ki", W[1][which], D)
        return Pass(np.where(np.isfinite(Y), E, 0.0 * E), D, X, first)

    def onwards(self, rig: Rig, Z: Floats) -> Floats:
        """(N, 2 joints) where one sample leads from each state; the last row is 0."""
        _, d, c = self._model(self._in_time(self._here(rig))[0])
        X = np.zeros_like(Z)
        onwards(c, np.ascontiguousarray(Z), X)
        del d
        return X

    def shown(self, rig: Rig, Z: Floats) -> Floats:
        """(N, m) what the sensors show of states at once."""
        _, d, c = self._model(self._here(rig))
        n, Y = len(self._joints), np.zeros((len(Z), len(self.readings.channels)))
        for z, y in zip(Z, Y, strict=True):
            d.qpos[:], d.qvel[:] = z[:n], z[n : 2 * n]
            show(c, y)
        return Y

    def _start(self, rig: Rig, read: Floats) -> Floats:
        """(joints,) positions as they were read, others as in the model."""
        start = np.array(self._nominal.qpos0)
        for channel, value in zip(self.readings.channels, read, strict=True):
            sensor = rig.sensors[channel]
            if sensor.quantity == "position":
                start[self._joints.index(sensor.of)] = value
        return start

    def _model(self, rig: Rig, bare: bool = False) -> tuple[Any, Any, Compiled]:
        """Model and data, which have to be kept, with what the loops need of a rig; ``bare``: without laws that are not
        linear."""
        mj, m, r = self._mj, copy.copy(self._nominal), self.readings
        unused = mj.mjtDisableBit
        m.opt.disableflags |= unused.mjDSBL_AUTORESET | unused.mjDSBL_SENSOR | unused.mjDSBL_ISLAND
        rough = bare or not any(rig.active(p, slots.Contact) for p in rig.elements)
        held = self._own
        if not r.as_stepped:
            m.opt.integrator = mj.mjtIntegrator.mjINT_RK4
            held = FINE * held if self.finely else max(math.ceil(held / ROUGH), 1) if rough else held
        m.opt.timestep = r.sample_time_s / r.every / held
        changed = {t: p.value for t, p in rig.config.parameters.items() if p.value != number_of(self._nominal, t)}
        for title, value in changed.items():
            set_number(m, title, value)
        d = mj.MjData(m)
        if any(title.startswith("bodies.") for title in changed):
            mj.mj_setConst(m, d)
            mj.mj_resetData(m, d)
        found: dict[type, list[tuple[int, Effect, Values]]] = {kind: [] for kind in (*JOINTS, slots.Reading)}
        for name in rig.effects:
            element = rig.elements.get(name)
            for effect, values in rig.active(name, slots.Slot):
                slot = effect.slot
                if not isinstance(slot, KNOWN):
                    raise UserError(f"rig.effects.{name}.{effect.name}", dict(values), "cannot be simulated in a model")
                if element is None:
                    channel = name.removeprefix(SENSOR_PREFIX)
                    if isinstance(slot, slots.Reading) and channel in r.channels:
                        found[slots.Reading].append((r.channels.index(channel), effect, values))
                    continue
                joint = self._joints.index(element.neighbours.get("drives", name))
                if isinstance(slot, slots.BodyDamping):
                    m.dof_damping[joint] += values[slot.coefficient]
                for kind in () if bare else JOINTS:
                    if isinstance(slot, kind):
                        found[kind].append((joint, effect, values))
        for joint, _, _ in found[slots.Contact]:
            m.dof_solref[joint], m.dof_solimp[joint, :2] = (FRICTION_STEPS * m.opt.timestep, 1.0), FRICTION_IMPEDANCE
        sensors = np.array([self._sensor(rig, c) for c in r.channels])
        step, forward = functions()
        needs = bool(((sensors[:, 0] > VELOCITY) | ((sensors[:, 0] == VELOCITY) & (sensors[:, 2] > 0.0))).any())
        return m, d, Compiled(
            step, forward if needs else 0, m._address, d._address, d.qpos, d.qvel, d.qacc, d.qfrc_applied,
            d.qfrc_actuator, d.ctrl, m.dof_frictionloss, m.dof_frictionloss.copy(), self._commands(rig, held),
            r.every // 2 * held, r.every * held, m.opt.timestep, laws(found[slots.BodyEffort]),
            laws(found[slots.Contact]), laws(found[slots.Reading]), sensors,
        )  # fmt: skip

    def _sensor(self, rig: Rig, channel: str) -> tuple[float, float, float]:
        """Its row of :class:`Compiled`."""
        sensor = rig.sensors[channel]
        joint = rig.elements[sensor.of].neighbours.get("drives", sensor.of)
        late = late_by(rig, channel, self.readings.sample_time_s)[1]
        return QUANTITIES[sensor.quantity], self._joints.index(joint), late

    def _commands(self, rig: Rig, held: int) -> Floats:
        """(fine steps, commands) what the actuators are told, averaged as the readings are."""
        r = self.readings
        recorded = r.inputs if r.inputs is not None else r.recorded[:, None]
        drives = [e for e in rig.elements.values() if e.trait.trait == slots.JOINT_DRIVE]
        columns = [np.zeros(0)] * len(drives)
        for element, column in zip(drives, recorded.T, strict=True):
            u = np.ascontiguousarray(column)
            for effect, values in rig.active(element.name, slots.Command):
                told = np.zeros(len(u))
                told_by(laws([(0, effect, values)]), u, told)
                u = told
            if r.every > 1:
                u = np.convolve(np.pad(u, r.every // 2, "edge"), np.full(r.every, 1.0 / r.every), "valid")
            fine = np.repeat(u, held)
            if late := rig.amount(element.name, slots.Late, "time") / (r.sample_time_s / r.every) * held:
                at = np.arange(len(fine))
                fine = np.interp(at - late, at, fine)
            columns[self._nominal.actuator(element.name.removeprefix(ACTUATOR_PREFIX)).id] = fine
        return np.ascontiguousarray(np.column_stack(columns))
