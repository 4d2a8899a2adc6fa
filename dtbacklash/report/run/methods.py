"""How a run was made, in sentences with their sources: those that apply to its configuration, and no others."""

from __future__ import annotations

from dtbacklash.config.choices import NOVELTY_FILTERS, OPTIMIZERS
from dtbacklash.config.run import RunConfig
from dtbacklash.physics.catalogue import find
from dtbacklash.report.components.intervals import interval
from dtbacklash.report.components.numbers import number
from dtbacklash.report.components.page import INTEGRATOR, PAPER
from dtbacklash.report.run.words import has_gear, is_open

#: structure -> how it is made
RIVALS = {
    "pid": "The controller is a PID with two degrees of freedom over a proportional loop of the motor: the prefilter "
    "leads the motor, and the PID works on what the output lacks of the motion along it. Its slowest pole decays as "
    "fast as a largest sensitivity of 2 allows (Astrom and Hagglund, Advanced PID Control, 2006).",
    "offset": "The controller is a Kalman filter of motor and structure with the offset between motor and screw and "
    "the voltage that a load eats as states, and linear-quadratic feedback of what differs from the motion along the "
    "prefilter; the weights follow Bryson's rule (Bryson and Ho, Applied Optimal Control, 1975).",
    "lqg": "The controller is a Kalman filter of motor and structure with linear-quadratic feedback of its state and "
    "of the integral of the error; the weights follow Bryson's rule (Bryson and Ho, Applied Optimal Control, 1975).",
    "mpc": "The controller is a model predictive one: a Kalman filter of motor, structure and an offset between them, "
    "and in each sample the moves of the voltage within its limit that cost least, by a projected fast gradient method "
    "(Richter, Jones and Morari, IEEE Trans. Autom. Control 57, 2012); the weights follow Bryson's rule.",
}


def methods(config: RunConfig) -> list[str]:
    """The paragraphs, in the order to be read."""
    found = [_simulation(config)]
    if not is_open(config):
        found.append(_controller(config))
    if config.controller.reconfigure != "never":
        found.append(_twin(config))
    if not is_open(config):
        found.append(
            "Overshoot and settling time refer to the size of the move. The paper states no settling band; 1 % is the "
            "one under which its own settling times come out."
        )
    readings = _readings(config)
    if readings:
        found.append("Where the paper leaves a choice, it is read so: " + "; ".join(readings) + ".")
    return found


def _simulation(config: RunConfig) -> str:
    tick = config.sample_time_s / 2**config.solver.event_levels
    parts = [
        f"Between events the rig is linear and is stepped exactly, by an exponential integrator ({INTEGRATOR}). The "
        "forces of its effects enter by a predictor and a corrector of second order; a contact of gear or friction is "
        f"located within a sample to {interval(tick, None, 's')}."
    ]
    if has_gear(config.rig):
        parts.append(
            f"The gear is a play operator ({PAPER}, Section 3.1): the screw rests while the motor crosses the gap, "
            "and the gap is its half-width."
        )
    sources = _sources(config)
    if sources:
        parts.append("Laws of the effects: " + "; ".join(sources) + ".")
    return " ".join(parts)


def _sources(config: RunConfig) -> list[str]:
    """Effect and source, for each effect of the rig that does something."""
    found = []
    for location, effects in config.rig.effects.items():
        kind = "sensor" if location.startswith("sensor_") else config.rig.elements[location]["kind"]
        for name, values in effects.items():
            key = f"rig.effects.{location}.{name}"
            effect = find(kind, name, key)
            if not effect.is_neutral(effect.complete(values, key)):
                found.append(f"{name.replace('_', ' ')}, {effect.source}")
    return list(dict.fromkeys(found))


def _controller(config: RunConfig) -> str:
    c = config.controller
    sampled = f"sampled every {number(1e3 * config.sample_time_s)} ms"
    if c.structure == "state_space":
        return f"The controller is a linear law from a file, {sampled}."
    if c.structure in RIVALS:
        return f"{RIVALS[c.structure]} It is designed from the rig's nominal parameters and {sampled}."
    text = (
        f"The controller is that of {PAPER}, Section 2.2: an internal model runs beside the rig, its prediction error"
    )
    text += " is taken from the reference, and a prefilter makes a motor angle of the rest"
    if c.prefilter == "reduced":
        text += (
            "; the prefilter inverts the dominant mode of the structure and adds a lag of "
            f"{number(c.tau_r_s)} s (its Eq. 15)"
        )
    if c.structure == "nimc":
        gap, where = ("estimated", "Section 3.3") if c.reconfigure == "never" else ("twin's", "Sections 3.3 and 4")
        text += f". The inner loop is closed over the screw, which a play with the {gap} gap gives (its {where})"
    return f"{text}. It is designed from the rig's nominal parameters and {sampled}."


def _twin(config: RunConfig) -> str:
    t = config.twin
    parts = [
        f"The twin simulates {t.buffer} samples of motor angle and output with a trial gap, through an observer whose "
        f"poles lie at {number(-t.observer_pole_rad_s)} rad/s, and takes the gap with the least mean square of the "
        f"output error after the first {t.settle} samples ({PAPER}, Eq. 18), by {OPTIMIZERS[config.optimizer.name]}."
    ]
    if t.guard:
        parts.append(
            "An estimate gets a standard error that holds what may be wrong in the model. It reaches the controller, "
            "less that error, if it lies within bounds, converged, stands in the only valley of the cost, and differs "
            "clearly from the present gap, or confirms it; this guard is not the paper's."
        )
    if config.controller.reconfigure == "novelty":
        parts.append(
            "The novelty index is the amplitude of the dominant mode in the prediction error, by a lock-in (Eqs. 19 "
            f"to 21) with a {NOVELTY_FILTERS[t.novelty_filter]}."
        )
    return " ".join(parts)


def _readings(config: RunConfig) -> list[str]:
    """The readings of the paper that this run depends on; all of them: docs/theory.md."""
    found = []
    c = config.controller
    if c.structure in ("imc", "nimc") and c.prefilter == "reduced":
        found.append(
            "the reduced model keeps the steady state (balanced residualisation), and its minimum-phase factor is "
            "inverted"
        )
    if has_gear(config.rig) and config.profile.kind == "s_curve":
        found.append("the gap's S-curve is 10x³ \N{MINUS SIGN} 15x⁴ + 6x⁵")
    if config.reference.kind == "square" and c.structure != "open_loop":
        found.append("the square wave goes from +A to -A")
    if c.reconfigure == "reference_change":
        found.append("a buffer begins at the change of the reference")
    if c.reconfigure != "never":
        found.append(f"the new gap is in force {number(config.twin.delay_s)} s after the buffer is full")
    return found
