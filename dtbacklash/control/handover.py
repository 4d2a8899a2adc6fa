"""From one controller to another while the loop is at rest: the voltage does not jump.

A controller that is designed for another model, or has a model of another form, has other states. At rest they are
decided by what is there: the measured angle and output, the reference, and the voltage that holds the motor. The new
controller's states are those of its own rest with the same voltage: its prefilter asks for the screw's angle from which
the inner loop gives that voltage, its model of the structure rests where the prediction error asks the prefilter for
just that angle, and its motor lies in the gap where the old one's did, as a share of the gap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.control.laws import (
    BARE,
    EXACT,
    INNER_LOOP,
    INVERSE,
    MEASURED,
    NIMC,
    Controller,
    ControllerState,
    new_controller_state,
)


@dataclass(frozen=True)
class Rest:
    """The loop at rest: reference m, measured angle rad, measured output m, voltage V, as means over a while.

    old_gap_rad, gap_rad : the half-gaps in force before and after.
    """

    reference: float
    theta_m: float
    q3: float
    u: float
    old_gap_rad: float
    gap_rad: float


def handed_over(before: Controller, state: ControllerState, after: Controller, rest: Rest) -> ControllerState:
    """States of the controller ``after`` (structure ``nimc``), at rest as ``before`` is in ``state``.

    Raises
    ------
    ValueError : ``after`` is no controller with a model of the gap.
    """
    if after.structure != NIMC:
        raise ValueError("only a controller with a model of the gap is reconfigured")
    new = new_controller_state(after)
    side = _side(before, state, rest)
    behind = rest.theta_m - side * rest.gap_rad
    wave, waves, phase, _, load = after.forward
    forward = -wave * math.sin(waves * rest.theta_m + phase) - load if after.forwards else 0.0
    error = (rest.u - forward) / after.gain  # theta_ref less what the inner loop feeds back
    w_unit, s_unit, _ = rests(after)
    gain = float(after.sc @ s_unit)
    theta_ref = behind + error
    if after.model in (INNER_LOOP, INVERSE):
        screw = theta_ref - (rest.reference - rest.q3) / gain
        new.m[2] = (screw if after.model == INNER_LOOP else theta_ref) + side * rest.gap_rad
    else:  # the inner loop acts on the model's own screw
        screw = behind
        if after.model == BARE and before.model == BARE:
            new.m[:] = state.m
    new.theta_d[:] = screw, behind
    new.s[:] = s_unit * screw
    asked = rest.reference - rest.q3 + gain * screw
    new.w[:] = w_unit * (theta_ref - after.wd * asked) / float(after.wc @ w_unit)
    new.w_r[:] = w_unit * rest.reference
    ahead = float(after.wc @ new.w_r) + after.wd * rest.reference
    new.inverse[:] = side, ahead, rest.gap_rad, rest.reference, 0.0
    new.angle[0] = rest.theta_m
    new.lines[1] = new.m[2] if after.model == INVERSE else screw
    new.lines[2] = gain * screw
    return new


def rests(C: Controller) -> tuple[Floats, Floats, Floats]:
    """States at rest: of the prefilter for 1 m, of the structure's model for 1 rad of the screw, and of a linear law.

    The last (n, 2) is for the measured angle and output, with the output as the reference and no voltage.
    """
    w_unit = np.asarray(np.linalg.solve(np.eye(C.wb.size) - C.wa, C.wb), np.float64)
    if C.model == EXACT and C.sb.size:  # driven by the voltage: what stays is the null space
        s_unit = np.asarray(np.linalg.svd(C.sa - np.eye(C.sb.size))[2][-1], np.float64)
        s_unit /= float(C.sc @ s_unit) * (float(C.wc @ w_unit) + C.wd)
    else:
        s_unit = np.asarray(np.linalg.solve(np.eye(C.sb.size) - C.sa, C.sb), np.float64)
    n = C.lc.size
    rows = np.vstack([C.la - np.eye(n), C.lc])
    seen = -np.vstack([C.lb, C.ld]) @ [[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]
    scale = np.maximum(np.abs(rows).max(axis=0, initial=1e-300), 1e-300)
    found = np.asarray(np.linalg.lstsq(rows / scale, seen, rcond=1e-14)[0] / scale[:, None], np.float64)
    return w_unit, s_unit, found


def _side(before: Controller, state: ControllerState, rest: Rest) -> float:
    """Where the motor lies in its gap, from -1 to 1."""
    if before.model == INVERSE:
        return float(state.inverse[0])
    # these forms have a screw of their own; the others that which the measured angle moves
    screw = state.theta_d[0] if before.model in (BARE, MEASURED) else state.theta_d[1]
    if rest.old_gap_rad <= 0.0:
        return 0.0
    return float(min(max((rest.theta_m - screw) / rest.old_gap_rad, -1.0), 1.0))
