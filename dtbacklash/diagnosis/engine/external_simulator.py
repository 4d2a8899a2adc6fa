"""A simulator's model as what a predictor can ask: stepped as it is, with the rig's laws as applied forces.

Positions and speeds of its joints are the states, and what else the model has. What a simulator has to give for that
is its parts (:class:`Parts`): a function that takes a step, and views of states, forces and commands. Efforts are held
over a step, at the positions in its middle. Gains and columns are those of the model about its mean position.
"""

import functools
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, NamedTuple, TypeVar

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.core.library import buffer, copied, lib, struct
from dtbacklash.diagnosis.engine.resampling import Samples, first_read
from dtbacklash.diagnosis.engine.rig_simulator import Simulated, late_by
from dtbacklash.diagnosis.engine.simulator import Linear, Pass
from dtbacklash.errors import UserError
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.kernel import laws
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

#: differences of states and of efforts for the linear part
MOVED, PUSHED = 1e-5, 1e-3
#: a joint is looked for in readings up to 2 to this power samples later
HORIZON = 12
#: the slots whose laws act on joints, and those of the struct ``Model`` by field
JOINTS = slots.BodyEffort, slots.Contact
LAWS: dict[str, type[slots.Slot]] = {"effort": slots.BodyEffort, "level": slots.Contact, "read": slots.Reading}
#: fine steps are so much smaller where a gap closes
HARD = 2
KNOWN = (*JOINTS, slots.JointPlay, slots.BodyDamping, slots.Command, slots.Late, slots.Reading)

#: what a sensor of a quantity shows
QUANTITIES = {
    "position": lib.SHOWS_POSITION, "velocity": lib.SHOWS_VELOCITY, "acceleration": lib.SHOWS_ACCELERATION,
    "torque": lib.SHOWS_EFFORT, "force": lib.SHOWS_EFFORT, "value": lib.SHOWS_OUTPUT,
}  # fmt: skip

#: what acts: of which joint or channel, the effect, its values
Acting = list[tuple[int, Effect, Values]]


class Model(NamedTuple):
    """A model as the core steps it.

    struct : of ``core/external.h``. width : numbers of a state. U : (fine steps, commands) what the actuators are told
    in each. owner : what has to be there as long.
    """

    struct: Any
    width: int
    U: Floats
    owner: Any


R = TypeVar("R")


def _alone(method: Callable[..., R]) -> Callable[..., R]:
    """Have a method use the model alone."""

    @functools.wraps(method)
    def held(self: "Modelled", *arguments: Any) -> R:
        with self.alone():
            return method(self, *arguments)

    return held


class Modelled(Simulated):
    """A simulator's model on one stretch of a recording: a :class:`.simulator.Simulator`.

    names : of its states beside positions and speeds. commands : element of each actuator, in the model's order.
    without : what to do about a joint that no sensor shows.
    """

    names: tuple[str, ...] = ()
    commands: tuple[str, ...]
    without = "fix it (fixed: [its name])"

    def __init__(self, readings: Samples, rig: Rig, finely: bool = False) -> None:
        super().__init__(readings)
        self.finely, self._rig = finely, rig
        self._joints = [e.name for e in rig.bodies()]
        self._linears: dict[Any, Linear] = {}

    def on(self, readings: Samples) -> "Modelled":
        """The same on other readings."""
        return type(self)(readings, self._rig, self.finely)

    def alone(self) -> AbstractContextManager[object]:
        """Within it, the model is this thread's."""
        return nullcontext()

    def steps(self, laws: bool, contacts: bool) -> tuple[int, int]:
        """Far steps of a reading, and small ones of a far one. laws, contacts : whether such act on joints."""
        raise NotImplementedError

    def parts(
        self, rig: Rig, step_s: float, ratio: int, dampings: Floats, contacts: list[int], bare: bool
    ) -> tuple[Any, dict[str, Any]]:
        """The model with a rig's parameters, in its first state: what has to be kept, and its fields of ``Model``.

        step_s, ratio : its small step, and how many are a far one. dampings : (joints,) that are added. contacts :
        joints with dry friction beside the model's. bare : without the model's own friction, contacts and limits, and
        without gaps.
        """
        raise NotImplementedError

    @_alone
    def linear(self, rig: Rig) -> Linear:
        """Its linear part, about the mean of the recorded positions, where no dry friction, contact or limit acts."""
        rig = self._here(rig)
        r = self.readings
        kinds = slots.BodyDamping, slots.Reading, slots.Late
        linear = [(p, e.name, *v.values()) for p in rig.effects for kind in kinds for e, v in rig.active(p, kind)]
        key = (*(p.value for p in rig.config.parameters.values()), *linear)
        if key in self._linears:
            return self._linears[key]
        model = self._model(rig, bare=True)
        n, step = len(self._joints), r.sample_time_s
        middle = self._start(rig, model, np.nan_to_num(np.nanmean(r.y, axis=0)))
        size, u = len(middle), model.U.mean(axis=0)
        middle[n : 2 * n] = 0.0

        base = np.concatenate([middle, np.zeros(n), u])
        ends, by = np.cumsum([size, n, len(u)]), np.repeat([MOVED, PUSHED, PUSHED], [size, n, len(u)])
        by[ends[1] :] *= np.maximum(model.U.std(axis=0), 1e-3)

        def go(at: Floats, far: bool) -> Floats:
            out = np.zeros(size if far else len(r.channels))
            lib.dtb_model_led(model.struct, *(buffer(part) for part in np.split(at, ends[:2])), far, buffer(out))
            return out

        def slopes(far: bool) -> list[Floats]:
            found = [(go(base + move, far) - go(base - move, far)) / (2.0 * move.sum()) for move in np.diag(by)]
            return np.split(np.array(found).T, ends[:2], axis=1)

        (A, B, told), (C, D, at_once) = slopes(True), slopes(False)
        states = (*(f"{b} q" for b in self._joints), *(f"{b} v" for b in self._joints), *self.names)
        found = Linear(
            np.array([A, A]), np.array([B, B]), np.array([C, C]), D, np.zeros((2, size)), np.zeros(len(r.channels)),
            states, tuple(self._joints), step / np.diag(B[n : 2 * n]), n,
            {name: (told[:, k].copy(), at_once[:, k].copy()) for k, name in enumerate(self.commands)},
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
        for joint, seen in zip(self._joints, shown[n : 2 * n], strict=True):
            if not seen:
                read = ", ".join(self.readings.channels)
                allowed = f"joint {joint} moves none of them: give it a sensor, or {self.without}"
                raise UserError("rig.sensors", read, allowed)

    @_alone
    def observe(self, rig: Rig, K: Floats, W: Floats, opening: int, which: np.ndarray | None = None) -> Pass:
        """Predict and correct, sample by sample."""
        rig, Y = self._in_time(self._here(rig))
        model = self._model(rig)
        which = self.readings.which(opening, Y) if which is None else which
        first = self._start(rig, model, np.array([first_read(y) for y in Y.T]))
        (N, m), n = Y.shape, len(first)
        D, X, corrected = np.zeros((N, m)), np.zeros((N, n)), 2 * model.struct.joints + model.struct.others
        lib.dtb_model_put(model.struct, buffer(first))
        lib.dtb_model_observe(
            model.struct, N, n, copied(Y), copied(K[1], K.shape[1], corrected, m), buffer(which, N), buffer(D),
            buffer(X),
        )  # fmt: skip
        E = np.einsum("kij,kj->ki", W[1][which], D)
        return Pass(np.where(np.isfinite(Y), E, 0.0 * E), D, X, first)

    @_alone
    def onwards(self, rig: Rig, Z: Floats) -> Floats:
        """(N, n) where one sample leads from each state; the last row is 0."""
        model, X = self._model(self._in_time(self._here(rig))[0]), np.zeros(Z.shape)
        lib.dtb_model_onwards(model.struct, len(Z), model.width, copied(Z, len(Z), model.width), buffer(X))
        return X

    @_alone
    def shown(self, rig: Rig, Z: Floats) -> Floats:
        """(N, m) what the sensors show of states, each at the time and the commands of its reading."""
        return self._shown(self._model(self._here(rig)), Z)

    @_alone
    def loads(self, rig: Rig, Z: Floats) -> Floats:
        """(N, joints) what actuators exert on each joint at states Z (N, n), under the commands that follow; N, N m."""
        return self._shown(self._model(self._here(rig), loads=True), np.concatenate([Z[:1], Z]))[1:]

    @staticmethod
    def _shown(model: Model, Z: Floats) -> Floats:
        Y = np.zeros((len(Z), model.struct.sensors))
        lib.dtb_model_shown(model.struct, len(Z), model.width, copied(Z, len(Z), model.width), buffer(Y))
        return Y

    def _start(self, rig: Rig, model: Model, read: Floats) -> Floats:
        """(n,) positions as they were read, others as in the model."""
        start = np.zeros(model.width)
        lib.dtb_model_take(model.struct, buffer(start))
        for channel, value in zip(self.readings.channels, read, strict=True):
            sensor = rig.sensors[channel]
            if sensor.quantity == "position":
                start[self._joints.index(sensor.of)] = value
        return start

    def _model(self, rig: Rig, bare: bool = False, loads: bool = False) -> Model:
        """The model with what acts on it in a rig, and what its sensors show.

        bare : without laws that are not linear. loads : sensors are of what actuators exert on each joint.
        """
        r = self.readings
        found: dict[type, Acting] = {kind: [] for kind in LAWS.values()}
        dampings = np.zeros(len(self._joints))
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
                    dampings[joint] += values[slot.coefficient]
                for kind in () if bare else JOINTS:
                    if isinstance(slot, kind):
                        found[kind].append((joint, effect, values))
        contacts = [joint for joint, _, _ in found[slots.Contact]]
        hard = not bare and any(rig.active(name, slots.JointPlay) for name in self._joints)
        far, ratio = self.steps(bool(found[slots.BodyEffort]), bool(contacts) or hard)
        far, ratio = (far * ratio * (HARD if self.finely else 1), 1) if hard else (far, ratio)
        whole, begin = far * ratio, r.every // 2 * r.sample_time_s / r.every
        owner, parts = self.parts(rig, r.sample_time_s / whole, ratio, dampings, contacts, bare)
        efforts = [(lib.SHOWS_EFFORT, j, 0.0) for j in range(len(self._joints))]
        sensors = np.array(efforts if loads else [self._sensor(rig, c) for c in r.channels], dtype=float)
        moves = sensors[:, 0] == lib.SHOWS_POSITION, (sensors[:, 0] == lib.SHOWS_VELOCITY) & (sensors[:, 2] <= 0.0)
        if (moves[0] | moves[1]).all():
            parts["forward"] = 0
        acting = {field: found[kind] for field, kind in LAWS.items()}
        if loads:
            acting["read"] = []
        U, more = self._commands(rig, whole), len(parts["more"])
        made = struct(
            "Model", **parts, **{f"{field}s": len(one) for field, one in acting.items()},
            **{field: laws.acting(LAWS[field], one) for field, one in acting.items()},
            degrees=len(parts["q"]), joints=len(self._joints), others=more, commands=U.shape[1], sensors=len(sensors),
            still=parts["friction"].copy(), U=U, fine=len(U), whole=whole, ratio=ratio, begin=begin,
            h=r.sample_time_s / whole, sensor=sensors,
        )  # fmt: skip
        return Model(made, 2 * len(parts["q"]) + more, U, owner)

    def _sensor(self, rig: Rig, channel: str) -> tuple[float, float, float]:
        """Its row of ``sensor`` of the struct."""
        sensor = rig.sensors[channel]
        quantity = QUANTITIES[sensor.quantity]
        late = late_by(rig, channel, self.readings.sample_time_s)[1]
        if quantity == lib.SHOWS_OUTPUT:
            return quantity, list(self.outputs(rig)).index(sensor.of), late
        joint = rig.elements[sensor.of].neighbours.get("drives", sensor.of)
        return quantity, self._joints.index(joint), late

    def outputs(self, rig: Rig) -> dict[str, None]:
        """Variables of the model that sensors show."""
        return {s.of: None for s in rig.sensors.values() if s.quantity == "value"}

    def _commands(self, rig: Rig, whole: int) -> Floats:
        """(fine steps, commands) what the actuators are told in each, averaged as the readings are."""
        r = self.readings
        edges = r.every // 2 + np.arange(len(r.y) * whole + 1) * (r.every / whole)
        recorded = r.inputs if r.inputs is not None else r.recorded[:, None]
        drives = [e for e in rig.elements.values() if e.trait.trait == slots.JOINT_DRIVE]
        columns = [np.zeros(0)] * len(drives)
        for element, column in zip(drives, recorded.T, strict=True):
            u = column
            for effect, values in rig.active(element.name, slots.Command):
                u = laws.values_of(effect, values, command=u)
            if r.every > 1:
                u = np.convolve(np.pad(u, r.every // 2, "edge"), np.full(r.every, 1.0 / r.every), "valid")
            late = rig.amount(element.name, slots.Late, "time") / (r.sample_time_s / r.every)
            columns[self.commands.index(element.name)] = _means(u, np.asarray(edges - late))
        return np.ascontiguousarray(np.column_stack(columns))


def _means(u: Floats, edges: Floats) -> Floats:
    """(E - 1,) means between edges (E,), samples, of what is held over each sample, and beyond its ends."""
    known = np.concatenate([[0.0], np.cumsum(u)])
    sums = np.interp(edges, np.arange(len(known)), known)
    sums += u[0] * np.minimum(edges, 0.0) + u[-1] * np.maximum(edges - len(u), 0.0)
    return np.asarray(np.diff(sums) / np.diff(edges))
