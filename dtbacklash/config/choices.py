"""What a setting may be chosen from, and what each choice means: the schema's checks and the reports' words read the
same entry, so that none of them can lack one.

A meaning is a template: ``{name}`` stands for the setting of that name beside it, ``{unit}`` for the unit of the
reference (mm, or V where there is no loop).
"""

from __future__ import annotations

STRUCTURES = {
    "imc": "linear internal model control: its model knows no backlash",
    "nimc": "nonlinear internal model control: its model contains the backlash",
    "open_loop": "no controller: the command drives the rig's input itself",
}
TRIGGERS = {
    "never": "never",
    "reference_change": "after each change of the reference",
    "novelty": "whenever the novelty index exceeds {novelty_threshold_mm} mm",
}
PREFILTERS = {
    "reduced": "prefilter with a time constant of {tau_r_s} s",
    "none": "no dynamical prefilter",
}
INTERNAL_MODELS = {
    "bare": "the internal model is driven by the voltage (the paper's form)",
    "measured": "the internal model is driven by the measured motor angle",
    "inner_loop": "the internal model is that of the closed inner loop",
    "inverse": "the internal model is that of the closed inner loop with an inverse of the backlash",
    "exact": "the internal model is motor and structure, sampled as one",
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
    "csv": "read from {path}",
}
INTERPOLATIONS = {
    "hold": "each value holds until the next",
    "linear": "straight between its rows",
}
NOVELTY_FILTERS = {
    "cheby2": "third-order Chebyshev II low-pass, 40 dB from the dominant mode's frequency on",
    "ellip": "third-order elliptic low-pass, its edge at half the dominant mode's frequency",
}
OPTIMIZERS = {
    "bfgs": "BFGS with exact derivatives",
    "lbfgsb": "L-BFGS-B, BFGS within bounds",
    "nelder_mead": "Nelder and Mead's simplex",
    "differential_evolution": "differential evolution",
    "dual_annealing": "dual annealing",
}
