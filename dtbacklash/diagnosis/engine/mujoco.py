"""A MuJoCo model as a simulator that a predictor can ask.

Between two readings the model takes its own steps, contacts and limits as they are, by the Runge-Kutta method: a
semi-implicit step shows positions half a step too early, which a predictor takes for late sensors; it is taken where
readings are ``as_stepped``. Dry friction is MuJoCo's own (``frictionloss``), as hard as its step allows, where a joint
may turn; while it slides it is a force. Where no friction turns, steps are as far as the model's rates allow.
"""

import copy
import ctypes
import functools
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.core.library import ffi, lib
from dtbacklash.diagnosis.engine.external_simulator import Modelled
from dtbacklash.diagnosis.engine.resampling import Samples
from dtbacklash.physics.effects import slots
from dtbacklash.physics.mjcf import (
    ACTUATOR_PREFIX,
    FRICTION_IMPEDANCE,
    FRICTION_STEPS,
    PLAY_PREFIX,
    model_of,
    number_of,
    set_number,
    steps_of,
)
from dtbacklash.physics.rig import Rig

#: the Runge-Kutta method needs no more than a step for so many of the model's, of so many where laws act at a place,
#: or so many parts of one where that matters
FAR, ROUGH, FINE = 4, 2, 2
#: by so much the model's fastest part may turn or decay within a step (rad)
TURN = 0.3
#: steps of a reading that is a mean: its command rises within it
MEAN = 2


class Stepped(Modelled):
    """A MuJoCo model on one stretch of a recording.

    Raises UserError where the model's step is no divisor of a sample.
    """

    def __init__(self, readings: Samples, rig: Rig, finely: bool = False) -> None:
        super().__init__(readings, rig, finely)
        self._nominal = m = model_of(rig.config)
        self._own = readings.every * steps_of(m, rig.config.model, readings.sample_time_s / readings.every)
        self._least = min(math.ceil(rate_of(m) * readings.sample_time_s / TURN), self._own)
        self.commands = tuple(ACTUATOR_PREFIX + m.actuator(a).name for a in range(m.nu))

    def steps(self, laws: bool, contacts: bool) -> tuple[int, int]:
        """The model's own where a friction may turn, fewer where nothing is hard."""
        if self.readings.as_stepped:
            return self._own, 1
        parts = FINE if self.finely else 1
        far = parts * max(
            math.ceil(self._own / (ROUGH if laws else FAR)), self._least, MEAN if self.readings.every > 1 else 1
        )
        return far, math.ceil(parts * self._own / far) if contacts else 1

    def parts(
        self, rig: Rig, step_s: float, ratio: int, dampings: Floats, contacts: list[int], bare: bool
    ) -> tuple[Any, dict[str, Any]]:
        """A copy of the model, with its data."""
        import mujoco as mj

        gaps = {} if bare else {j: w for j in self._joints if (w := rig.amount(j, slots.JointPlay, "width"))}
        m = copy.copy(model_of(rig.config, tuple(gaps)))
        unused = mj.mjtDisableBit
        m.opt.disableflags |= unused.mjDSBL_AUTORESET | unused.mjDSBL_SENSOR | unused.mjDSBL_ISLAND
        if not self.readings.as_stepped:
            m.opt.integrator = mj.mjtIntegrator.mjINT_RK4
        m.opt.timestep = step_s
        changed = {t: p.value for t, p in rig.config.parameters.items() if p.value != number_of(self._nominal, t)}
        for title, value in changed.items():
            set_number(m, title, value)
        d = mj.MjData(m)
        if any(title.startswith("bodies.") for title in changed):
            mj.mj_setConst(m, d)
            mj.mj_resetData(m, d)
        at, behind = m.jnt_dofadr[[m.joint(name).id for name in self._joints]], np.full(len(self._joints), -1)
        for name, width in gaps.items():
            gap = m.joint(PLAY_PREFIX + name)
            gap.range[:] = -0.5 * width, 0.5 * width
            m.jnt_solref[gap.id, 0] = FRICTION_STEPS * step_s
            behind[self._joints.index(name)] = gap.dofadr[0]
        m.dof_damping[at] += dampings
        far = copy.copy(m) if ratio > 1 else m
        far.opt.timestep = ratio * step_s
        for joint in at[contacts]:
            m.dof_solref[joint], m.dof_solimp[joint, :2] = (FRICTION_STEPS * step_s, 1.0), FRICTION_IMPEDANCE
        if bare:
            m.dof_frictionloss[:] = 0.0
            m.opt.disableflags |= unused.mjDSBL_CONTACT | unused.mjDSBL_LIMIT
        fields = {
            "q": d.qpos, "v": d.qvel, "more": d.act, "acceleration": d.qacc, "push": d.qfrc_applied,
            "load": d.qfrc_actuator, "ctrl": d.ctrl, "friction": m.dof_frictionloss, "shown": np.zeros(0),
            "clock": np.zeros(1), "at": at.astype(np.int64), "behind": behind,
        }  # fmt: skip
        addresses = {"model": m._address, "far": far._address, "data": d._address}
        return (m, far, d), addresses | functions() | fields


def rate_of(model: Any) -> float:
    """How fast the fastest part of a model decays or turns about its first pose, rad/s."""
    import mujoco as mj

    m = copy.copy(model)
    m.opt.disableflags |= mj.mjtDisableBit.mjDSBL_CONTACT | mj.mjtDisableBit.mjDSBL_LIMIT
    m.opt.integrator, m.dof_frictionloss[:] = mj.mjtIntegrator.mjINT_IMPLICIT, 0.0
    A = np.zeros((2 * m.nv, 2 * m.nv))
    mj.mjd_transitionFD(m, mj.MjData(m), 1e-6, True, A, None, None, None)
    return float(np.abs(np.log(np.linalg.eigvals(A) + 1e-12)).max() / m.opt.timestep)


@functools.cache
def functions() -> dict[str, int]:
    """Addresses of step, forward and reset; MuJoCo's warnings are not printed, as what is not finite is seen here."""
    import mujoco

    folder = Path(mujoco.__file__).parent
    file = next(f for f in folder.iterdir() if re.fullmatch(r"(lib)?mujoco\.(so|dll|[\d.]*dylib).*", f.name))
    library = ctypes.CDLL(str(file))
    ctypes.c_void_p.in_dll(library, "mju_user_warning").value = int(ffi.cast("intptr_t", lib.dtb_ignore))
    named = {"step": library.mj_step, "forward": library.mj_forward, "back": library.mj_resetData}
    return {name: int(ctypes.cast(function, ctypes.c_void_p).value or 0) for name, function in named.items()}
