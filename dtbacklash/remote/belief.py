"""What a twin has to know of a machine, as a document that goes with each request, and a twin made of it.

The document holds everything: a twin that was started a moment ago answers as well as one that knows the machine.
"""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from typing import Any

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.config.run import OptimizerConfig, RunConfig, TwinConfig
from dtbacklash.config.setting import METADATA
from dtbacklash.control.belief import Belief, beliefs_of, settled
from dtbacklash.errors import UserError
from dtbacklash.experiment.sensors import roles
from dtbacklash.physics.rig import Rig, build_rig
from dtbacklash.physics.rig_file import plain_numbers, rig_leaves
from dtbacklash.remote.documents import Document
from dtbacklash.twin.bank_twin import BankTwin
from dtbacklash.twin.service import Answering, Twin

#: settings of the twin that are the machine's affair: they do not go with a request
OF_THE_MACHINE = (
    "delay_s", "where", "broker", "machine", "timeout_s", "credentials", "estimate_from", "novelty_threshold_mm",
    "novelty_filter", "indexes", "frequency_threshold", "frequency_amplitude_mm", "motor_threshold_n_m",
    "structure_threshold_mm", "index_hysteresis",
)  # fmt: skip


def described(config: RunConfig, belief: Belief | None = None) -> Document:
    """The document for the twin of a run.

    Parameters
    ----------
    config : of a run. belief : what its twin believes of the rig; None: what the configuration says.

    Raises
    ------
    UserError : the rig is none that the twin has a model of.
    """
    if belief is None:
        beliefs = beliefs_of(config)
        config, belief = settled(config, beliefs), beliefs.twin
    output = list(belief.rig.sensors)[roles(belief.rig, True)[1]]
    settings = {one.name: getattr(config.twin, one.name) for one in fields(TwinConfig)}
    return {
        "rig": rig_document(belief.rig),
        "output": output,
        "sample_time_s": config.sample_time_s,
        "twin": {name: value for name, value in settings.items() if name not in OF_THE_MACHINE},
        "optimizer": asdict(config.optimizer),
    }


def rig_document(rig: Rig) -> Document:
    """A rig as the content of its file, effects with all of their parameters."""
    content = {
        "name": rig.config.name, "description": rig.config.description,
        "parameters": {name: asdict(one) for name, one in rig.config.parameters.items()},
        "elements": rig.config.elements,
        "effects": {place: {n: rig_leaves(rig, place, n) for n in there} for place, there in rig.effects.items()},
        "sensors": rig.config.sensors,
    }  # fmt: skip
    found: Document = plain_numbers(content)
    return found


def rig_of(document: Document) -> Rig:
    """The rig that a document describes, whose form the schema has checked; raises UserError where it is none."""
    content = dict(document)
    parameters = {name: ParameterConfig(**one) for name, one in content.pop("parameters").items()}
    return build_rig(_made(RigConfig, {**content, "parameters": parameters}, "rig"))


def twin_of(document: Document) -> Answering:
    """The twin that a document describes, whose form the schema has checked.

    Raises
    ------
    UserError : a setting that is unknown or out of range; a rig that makes no sense.
    """
    rig = rig_of(document["rig"])
    settings = _made(TwinConfig, document["twin"], "twin")
    optimizer = _made(OptimizerConfig, document["optimizer"], "optimizer")
    sample_time_s = float(document["sample_time_s"])
    if document["output"] not in rig.sensors:
        raise UserError("output", document["output"], "a sensor of the rig: " + ", ".join(rig.sensors))

    def estimating(belief: Belief, method: str = "auto") -> Twin:
        if method == "auto":
            method = "simulate" if belief.bends() else "linear"
        output = belief.rig.sensors[document["output"]]
        return Twin.of(belief, output, replace(settings, method=method), optimizer, sample_time_s)

    if settings.on_alarm == "bank":
        return BankTwin(Belief(rig), estimating, sample_time_s)
    return estimating(Belief(rig), settings.method)


def _made(schema: type, values: dict[str, Any], where: str) -> Any:
    """A section of a configuration from plain values, of the types that it declares."""
    known = {one.name: one for one in fields(schema)}
    for name, value in values.items():
        if name not in known:
            raise UserError(f"{where}.{name}", value, "no such setting here; machine and twin differ in their versions")
        default = known[name].default
        if METADATA not in known[name].metadata or not isinstance(default, bool | int | float | str):
            continue
        fits = isinstance(value, bool) if isinstance(default, bool) else (
            not isinstance(value, bool) and isinstance(value, str if isinstance(default, str) else int | float)
        )  # fmt: skip
        if not fits or (isinstance(default, int) and not isinstance(value, int)):
            raise UserError(f"{where}.{name}", value, f"must be a value like {default!r}")
    return schema(**values)
