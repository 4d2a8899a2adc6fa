"""A run's configuration in words, for the page."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

from dtbacklash.config.rig import RigConfig
from dtbacklash.config.run import ControllerConfig, ProfileConfig, ReferenceConfig, RunConfig, SensorsConfig
from dtbacklash.physics.catalogue import find
from dtbacklash.report.numbers import number, quantity

STRUCTURE = {
    "imc": "Linear internal model control: its model knows no backlash",
    "nimc": "Nonlinear internal model control: its model contains the backlash",
    "open_loop": "No controller: the reference drives the rig's input itself",
}
MODEL = {
    "bare": "the internal model is driven by the voltage (the paper's form)",
    "measured": "the internal model is driven by the measured motor angle",
    "inner_loop": "the internal model is that of the closed inner loop",
}


def plain(value: Any) -> Any:
    """Dataclasses and containers as nested dicts, lists and scalars."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, dict):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.item() if hasattr(value, "item") else value


def describe(config: RunConfig) -> list[tuple[str, list[str]]]:
    """What was run: (subject, sentences), in the order to be read.

    Args:
        config: a `RunConfig`.
    """
    told = [
        ("Rig", [config.rig.description or config.rig.name, *effect_sentences(config.rig)]),
        ("Controller", [_controller(config.controller)]),
    ]
    if config.controller.reconfigure != "never":
        told.append(("Digital twin", [_trigger(config), _estimation(config)]))
    told += [
        ("Gap", [_profile(config.profile)]),
        ("Reference", [_reference(config.reference)]),
        ("Sensors", [_sensors(config.sensors)]),
        ("Simulation", [_simulation(config)]),
    ]
    return [(subject, [_sentence(text) for text in texts]) for subject, texts in told]


def _sentence(text: str) -> str:
    text = text[:1].upper() + text[1:]
    return text if text.endswith(".") else text + "."


def effect_sentences(rig: RigConfig) -> list[str]:
    """One sentence for each effect that the rig has beyond its nominal model; neutral ones are left out."""
    sentences = []
    for location, effects in rig.effects.items():
        kind = "sensor" if location.startswith("sensor_") else rig.elements[location]["kind"]
        for name, values in effects.items():
            key = f"rig.effects.{location}.{name}"
            effect = find(kind, name, key)
            filled = effect.complete(values, key)
            if not effect.is_neutral(filled):
                units = {p.name: p.unit for p in effect.parameters}
                shown = {p: quantity(value, units[p], 4) for p, value in filled.items()}
                sentences.append(effect.sentence.format(location=location, **shown))
    return sentences or ["No effect beyond the nominal model"]


def _controller(c: ControllerConfig) -> str:
    if c.structure == "open_loop":
        return STRUCTURE["open_loop"]
    parts = [STRUCTURE[c.structure], f"inner gain {number(c.k_theta_v_per_rad)} V/rad"]
    parts.append(
        f"prefilter with a time constant of {number(c.tau_r_s)} s"
        if c.prefilter != "none"
        else "no dynamical prefilter"
    )
    parts.append(MODEL[c.internal_model])
    if c.structure == "nimc":
        verb = "stays at" if c.reconfigure == "never" else "starts at"
        parts.append(f"its gap estimate {verb} {number(c.gap_hat_deg)}°")
    return "; ".join(parts)


def _trigger(config: RunConfig) -> str:
    twin = config.twin
    if config.controller.reconfigure == "novelty":
        when = f"whenever the novelty index exceeds {number(twin.novelty_threshold_mm)} mm"
    else:
        when = "after each change of the reference"
    delay = number(twin.delay_s)
    return f"estimates the gap {when}, and the controller has it {delay} s after the buffer is full"


def _estimation(config: RunConfig) -> str:
    twin = config.twin
    guard = (
        f"an implausible estimate is rejected (bound: {number(twin.gap_max_deg)}°)"
        if twin.guard
        else "every estimate is trusted (no guard)"
    )
    samples = f"{twin.buffer} samples, the first {twin.settle} to settle"
    return f"{samples}; optimiser {config.optimizer.name}; {guard}"


def _profile(p: ProfileConfig) -> str:
    start, end = number(p.start_deg), number(p.end_deg)
    span = f"between {number(p.t_start_s, 4)} and {number(p.t_end_s, 4)} s"
    return {
        "constant": f"{start}° throughout",
        "step": f"jumps from {start}° to {end}° at {number(p.t_start_s, 4)} s",
        "ramp": f"grows evenly from {start}° to {end}° {span}",
        "s_curve": f"grows from {start}° to {end}° along an S-curve {span}",
        "wear": f"wears from {start}° to {end}° {span}: running in, steady, severe",
        "csv": f"read from {p.path}",
    }[p.kind]


def _reference(r: ReferenceConfig) -> str:
    if r.kind == "csv":
        return f"read from {r.path}"
    size = number(r.amplitude_mm)
    text = {
        "square": lambda: f"square wave of ±{size} mm, period {number(r.period_s)} s",
        "step": lambda: f"one step of {size} mm at {number(r.t_start_s)} s",
        "staircase": lambda: (
            f"staircase: {r.levels} steps of {number(r.step_mm)} mm up and down, {number(r.dwell_s)} s on each"
        ),
        "multisine": lambda: f"multisine of {number(r.rms_mm)} mm rms, {number(r.f_min_hz)} to {number(r.f_max_hz)} Hz",
    }[r.kind]()
    return f"{text}, offset {number(r.offset_mm)} mm" if r.offset_mm else text


def _sensors(s: SensorsConfig) -> str:
    parts = [f"noise on {name}: {number(size)} (standard deviation)" for name, size in s.noise.items() if size]
    parts += [f"resolution of {name}: {number(size)}" for name, size in s.resolution.items() if size]
    return "; ".join(parts) or "ideal: no noise, no quantisation"


def _simulation(config: RunConfig) -> str:
    milliseconds = number(1000 * config.sample_time_s)
    return f"{number(config.duration_s, 6)} s, one sample every {milliseconds} ms, seed {config.seed}"
