"""What a setting may be chosen from, and what each choice means: the schema's checks and the reports' words read the
same entry, so that none of them can lack one.

A meaning is a template: ``{name}`` stands for the setting of that name beside it, ``{unit}`` for the unit of the
reference (mm, or V where there is no loop).
"""

from __future__ import annotations

STRUCTURES = {
    "imc": "linear internal model control: its model knows no backlash",
    "nimc": "nonlinear internal model control: its model contains the backlash",
    "pid": "a PID controller of the output over the motor's inner loop, beside the prefilter: two degrees of freedom",
    "lqg": "LQG control: a Kalman filter of motor and structure, and LQ feedback with an integral of the error",
    "offset": "an observer with the offset between motor and screw and a load as states, and feedback of its state",
    "mpc": "model predictive control: a quadratic program a sample, whose bound is the limit of the voltage",
    "state_space": "a linear law of reference, motor's angle and output, from {file}",
    "open_loop": "no controller: the command drives the rig's input itself",
}
TRIGGERS = {
    "never": "never",
    "reference_change": "after each change of the reference",
    "novelty": "whenever the novelty index exceeds {novelty_threshold_mm} mm",
}
PREFILTERS = {"reduced": "prefilter with a time constant of {tau_r_s} s", "none": "no dynamical prefilter"}
INTERNAL_MODELS = {
    "auto": "a complete model of the inner loop, with an inverse of the backlash where one is in the model",
    "bare": "the internal model is driven by the voltage (the paper's form)",
    "measured": "the internal model is driven by the measured motor angle",
    "inner_loop": "the internal model is that of the closed inner loop",
    "inverse": "the internal model is that of the closed inner loop with an inverse of the backlash",
    "exact": "the internal model is motor and structure, sampled as one",
}
CROSSINGS = {
    "hold": "a reference that jumps is held back until the motor has crossed the gap, at {crossing_v} V; before a "
    "trajectory sets out the motor has crossed it",
    "run": "the reference goes on while the motor crosses the gap",
}
BELIEFS = {"model": "the rig of `model=`", "nominal": "the rig's own parameters, without effects"}
TWIN_METHODS = {
    "auto": "simulate where the model has effects behind the gear, else linear",
    "linear": "the twin filters what was measured through the structure's linear observer (the paper's form)",
    "simulate": "the twin simulates the structure with all effects of its model",
}
ON_ALARM = {
    "estimate": "the gap is estimated (the paper's twin)",
    "bank": "a bank of hypotheses says what has changed, and gap, model and design change together, at rest",
}
TWIN_PLACES = {
    "local": "the twin works in the run's own process",
    "remote": "the twin works elsewhere, over the broker at {broker}",
}
INDEXES = {
    "frequency": "the frequency of the dominant mode in the prediction error over the believed one: the structure",
    "motor": "the torque that the motor's model does not explain, rms: the motor",
    "structure": "the output error of the structure's observer with the gap in force, rms: the gap or the structure",
}
TASKS = {"run": "one run", "close_the_loop": "record, diagnose, and run with what was found"}
#: what the command of a recording does between two samples
COMMANDS = {
    "held": "each value holds until the next sample, as a controller's does",
    "band_limited": "a generator's filter makes it smooth",
    "none": "nothing was commanded: the machine was pushed, or let go (a free decay)",
}
#: how much `dtb diagnose` looks for
SEARCHES = {
    "full": "everything that is missing, each name against its rivals",
    "quick": "what is large, in a fraction of the time; no name is sure",
    "none": "nothing: the rig is calibrated as it is, with intervals, correlations and blind directions",
}
PACES = {
    "free": "as fast as it goes",
    "real": "in real time against the wall clock, with the twin in a process of its own",
}
COMPENSATED = {
    "cogging": "the ripple of the motor's torque over its angle",
    "viscous_friction": "viscous friction at the motor",
    "constant_load": "a constant torque on the motor",
}
PROFILES = {
    "s_curve": "grows from {start_deg}° to {end_deg}° along an S-curve between {t_start_s} and {t_end_s} s",
    "constant": "{start_deg}° throughout",
    "ramp": "grows evenly from {start_deg}° to {end_deg}° between {t_start_s} and {t_end_s} s",
    "step": "jumps from {start_deg}° to {end_deg}° at {t_start_s} s",
    "wear": "wears from {start_deg}° to {end_deg}° between {t_start_s} and {t_end_s} s: running in, steady, severe",
    "csv": "read from {path}",
}
REFERENCES = {
    "square": "square wave of ±{amplitude_mm} {unit}, period {period_s} s",
    "step": "one step of {amplitude_mm} {unit} at {t_start_s} s",
    "staircase": "staircase: {levels} steps of {step_mm} {unit} up and down, {dwell_s} s on each",
    "multisine": "multisine of {rms_mm} {unit} rms, {f_min_hz} to {f_max_hz} Hz",
    "trajectory": "moves of least jerk between ±{amplitude_mm} {unit}, {move_s} s each, or a file's points",
    "csv": "read from {path}",
}
INTERPOLATIONS = {"hold": "each value holds until the next", "linear": "straight between its rows"}
NOVELTY_FILTERS = {
    "ellip": "third-order elliptic low-pass, 3 dB at half the dominant mode's frequency and 40 dB at it (the paper's)",
    "cheby2": "third-order Chebyshev II low-pass, 40 dB from the dominant mode's frequency on",
}
OPTIMIZERS = {
    "bfgs": "BFGS with exact derivatives",
    "lbfgsb": "L-BFGS-B, BFGS within bounds",
    "nelder_mead": "Nelder and Mead's simplex",
    "differential_evolution": "differential evolution",
    "dual_annealing": "dual annealing",
}
