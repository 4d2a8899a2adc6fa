"""The sampled controllers: linear IMC, nonlinear IMC, linear laws and open loop, one control step a sample.

Block diagrams: the paper's Figures 3 (IMC) and 9 (NIMC). The prediction error ``eps = q3 - q3^`` is taken from the
reference, the prefilter W turns the rest into ``theta_ref``, and the inner loop sets the voltage:

- IMC:  ``u = K_theta (theta_ref - theta_m)``.
- NIMC: ``u = K_theta (theta_ref - theta_d^)``, with ``theta_d^`` behind a model of the backlash.

What drives the model of the structure is ``controller.internal_model``:

- ``bare``: the paper's. The motor's model G1 is driven by u; for NIMC, its motion passes the gap's model, which takes
  its distance to the contact from the measured motor angle (``z = theta_m - theta_d^``).
- ``measured``: the measured motor angle; no integrator that could drift.
- ``exact`` (IMC only): G1 G2 sampled as one, driven by u; without gap and effects its error is zero to rounding, the
  paper's "perfect sampled-data model" of Figures 4 and 6. The other forms sample G1 and G2 apart, each with a hold.
- ``inner_loop``: a complete model of the inner loop, with its own feedback, driven by theta_ref.
- ``inverse``: the same, and for NIMC the inner loop acts on the motor's angle throughout,
  ``u = K_theta (theta_ref + b - theta_m)``. The inverse of the backlash, b with |b| <= gap, moves by CROSSING_RATIO
  times what the prefilter makes of the reference alone, and by (theta_ref - theta_d^)/tau_r a second. What comes back
  by the prediction error crosses the gap that slowly only; see docs/theory.md. With ``controller.crossing=hold`` a
  reference that jumps is held back until b has brought the motor to the other side of the gap.
- ``auto`` stands for one of them until it is known what is believed of the rig (:func:`.belief.settled`).

What is known of the machine is in the model as well: the voltage is limited as the amplifier limits it, and delays of
the command and of both sensors pass lines of the same length. All others are a :class:`.linear_law.LinearLaw`.
"""

import math
from dataclasses import astuple
from typing import Any, NamedTuple

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.run import ControllerConfig
from dtbacklash.control.belief import FeedForward
from dtbacklash.control.design import ControllerDesign
from dtbacklash.control.linear_law import FOUND_V, SEARCH_STEPS, LinearLaw, search_lengths
from dtbacklash.core.library import buffer, lib, struct

IMC, NIMC, OPEN_LOOP, LINEAR = lib.IMC, lib.NIMC, lib.OPEN_LOOP, lib.LINEAR
BARE, MEASURED, INNER_LOOP, EXACT, INVERSE = lib.BARE, lib.MEASURED, lib.INNER_LOOP, lib.EXACT, lib.INVERSE
_STRUCTURES = {"imc": IMC, "nimc": NIMC, "open_loop": OPEN_LOOP}  # all others are linear
_MODELS = {"bare": BARE, "measured": MEASURED, "inner_loop": INNER_LOOP, "exact": EXACT, "inverse": INVERSE}
#: how far the inverse of the backlash moves for each radian that the reference asks of the screw: at 1 the gap is
#: crossed too late, at 10 an estimate that is too large overshoots most (``python -m studies nimc_forms``)
CROSSING_RATIO = 3.0
#: a gap below this, rad, is crossed as if it were this large: with no gap, too, the side that pushed is known. A
#: reference that moves the screw by less than this in a sample does not jump
SMALL_GAP_RAD = 0.01
#: a held reference is let go when this share of the voltage that crosses the gap is left: the motor has all but arrived
ARRIVED = 0.15
#: and when the measured motor is this near to where its model is, rad, or after PATIENCE times as many samples more.
#: What keeps it away (friction) is made up for at CATCHING times the rate of the servo, by CATCHING_MOST rad at most
NEAR_RAD, PATIENCE, CATCHING, CATCHING_MOST = 0.01, 4, 0.5, 0.5


class Controller(NamedTuple):
    """A designed controller: sampled models (A, B, C, D), the gain of the inner loop, V/rad, and its form.

    forward : (5,) amplitude V, waves a radian, phase, V s/rad, V: see :class:`.belief.FeedForward`; ``forwards`` :
    whether there is any.
    crossing_ratio, crossing_rate : of the inverse of the backlash, rad/rad and 1/s, to the reference and to the error.
    w_rest, s_rest : states of the prefilter and of the structure at rest, for one rad of the screw.
    crossing_step : rad a sample by which b crosses while the reference is held back; 0: it is never. arriving,
    patience : samples that the motor takes to follow b to its end, and for which it is waited for beyond them.
    catching : share of what keeps the motor from its model that is made up for in a sample.
    jump : m, a change of the reference that is no jump.
    limit : V, of the voltage. late : (3,) samples by which command, measured angle and measured output come late.
    la, lb, lc, ld, le, lh, lf : the matrices of a :class:`.linear_law.LinearLaw`; search : (2,) length of a
    step towards its moves, and momentum.
    """

    structure: int
    model: int
    gain: float
    wa: Floats
    wb: Floats
    wc: Floats
    wd: float
    ma: Floats
    mb: Floats
    sa: Floats
    sb: Floats
    sc: Floats
    sample_time: float
    forwards: bool
    forward: Floats
    crossing_ratio: float
    crossing_rate: float
    w_rest: Floats
    s_rest: Floats
    crossing_step: float
    arriving: int
    patience: int
    catching: float
    jump: float
    limit: float
    late: Floats
    la: Floats
    lb: Floats
    lc: Floats
    ld: Floats
    le: Floats
    lh: Floats
    lf: Floats
    search: Floats


class ControllerState(NamedTuple):
    """States of the controller: prefilter, motor model (i, omega, theta), structure model, two theta_d^, a spare, ...

    theta_d : (2,) the screw behind the model's motor (or, with `measured`, behind the measured one), and the screw
        behind the measured motor, on which the loop acts with `inner_loop`. angle : (1,) the measured angle before.
    w_r : the prefilter, driven by the reference alone. inverse : (5,) the inverse of the backlash as a share
        of the gap, W r, the gap that the model is in, rad, the reference that is let through, m, and the samples for
        which the next one is held back after b has arrived. servo : (3,) rad, what the inner loop is given beside b
        against what keeps the motor from its model while the reference is held; how far the motor was apart from its
        model before; and how much farther it is now. lines : (3, n) what is on its way through the delays of
        the model, the latest first. law : (n,) of a linear law. moves : (2, m) of a predictive one,
        V: the last ones, and with the momentum.
    """

    w: Floats
    m: Floats
    s: Floats
    theta_d: Floats
    spare: Floats
    angle: Floats
    w_r: Floats
    inverse: Floats
    servo: Floats
    lines: Floats
    law: Floats
    moves: Floats


def build_controller(
    config: ControllerConfig, design: ControllerDesign | None, forward: FeedForward | None = None
) -> Controller:
    """Arrays of the compiled controller; ``design`` may be None in open loop. forward : None for none."""
    known = np.array(astuple(forward or FeedForward()))
    limit = math.inf if config.limit_v is None else config.limit_v
    law = (design.law if design else None) or LinearLaw(*(np.zeros(n) for n in ((0, 0), (0, 3), 0, 3, 0)))
    laws = law.A, law.B, law.C, law.D, law.E, law.H, law.F, search_lengths(law.H)
    structure, model = _STRUCTURES.get(config.structure, LINEAR), _MODELS[config.internal_model]
    if design is None:
        none, row = np.zeros((0, 0)), np.zeros(0)
        return Controller(structure, model, 0.0, none, row, row, 0.0, np.zeros((3, 3)), np.zeros(3), none, row,
                          row, 1.0, False, known, 0.0, 0.0, row, row, 0.0, 0, 0, 0.0, 0.0, math.inf, np.zeros(3),
                          *laws)  # fmt: skip
    W, M = design.prefilter, design.motor_position
    S = design.plant if model == EXACT else design.structure
    flat = [np.ascontiguousarray(a, dtype=float).ravel() for a in (W.B, W.C, M.B, S.B, S.C)]
    wb, wc, mb, sb, sc = flat
    s_rest = np.linalg.solve(np.eye(len(sb)) - S.A, sb) if model == INVERSE else np.zeros(len(sb))
    w_rest = np.linalg.solve(np.eye(len(wb)) - W.A, wb) * float(sc @ s_rest)
    step, arriving, catching = 0.0, 0, 0.0
    if model == INVERSE and config.crossing == "hold":
        # rad a sample for each volt, at a steady speed; the servo's lag is the inverse of what its gain makes of that
        speed = float(np.linalg.solve(np.eye(2) - M.A[:2, :2], mb[:2])[1]) * design.sample_time_s
        step = min(config.crossing_v, limit) * speed
        servo = design.k_theta_v_per_rad * speed
        arriving, catching = math.ceil(-math.log(ARRIVED) / servo), CATCHING * servo
    return Controller(
        structure, model, design.k_theta_v_per_rad, W.A, wb, wc, float(W.D[0, 0]), M.A, mb, S.A, sb, sc,
        design.sample_time_s, bool(np.any(known)), known, CROSSING_RATIO, 1.0 / config.tau_r_s, w_rest, s_rest,
        step, arriving, PATIENCE * arriving, catching, SMALL_GAP_RAD * float(sc @ s_rest), limit,
        np.array(design.delays_s) / design.sample_time_s, *laws,
    )  # fmt: skip


def new_controller_state(controller: Controller) -> ControllerState:
    """The controller at rest."""
    sizes = len(controller.wb), len(controller.mb), len(controller.sb)
    w, m, s = (np.zeros(n) for n in sizes)
    law, lines = np.zeros(len(controller.lc)), np.zeros((3, math.ceil(controller.late.max()) + 2))
    spare = np.zeros(max(*sizes, law.size, 2 * len(controller.lh), 1))
    return ControllerState(w, m, s, np.zeros(2), spare, np.zeros(1), w.copy(), np.zeros(5), np.zeros(3), lines, law,
                           np.zeros((2, len(controller.lh))))  # fmt: skip


def law_fields(C: Controller) -> dict[str, Any]:
    """The fields of a controller in the core's struct of that name."""
    sizes = {"n_w": len(C.wb), "n_m": len(C.mb), "n_s": len(C.sb), "n_law": len(C.lc), "n_moves": len(C.lh)}
    constants = {
        "small_gap": SMALL_GAP_RAD, "near": NEAR_RAD, "catching_most": CATCHING_MOST, "search_steps": SEARCH_STEPS,
        "found": FOUND_V,
    }  # fmt: skip
    return C._asdict() | sizes | constants


def controller_struct(C: Controller) -> Any:
    """A controller as the core takes it."""
    return struct("Controller", **law_fields(C))


def controller_state_struct(X: ControllerState) -> Any:
    """The state of a controller as the core takes it."""
    return struct("ControllerState", **X._asdict(), delay=X.lines.shape[1])


def control_step(
    C: Controller, X: ControllerState, r: float, theta_m: float, q3: float, gap_hat: float, growth: float = 0.0,
    toward: float = 0.0,
) -> tuple[float, float]:  # fmt: skip
    """One sample of the controller: measurements in, voltage and prediction error out; its states move on.

    What is fed forward is added to the voltage behind the internal model, which does not know of the torques that it
    cancels.

    Parameters
    ----------
    r, q3 : m (in open loop r is the command itself, V). theta_m : rad. gap_hat : estimated half-gap, rad.
    growth : by how much of it the gap has grown since the sample before, rad; the rest of its change is a new estimate.
    toward : the side, -1 or 1, to which the load moves :func:`crossing_samples` from now, where that is known.
    """
    out, given = np.empty(2), (r, theta_m, q3, gap_hat, growth, toward)
    lib.dtb_control_step(controller_struct(C), controller_state_struct(X), *map(float, given), buffer(out))
    return float(out[0]), float(out[1])


def feed_forward(C: Controller, X: ControllerState, theta_m: float) -> float:
    """V against the torques on the motor that are known: those that hang on its angle from the measured one."""
    return float(lib.dtb_feed_forward(controller_struct(C), controller_state_struct(X), theta_m))


def crossing_samples(C: Controller, gap: float) -> int:
    """How long before the load moves the motor has to set out, to have crossed the gap by then."""
    return int(lib.dtb_crossing_samples(controller_struct(C), gap))
