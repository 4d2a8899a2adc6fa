"""The sampled controllers, compiled: linear IMC, nonlinear IMC, linear laws and open loop, one control step a sample.

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
from typing import NamedTuple

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.compiled import inlined
from dtbacklash.config.run import ControllerConfig
from dtbacklash.control.belief import FeedForward
from dtbacklash.control.design import ControllerDesign
from dtbacklash.control.linear_law import LinearLaw, advance_model, limited, linear_step, output, search_lengths
from dtbacklash.physics.effects.play import play

IMC, NIMC, OPEN_LOOP, LINEAR = 0, 1, 2, 3
BARE, MEASURED, INNER_LOOP, EXACT, INVERSE = 0, 1, 2, 3, 4
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


@inlined
def _late(line, samples, value):
    """The value that was given ``samples`` calls ago, linearly between two; line : the latest values, newest first."""
    if samples <= 0.0:
        return value
    for i in range(line.shape[0] - 1, 0, -1):
        line[i] = line[i - 1]
    line[0] = value
    whole = int(samples)
    share = samples - whole
    return (1.0 - share) * line[whole] + share * line[whole + 1]


@inlined
def _predict(C, X):
    """The predicted output q3^, m, as the sensor shows it at the present sample."""
    return _late(X.lines[2], C.late[2], output(C.sc, X.s))


@inlined
def feed_forward(C, X, theta_m):
    """V against the torques on the motor that are known: those that hang on its angle from the measured one."""
    f = C.forward
    # the model's speed is smooth; an encoder's counts would be differentiated
    speed = X.m[1] if C.model in (BARE, INNER_LOOP, INVERSE) else (theta_m - X.angle[0]) / C.sample_time
    X.angle[0] = theta_m
    return f[3] * speed - f[0] * math.sin(f[1] * theta_m + f[2]) - f[4]


@inlined
def _grow(X, growth):
    """The gap that `inverse` is in grows by ``growth``, rad: nothing moves, so that b stays and its share shrinks."""
    if growth == 0.0:
        return
    before = X.inverse[2]
    X.inverse[2] = max(before + growth, 0.0)
    if X.inverse[2] > 0.0:
        X.inverse[0] = min(max(X.inverse[0] * before / X.inverse[2], -1.0), 1.0)


@inlined
def _reseat(C, X, gap):
    """Move the model of `inverse` to a new estimate of the gap, rad, without a jump of the voltage.

    Where the motor lay in the old gap, as a share of it, it lies in the new one: a tooth that pushed still touches. The
    screw behind it, the structure and theta_ref move by what b gains, as constants, which rings nothing.
    """
    if gap == X.inverse[2]:
        return
    gained = X.inverse[0] * (gap - X.inverse[2])
    X.inverse[2] = gap
    X.theta_d[0] -= gained
    for i in range(X.s.shape[0]):
        X.s[i] -= gained * C.s_rest[i]
    for i in range(X.lines.shape[1]):
        X.lines[2, i] -= gained * output(C.sc, C.s_rest)
    for i in range(X.w.shape[0]):
        X.w[i] -= gained * C.w_rest[i]


@inlined
def _set_out(C, X, gap, toward):
    """b crosses to the side to which the load will move next, before it does."""
    if C.crossing_step > 0.0 and gap > 0.0:
        left = (1.0 - X.inverse[0] * toward) * gap
        X.inverse[0] += toward * min(left, C.crossing_step) / gap


@inlined
def crossing_samples(C, gap):
    """How long before the load moves the motor has to set out, to have crossed the gap by then."""
    return math.ceil(2.0 * gap / C.crossing_step) + C.arriving if C.crossing_step > 0.0 else 0


@inlined
def _held(C, X, r, gap):
    """The reference that is let through, m: while a jump waits for the motor to cross the gap, the one before it.

    The side to which the motor has to go follows from the jump alone, so no feedback of the output passes here. b is
    an angle of the motor, and this is measured: friction keeps a servo from its reference, on the other side when it
    turns round, and the screw would start that much too late.
    """
    jump = r - X.inverse[3]
    if C.crossing_step > 0.0 and gap > SMALL_GAP_RAD and abs(jump) > C.jump:
        side = 1.0 if jump > 0.0 else -1.0
        left = (1.0 - X.inverse[0] * side) * gap
        X.inverse[0] += side * min(left, C.crossing_step) / gap
        if left > C.crossing_step:
            X.inverse[4] = C.arriving + C.patience
            return X.inverse[3]
        if X.inverse[4] > 0.0:
            X.inverse[4] -= 1.0
            if X.inverse[4] > C.patience or (X.inverse[4] > 0.0 and abs(X.servo[2]) > NEAR_RAD):
                return X.inverse[3]
    X.inverse[3], X.inverse[4] = r, 0.0
    return r


@inlined
def _catch_up(C, X, apart):
    """Make up for what keeps the motor from its model while the reference is held. apart : theta_m less theta_m^."""
    if X.inverse[4] == 0.0:  # always, with `inner_loop`
        X.servo[1] = apart
        return
    X.servo[2] = X.servo[1] - apart
    X.servo[0] = min(max(X.servo[0] + C.catching * X.servo[2], -CATCHING_MOST), CATCHING_MOST)


@inlined
def _taken_in(C, X, r, gap, growth, toward):
    """The model of `inverse` takes the present gap; returns the reference that is let through, m."""
    if C.model != INVERSE:
        return r
    _reseat(C, X, gap - growth if gap > 0.0 else 0.0)  # first: what has grown from nothing forgets which tooth pushed
    _grow(X, growth)
    if toward != 0.0:
        _set_out(C, X, gap, toward)
        X.inverse[3], X.inverse[4] = r, 0.0
        return r
    return _held(C, X, r, gap)


@inlined
def _inverse(C, X, r, error, gap):
    """The next inverse of the backlash b, rad. error : theta_ref - theta_d^, rad. gap : estimated half-gap, rad.

    Across the gap the motor's angle is the loop's, not an integral of its error: b alone integrates, and no faster than
    the output can tell whether the gap is there. Only the reference, which no feedback passes, moves it faster.
    """
    ahead = output(C.wc, X.w_r) + C.wd * r
    advance_model(C.wa, C.wb, r, X.w_r, X.spare)
    moved = C.crossing_ratio * (ahead - X.inverse[1]) + C.crossing_rate * C.sample_time * error
    if X.inverse[4] == 0.0:  # else it is on its way, or waits there
        X.inverse[0] = min(max(X.inverse[0] + moved / max(gap, SMALL_GAP_RAD), -1.0), 1.0)
    X.inverse[1] = ahead
    return X.inverse[0] * gap


@inlined
def control_step(C, X, r, theta_m, q3, gap_hat, growth=0.0, toward=0.0):
    """One sample of the controller: measurements in, voltage and prediction error out; its states move on.

    What is fed forward is added to the voltage behind the internal model, which does not know of the torques that it
    cancels.

    Parameters
    ----------
    r, q3 : m (in open loop r is the command itself, V). theta_m : rad. gap_hat : estimated half-gap, rad.
    growth : by how much of it the gap has grown since the sample before, rad; the rest of its change is a new estimate.
    toward : the side, -1 or 1, to which the load moves :func:`crossing_samples` from now, where that is known.
    """
    if C.structure == OPEN_LOOP:
        return r, 0.0
    gap = gap_hat if C.structure == NIMC else 0.0
    forward = feed_forward(C, X, theta_m) if C.forwards else 0.0
    if C.structure == LINEAR:
        return linear_step(C, X, r, theta_m, q3, forward), 0.0
    r = _taken_in(C, X, r, gap, growth, toward)
    eps = q3 - _predict(C, X)
    error = r - eps
    theta_ref = output(C.wc, X.w) + C.wd * error
    advance_model(C.wa, C.wb, error, X.w, X.spare)
    if C.model == EXACT:
        u = limited(C, C.gain * (theta_ref - theta_m) + forward)
        advance_model(C.sa, C.sb, _late(X.lines[0], C.late[0], u - forward), X.s, X.spare)
        return u, eps
    if C.model == BARE:
        theta_d = X.theta_d[0] if C.structure == NIMC else X.m[2]
    elif C.model == MEASURED:
        X.theta_d[0] = play(X.theta_d[0], theta_m, gap)
        theta_d = X.theta_d[0]
    else:
        X.theta_d[0] = play(X.theta_d[0], X.m[2], gap)
        theta_d = X.theta_d[0]
    feedback = theta_m
    if C.model == INVERSE:
        feedback = theta_m - _inverse(C, X, r, theta_ref - theta_d, gap) - X.servo[0]
    elif C.structure == NIMC:
        # the inner loop acts on the screw's angle; the complete model has its own, so the loop takes the measured one
        X.theta_d[1] = play(X.theta_d[1], theta_m, gap)
        feedback = X.theta_d[1] if C.model == INNER_LOOP else theta_d
    u = limited(C, C.gain * (theta_ref - feedback) + forward)
    advance_model(C.sa, C.sb, theta_d, X.s, X.spare)
    if C.model == BARE:
        if C.structure == NIMC:  # Eqs (16)-(17) with the sampled sG1's speed, integrated forward
            z, omega = theta_m - X.theta_d[0], X.m[1]
            if (omega > 0.0 and z >= gap) or (omega < 0.0 and z <= -gap):
                X.theta_d[0] += omega * C.sample_time
        advance_model(C.ma, C.mb, _late(X.lines[0], C.late[0], u - forward), X.m, X.spare)
    elif C.model in (INNER_LOOP, INVERSE):
        ahead, own = (X.inverse[0] * gap, X.m[2]) if C.model == INVERSE else (0.0, theta_d)
        own = _late(X.lines[1], C.late[1], own)
        _catch_up(C, X, theta_m - own)
        own_u = limited(C, C.gain * (theta_ref + ahead - own))
        advance_model(C.ma, C.mb, _late(X.lines[0], C.late[0], own_u), X.m, X.spare)
    return u, eps
