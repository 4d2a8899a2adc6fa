"""A run's configuration in words, for the page."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import yaml

from dtbacklash.config import choices
from dtbacklash.config.rig import RigConfig
from dtbacklash.config.run import ControllerConfig, ProfileConfig, ReferenceConfig, RunConfig, SensorsConfig
from dtbacklash.files import json_able
from dtbacklash.physics.catalogue import find
from dtbacklash.report.components.blocks import Table
from dtbacklash.report.components.numbers import number, quantity
from dtbacklash.report.run.text import indexes_in_words

DIGITS = 4  # of a setting in a sentence


def as_yaml(value: Any) -> str:
    """Dataclasses and containers as YAML."""
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return str(yaml.dump(json_able(value), Dumper=dumper, sort_keys=False, allow_unicode=True))


def in_words(meaning: str, settings: Any, unit: str = "") -> str:
    """A meaning of :mod:`dtbacklash.config.choices` with the settings beside it filled in.

    meaning: the template.
    settings: the dataclass of which its names are fields.
    unit: the reference's unit.
    """
    plain_ones = {f.name: getattr(settings, f.name) for f in fields(settings)}
    values = {name: number(v, DIGITS) for name, v in plain_ones.items() if not isinstance(v, (list, dict))}
    return meaning.format(**values, unit=unit)


def is_open(config: RunConfig) -> bool:
    """Whether the run has no controller: its reference is then a command in V, and nothing is tracked."""
    return config.controller.structure == "open_loop"


def has_gear(rig: RigConfig) -> bool:
    """Whether the rig has a gear, in which the gap of `profile` can open."""
    return any(element["kind"] == "gear" for element in rig.elements.values())


def describe(config: RunConfig) -> list[tuple[str, list[str]]]:
    """What was run: (subject, sentences), in the order to be read."""
    told = [
        ("Rig", [config.rig.description or config.rig.name, *effect_sentences(config.rig)]),
        ("Controller", [_controller(config.controller)]),
    ]
    if config.model is not None and not is_open(config):
        told.append(("Belief", _belief(config, config.model)))
    if config.controller.reconfigure != "never":
        when = in_words(choices.TRIGGERS[config.controller.reconfigure], config.twin)
        after = f"{number(config.twin.delay_s)} s after the buffer is full"
        twin = [f"estimates the gap {when}, and the controller has it {after}", _estimation(config)]
        if config.twin.where != "local":
            twin.append(in_words(choices.TWIN_PLACES[config.twin.where], config.twin))
        told.append(("Digital twin", twin))
    if config.twin.indexes and not is_open(config):
        told.append(("Novelty", indexes_in_words(config)))
    if has_gear(config.rig):
        told.append(("Gap", [_profile(config.profile)]))
    told += [
        ("Command", [_reference(config.reference, "V")])
        if is_open(config)
        else ("Reference", [_reference(config.reference, "mm")]),
        ("Sensors", [_sensors(config.sensors)]),
        ("Simulation", [_simulation(config)]),
    ]
    return [(subject, [_sentence(text) for text in texts]) for subject, texts in told]


def subjects(told: list[tuple[str, list[str]]]) -> Table:
    """What was run as a table: what is spoken of, and the sentences on it."""
    return Table(("what", "how"), [[f"{subject}", " ".join(texts)] for subject, texts in told], look="subjects")


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
                sentences.append(effect.said(effect.idle(filled)).format(location=location, **shown))
    return sentences or ["No effect beyond the nominal model"]


def _controller(c: ControllerConfig) -> str:
    parts = [in_words(choices.STRUCTURES[c.structure], c)]
    if c.structure in ("imc", "nimc", "pid"):
        parts.append(f"inner gain {number(c.k_theta_v_per_rad)} V/rad")
    if c.structure in ("imc", "nimc"):
        parts += [in_words(choices.PREFILTERS[c.prefilter], c), choices.INTERNAL_MODELS[c.internal_model]]
    if c.structure != "open_loop" and c.limit_v is not None:
        parts.append(f"its voltage is limited to {number(c.limit_v)} V")
    if c.structure == "nimc":
        verb = "stays at" if c.reconfigure == "never" else "starts at"
        parts.append(f"its gap estimate {verb} {number(c.gap_hat_deg)}°")
    return "; ".join(parts)


def _belief(config: RunConfig, model: RigConfig) -> list[str]:
    """What controller and twin know of the rig, and what the voltage takes out beforehand."""
    asked = {"the controller": config.controller.design_from, "the twin": config.twin.estimate_from}
    who = [name for name, source in asked.items() if source == "model"]
    if not who:
        return ["nobody uses the model that was given"]
    said = [f"believed of the rig by {' and '.join(who)}: {model.name}", *effect_sentences(model)]
    there = {name for effects in model.effects.values() for name in effects}
    taken = [choices.COMPENSATED[name] for name in config.controller.compensate if name in there]
    if taken and config.controller.design_from == "model":
        said.append("the voltage takes out beforehand: " + ", ".join(taken))
    return said


def _estimation(config: RunConfig) -> str:
    twin = config.twin
    guard = (
        f"an implausible estimate is rejected (bound: {number(twin.gap_max_deg)}°)"
        if twin.guard
        else "every estimate is trusted (no guard)"
    )
    samples = f"{twin.buffer} samples, the first {twin.settle} to settle"
    if config.controller.reconfigure != "never" and config.model is not None:
        guard = f"{choices.TWIN_METHODS[twin.method]}; {guard}"
    return f"{samples}; optimiser {choices.OPTIMIZERS[config.optimizer.name]}; {guard}"


def _profile(p: ProfileConfig) -> str:
    return in_words(choices.PROFILES[p.kind], p)


def _reference(r: ReferenceConfig, unit: str) -> str:
    text = in_words(choices.REFERENCES[r.kind], r, unit)
    if r.kind == "csv":
        return f"{text}; {choices.INTERPOLATIONS[r.interpolation]}"
    return f"{text}, offset {number(r.offset_mm)} {unit}" if r.offset_mm else text


def _sensors(s: SensorsConfig) -> str:
    parts = [f"noise on {name}: {number(size)} (standard deviation)" for name, size in s.noise.items() if size]
    parts += [f"resolution of {name}: {number(size)}" for name, size in s.resolution.items() if size]
    return "; ".join(parts) or "ideal: no noise, no quantisation"


def _simulation(config: RunConfig) -> str:
    milliseconds = number(1000 * config.sample_time_s)
    pace = "" if config.pace == "free" else f", {choices.PACES[config.pace]}"
    return f"{number(config.duration_s, 6)} s, one sample every {milliseconds} ms, seed {config.seed}{pace}"
