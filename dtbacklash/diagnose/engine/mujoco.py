"""A MuJoCo model as a simulator that a predictor can ask.

Between two readings the model takes its own steps, contacts and limits as they are, by the Runge-Kutta method: a
semi-implicit step shows positions half a step too early, which a predictor takes for late sensors; it is taken where
readings are ``as_stepped``. Dry friction is MuJoCo's own (``frictionloss``), as hard as its step allows.
"""

import copy
import ctypes
import functools
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from numba import cfunc, types

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.engine.modelled import Modelled, Parts
from dtbacklash.diagnose.engine.readings import Readings
from dtbacklash.physics.mjcf import (
    ACTUATOR_PREFIX,
    FRICTION_IMPEDANCE,
    FRICTION_STEPS,
    model_of,
    number_of,
    set_number,
    steps_of,
)
from dtbacklash.physics.rig import Rig

#: without dry friction the Runge-Kutta method needs no more than a step for so many of the model's, or so many parts of
#: one where that matters
ROUGH, FINE = 2, 2


class Stepped(Modelled):
    """A MuJoCo model on one stretch of a recording.

    Raises UserError where the model's step is no divisor of a sample.
    """

    def __init__(self, readings: Readings, rig: Rig, finely: bool = False) -> None:
        super().__init__(readings, rig, finely)
        self._nominal = m = model_of(rig.config)
        self._own = steps_of(m, rig.config.model, readings.sample_time_s / readings.every)
        self.commands = tuple(ACTUATOR_PREFIX + m.actuator(a).name for a in range(m.nu))

    def steps(self, bare: bool, laws: bool, contacts: bool) -> int:
        """The model's own, fewer where nothing is hard."""
        if self.readings.as_stepped:
            return self._own
        return FINE * self._own if self.finely else self._own if contacts else max(math.ceil(self._own / ROUGH), 1)

    def parts(self, rig: Rig, step_s: float, dampings: Floats, contacts: list[int], bare: bool) -> Parts:
        """A copy of the model, with its data."""
        import mujoco as mj

        m = copy.copy(self._nominal)
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
        m.dof_damping += dampings
        for joint in contacts:
            m.dof_solref[joint], m.dof_solimp[joint, :2] = (FRICTION_STEPS * step_s, 1.0), FRICTION_IMPEDANCE
        if bare:
            m.dof_frictionloss[:] = 0.0
            m.opt.disableflags |= unused.mjDSBL_CONTACT | unused.mjDSBL_LIMIT
        return Parts(
            (m, d), *functions(), m._address, d._address, d.qpos, d.qvel, d.act, d.qacc, d.qfrc_applied,
            d.qfrc_actuator, d.ctrl, m.dof_frictionloss, np.zeros(0), np.zeros(1),
        )  # fmt: skip


@cfunc(types.void(types.voidptr))  # type: ignore[untyped-decorator]
def _quiet(text: Any) -> None:
    pass


@functools.cache
def functions() -> tuple[int, int, int]:
    """Addresses of step, forward and reset; MuJoCo's warnings are not printed, as what is not finite is seen here."""
    import mujoco

    folder = Path(mujoco.__file__).parent
    file = next(f for f in folder.iterdir() if re.fullmatch(r"(lib)?mujoco\.(so|dll|[\d.]*dylib).*", f.name))
    library = ctypes.CDLL(str(file))
    ctypes.c_void_p.in_dll(library, "mju_user_warning").value = _quiet.address
    found = (library.mj_step, library.mj_forward, library.mj_resetData)
    step, forward, back = (int(ctypes.cast(f, ctypes.c_void_p).value or 0) for f in found)
    return step, forward, back
