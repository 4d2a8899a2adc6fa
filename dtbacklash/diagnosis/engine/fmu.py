"""An FMU for Model Exchange as a simulator that a predictor can ask.

Its continuous states are set, its real inputs are commands and forces. Steps are as short as its fastest motion asks.
"""

import math
from contextlib import AbstractContextManager, suppress
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.core.library import ffi, lib, struct
from dtbacklash.diagnosis.engine.external_simulator import MOVED, Model, Modelled
from dtbacklash.diagnosis.engine.resampling import Samples
from dtbacklash.errors import UserError
from dtbacklash.physics.fmu_file import DECISIONS
from dtbacklash.physics.fmus import effects_of_inputs, first_inputs, model_of, passes, rates_by_states
from dtbacklash.physics.mjcf import ACTUATOR_PREFIX
from dtbacklash.physics.rig import Rig

#: a step of the Runge-Kutta method, of the fastest motion (rad); steps of a sample where laws act; finer ones
FASTEST, ACTING, FINE = 0.3, 2, 2
#: samples at which it is asked for its fastest motion, for each position
LOOKED = 12
#: turns in which positions that nobody reads find their rest, which a spring needs one of
TURNS = 3
#: steps of a sample at most
MOST = 2000
#: field of the struct ``Fmu`` -> the FMU's function, without fmi2 or fmi3
FUNCTIONS = {
    "set_time": "SetTime", "set_states": "SetContinuousStates", "get_states": "GetContinuousStates",
    "get_signs": "GetEventIndicators", "begin_event": "EnterEventMode", "end_event": "EnterContinuousTimeMode",
    "completed": "CompletedIntegratorStep",
}  # fmt: skip
OF_FMI_2 = {
    "get_rates": "GetDerivatives", "set_inputs": "SetReal", "get_outputs": "GetReal", "decide": "NewDiscreteStates",
}  # fmt: skip
OF_FMI_3 = {
    "get_rates": "GetContinuousStateDerivatives", "set_inputs": "SetFloat64", "get_outputs": "GetFloat64",
    "decide": "UpdateDiscreteStates",
}  # fmt: skip


class Exchanged(Modelled):
    """An FMU on one stretch of a recording.

    Raises UserError where its motion is so fast that a sample takes too many steps.
    """

    without = "leave it out of `joints`"

    def __init__(self, readings: Samples, rig: Rig, finely: bool = False) -> None:
        super().__init__(readings, rig, finely)
        config = rig.config
        self._fmu = model_of(config)
        joints = [config.joints[name] for name in self._joints]
        moved = [j["position"] for j in joints] + [j["speed"] for j in joints]
        self.names = tuple(s for s in self._fmu.states if s not in moved)
        order = self._fmu.states
        self._order = [order.index(s) for s in (*moved, *self.names)]
        self.commands = tuple(ACTUATOR_PREFIX + str(i) for i in config.commands.values())
        inputs = list(self._fmu.inputs)
        self._told = [inputs.index(i) for i in config.commands.values()]
        self._forces = [inputs.index(j["force"]) if j["force"] else -1 for j in joints]
        self._share: tuple[dict[str, float] | None, Floats] = None, np.zeros(0)
        self._own: int = self._steps(rig)
        if self._own > MOST:
            rates = self._own * FASTEST / readings.sample_time_s * readings.every
            allowed = f"its fastest motion, {rates:.3g} rad/s, takes {self._own} steps a sample; at most {MOST}"
            raise UserError("rig.model", config.model, allowed)
        for moved_to in self._places(rig):
            with suppress(UserError):  # a state that the FMU refuses, as behind a wall
                self._own = max(self._own, min(self._steps(rig, moved_to), MOST))

    def _steps(self, rig: Rig, at: dict[int, float] | None = None) -> int:
        """Steps of a sample as recorded that its fastest motion takes, at the first state or with some states moved."""
        rates = float(np.abs(np.linalg.eigvals(rates_by_states(self._fmu, self._values(rig), at))).max())
        return max(1, math.ceil(rates * self.readings.sample_time_s / self.readings.every / FASTEST))

    def _places(self, rig: Rig) -> list[dict[int, float]]:
        """Place of a state in the FMU -> value, at some samples: each position from its least to its largest."""
        r, n = self.readings, len(self._joints)
        told = {i: self._joints.index(rig.sensors[c].of) for i, c in enumerate(r.channels)
                if rig.sensors[c].quantity == "position"}  # fmt: skip
        whole = np.flatnonzero(np.isfinite(r.y[:, list(told)]).all(axis=1)) if told else np.zeros(0, dtype=int)
        if len(whole) < 2:
            return []
        y = r.y[whole]
        v = np.gradient(y, r.sample_time_s * whole, axis=0)
        ranks = np.linspace(0, len(y) - 1, LOOKED).astype(int)
        return [
            {self._order[j]: y[k, i] for i, j in told.items()} | {self._order[n + j]: v[k, i] for i, j in told.items()}
            for k in np.unique([np.argsort(y[:, i])[ranks] for i in told])
        ]

    def alone(self) -> AbstractContextManager[object]:
        """Where a process may have one instance alone, threads take turns."""
        return self._fmu.alone()

    @staticmethod
    def _values(rig: Rig) -> dict[str, float]:
        return {title: float(p.value) for title, p in rig.config.parameters.items()}

    def _start(self, rig: Rig, model: Model, read: Floats) -> Floats:
        """Positions that no sensor reads begin where nothing would move them, without a command."""
        start = super()._start(rig, model, read)
        known = [rig.sensors[channel] for channel in self.readings.channels]
        known_of = [s.of for s in known if s.quantity == "position"]
        free = [k for k, joint in enumerate(self._joints) if joint not in known_of]
        instance, inputs, n = self._fmu.instance(), first_inputs(self._fmu), len(self._joints)

        def pulled(z: Floats) -> Floats:
            theirs = np.zeros(len(z))
            theirs[self._order] = z
            return instance.rates(theirs, inputs)[self._order][n:][free]

        for _ in range(TURNS if free else 0):
            moves = MOVED * np.eye(len(start))[free]
            slopes = np.array([(pulled(start + z) - pulled(start - z)) / (2.0 * MOVED) for z in moves]).T
            start[free] -= np.linalg.lstsq(slopes, pulled(start), rcond=1e-9)[0]
        return start

    def steps(self, laws: bool, contacts: bool) -> tuple[int, int]:
        """As many as its fastest motion takes, and as laws do."""
        held = (max(self._own, ACTING) if laws or contacts else self._own) * self.readings.every
        return FINE * held if self.finely else held, 1

    def outputs(self, rig: Rig) -> dict[str, None]:
        """With what stands in arrays beside them."""
        return self._fmu.whole(super().outputs(rig))

    def _shares(self, rig: Rig, values: dict[str, float]) -> Floats:
        """(joints, commands) the effort on each joint by a unit of each command; kept while parameters stay."""
        known, found = self._share
        if known != values:
            at_once, joints, order = effects_of_inputs(self._fmu, values), rig.config.joints, self._fmu.states
            drives = {a: rig.elements[a].neighbours["drives"] for a in self.commands}
            found = np.array([
                [passes(joints[b], at_once, a, order) if b == drives[a] else 0.0 for a in drives] for b in self._joints
            ])  # fmt: skip
            self._share = values, found
        return found

    def parts(
        self, rig: Rig, step_s: float, ratio: int, dampings: Floats, contacts: list[int], bare: bool
    ) -> tuple[Any, dict[str, Any]]:
        """The instance of this thread, begun anew."""
        fmu, instance, values = self._fmu, self._fmu.instance(), self._values(rig)
        share = self._shares(rig, values)
        x = instance.begin(values)[self._order]
        n, j, told, outputs = len(x), len(self._joints), fmu.inputs, self.outputs(rig)
        sizes = [
            (n, ("rate", "theirs", "theirs_rate", "begun", "total", "rest")), (len(told), ("given",)),
            (len(self._told), ("ctrl",)), (len(outputs), ("shown",)), (1, ("clock",)), (j * j, ("pair",)),
            (j, ("push", "friction", "held", "mark", "load")), (fmu.signs, ("sign",)),
        ]  # fmt: skip
        room = {name: np.zeros(size) for size, names in sizes for name in names}
        named, shown = fmu.references(told), fmu.references(outputs)
        called = FUNCTIONS | (OF_FMI_3 if instance.threes else OF_FMI_2)
        model = struct(
            "Fmu", **{name: instance.address(function) for name, function in called.items()}, **room, x=x, share=share,
            instance=int(instance.fmu.component), threes=instance.threes, follows=fmu.switches and not bare,
            decisions=DECISIONS, states=n, joints=j, commands=len(self._told), inputs=len(told), outputs=len(outputs),
            signs=fmu.signs, input_names=ffi.new("uint32_t[]", named), output_names=ffi.new("uint32_t[]", shown),
            inputs_named=len(named), outputs_named=len(shown), order=np.array(self._order, dtype=np.int64),
            input=np.array(self._told, dtype=np.int64), force=np.array(self._forces, dtype=np.int64), step=step_s,
            next=instance.next_s, still=np.array(list(first_inputs(fmu).values())), before=instance.signs(),
            damping=dampings,
        )  # fmt: skip
        steps = {"step": lib.dtb_fmu_step, "forward": lib.dtb_fmu_forward, "back": lib.dtb_fmu_back}
        shared = {name: room[name] for name in ("push", "load", "ctrl", "friction", "shown", "clock")}
        return (model, instance), steps | shared | {
            "model": ffi.cast("void *", model), "q": x[:j], "v": x[j : 2 * j], "more": x[2 * j :],
            "acceleration": room["rate"][j : 2 * j], "at": np.arange(j), "behind": np.full(j, -1),
        }  # fmt: skip
