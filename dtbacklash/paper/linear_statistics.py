"""What is measured on the linear design and on the play: sections 1 to 3.1, Figures 4, 6 and 7."""

import control
import numpy as np

from dtbacklash.control.chain import structure_tf
from dtbacklash.control.design import inner_loop, prefilter, reduced_structure
from dtbacklash.paper.experiments import FORCE_N, PLAY_GAP_DEG, TORQUE_N_M, Experiments


def inner_loop_settling_ms(x: Experiments) -> float:
    """Settling time of the motor's inner loop, 1 % band."""
    t = np.linspace(0.0, 0.1, 20001)
    y = control.step_response(_inner_loop(x), t).outputs
    outside = np.flatnonzero(np.abs(y - 1.0) > 0.01)
    return 1e3 * t[outside[-1] + 1]


def slowest_pole_over_that_of_the_mode(x: Experiments) -> float:
    """Largest real part of a pole of G_ol over that of the dominant mode."""
    open_loop = control.series(_inner_loop(x), control.tf(structure_tf(x.structure)))
    return float(np.max(np.real(open_loop.poles())) / _dominant_pole(x).real)


def _inner_loop(x: Experiments) -> control.TransferFunction:
    return control.tf(inner_loop(x.motor, x.design.k_theta_v_per_rad))


def _dominant_pole(x: Experiments) -> complex:
    """The pole of G2 with the lowest frequency, above the real axis, 1/s."""
    poles = control.tf(structure_tf(x.structure)).poles()
    above = poles[np.imag(poles) > 0]
    return complex(above[np.argmin(np.abs(above))])


def motor_over_reference_at_rest(x: Experiments) -> float:
    """(13): p times the motor's angle over r at the end of Fig. 6."""
    return _motor_at_rest_mm(x) / float(x.runs["fig6"].trace["r_mm"].iloc[-1])


def q3_over_motor_at_rest(x: Experiments) -> float:
    """(14): q3 over p times the motor's angle at the end of Fig. 6."""
    return float(x.q3_mm("fig6")[-1]) / _motor_at_rest_mm(x)


def _motor_at_rest_mm(x: Experiments) -> float:
    return 1e3 * x.structure.pitch_m_per_rad * float(x.runs["fig6"].trace["theta_m_rad"].iloc[-1])


def reduced_feed_through(x: Experiments) -> float:
    return abs(float(np.asarray(reduced_structure(x.structure).D)[0, 0]))


def reduced_frequency_over_omega_d(x: Experiments) -> float:
    poles = reduced_structure(x.structure).poles()
    return float(np.max(np.imag(poles)) / x.design.dominant_frequency_rad_s)


def error_left_by_a_force(x: Experiments) -> float:
    """Error that a constant force on mass 3 leaves, over the stretch of the springs that it causes without feedback."""
    end = x.runs["force"].trace.iloc[-1]
    feedforward_mm = 1e3 * FORCE_N * float(np.sum(1.0 / np.array(x.structure.stiffnesses_n_per_m)))
    return abs(float(end["r_mm"] - end["q3_mm"])) / feedforward_mm


def error_left_by_a_torque(x: Experiments) -> float:
    """Error that a constant torque on the motor leaves, over that of the inner loop without any other feedback."""
    angle = TORQUE_N_M * x.motor.R / (x.motor.k_T * x.design.k_theta_v_per_rad)
    return torque_error_mm(x) / (1e3 * x.structure.pitch_m_per_rad * angle)


def torque_error_mm(x: Experiments) -> float:
    """Distance of q3 from the reference 20 s after a constant torque on the motor begins."""
    end = x.runs["torque"].trace.iloc[-1]
    return abs(float(end["r_mm"] - end["q3_mm"]))


def small_gain_bound(x: Experiments, run: str) -> float:
    """How far the tolerances of the rig's parameters move the loop at most, over its distance from -1."""
    designed = x.runs[run].design
    assert designed is not None
    return designed.margins().small_gain


def share_of_the_mode(x: Experiments) -> float:
    """Share of the power of q3 - r in Fig. 4 that a free decay at the dominant pole explains."""
    trace = x.runs["fig4"].trace
    t, error = trace["t_s"].to_numpy(), (trace["q3_mm"] - trace["r_mm"]).to_numpy()
    decay = np.exp(_dominant_pole(x) * t)
    basis = np.column_stack([decay.real, decay.imag])
    rest = error - basis @ np.linalg.lstsq(basis, error, rcond=None)[0]
    return float(1.0 - np.sum(rest**2) / np.sum(error**2))


def first_slope_mm_per_s(x: Experiments) -> float:
    """Derivative of q3 in the first sample of Fig. 6."""
    return float(x.q3_mm("fig6")[1] / x.runs["fig6"].config.sample_time_s)


def sampling_difference_mm(x: Experiments) -> float:
    """Largest distance in the first 2 s of Fig. 6 from the continuous design, W G_theta G2."""
    config = x.runs["fig6"].config
    filtered = prefilter(x.structure, config.controller.prefilter, config.controller.tau_r_s)
    chain = control.ss(control.series(_inner_loop(x), control.tf(structure_tf(x.structure))))
    t = np.arange(2000) * config.sample_time_s
    designed_mm = np.asarray(control.step_response(control.series(filtered, chain), t).outputs)
    return float(np.abs(x.q3_mm("fig6")[:2000] - designed_mm).max())


def play_difference_deg(x: Experiments) -> float:
    """Largest distance of the play operator from (16) and (17), integrated step by step.

    There the motor's speed passes where it points away from the gap's other side.
    """
    motor = x.play.theta_m_deg
    screw = np.zeros_like(motor)
    for k in range(1, screw.size):
        step = motor[k] - motor[k - 1]
        z = motor[k] - screw[k - 1]
        passes = (step > 0 and z >= PLAY_GAP_DEG) or (step < 0 and z <= -PLAY_GAP_DEG)
        screw[k] = screw[k - 1] + (step if passes else 0.0)
    return float(np.abs(x.play.theta_d_deg - screw).max())


def play_lag_deg(x: Experiments) -> float:
    """Distance of the screw from the motor while both move up, less that while they move down."""
    play = x.play
    z = (play.theta_m_deg - play.theta_d_deg)[1:]
    follows = (play.t_s[1:] > 1.0) & (np.abs(np.diff(play.theta_d_deg)) > 1e-9)
    up = follows & (np.diff(play.theta_m_deg) > 0)
    down = follows & (np.diff(play.theta_m_deg) < 0)
    return float(np.median(z[up]) - np.median(z[down]))


def play_travel_deg(x: Experiments) -> float:
    """How far the motor turns after a reversal before the screw moves again, on average."""
    motor, screw = x.play.theta_m_deg, x.play.theta_d_deg
    turns = np.flatnonzero(np.diff(np.sign(np.diff(motor)))) + 1
    travels = []
    for k in turns[x.play.t_s[turns] > 1.0]:
        moved = np.flatnonzero(np.abs(screw[k:] - screw[k]) > 1e-9)
        travels += [abs(motor[k + moved[0]] - motor[k])] if moved.size else []
    return float(np.mean(travels))
