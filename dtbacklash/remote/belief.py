"""What a twin needs to know of a machine, as a document that goes with each request, and the twin made from it.

The document is complete: a twin that was started a moment ago answers as well as one that knows the machine.
"""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

from dtbacklash.config.run import OptimizerConfig, RunConfig, TwinConfig
from dtbacklash.config.setting import METADATA
from dtbacklash.control.belief import Belief, beliefs_of, settled
from dtbacklash.errors import UserError
from dtbacklash.experiment.estimation import twin_from
from dtbacklash.experiment.sensors import roles
from dtbacklash.physics.rig_file import rig_content, rig_of
from dtbacklash.remote.protocol import Document
from dtbacklash.twin.link.service import Answering

#: settings of the twin that only the machine needs: they do not go with a request
OF_THE_MACHINE = (
    "delay_s", "where", "broker", "machine", "timeout_s", "credentials", "estimate_from", "novelty_threshold_mm",
    "novelty_filter", "indexes", "frequency_threshold", "frequency_amplitude_mm", "motor_threshold_n_m",
    "structure_threshold_mm", "index_hysteresis", "growth_s",
)  # fmt: skip


def described(config: RunConfig, belief: Belief | None = None) -> Document:
    """The document for the twin of a run.

    config : of a run. belief : what its twin believes about the rig; None: what the configuration says.

    Raises UserError: the twin has no model of such a rig.
    """
    if belief is None:
        beliefs = beliefs_of(config)
        config, belief = settled(config, beliefs), beliefs.twin
    sent = [one.name for one in fields(TwinConfig) if one.name not in OF_THE_MACHINE]
    return {
        "rig": rig_content(belief.rig),
        "output": list(belief.rig.sensors)[roles(belief.rig, True)[1]],
        "sample_time_s": config.sample_time_s,
        "twin": {name: getattr(config.twin, name) for name in sent},
        "optimizer": asdict(config.optimizer),
    }


def twin_of(document: Document) -> Answering:
    """The twin that a document describes, whose form the schema has checked.

    Raises UserError: a setting that is unknown or out of range; a rig that makes no sense.
    """
    rig = rig_of(document["rig"])
    settings = _made(TwinConfig, document["twin"], "twin")
    optimizer = _made(OptimizerConfig, document["optimizer"], "optimizer")
    sample_time_s = float(document["sample_time_s"])
    if document["output"] not in rig.sensors:
        raise UserError("output", document["output"], "a sensor of the rig: " + ", ".join(rig.sensors))
    return twin_from(Belief(rig), document["output"], settings, optimizer, sample_time_s)


def _made(schema: type, values: dict[str, Any], where: str) -> Any:
    """A section of the settings; raises UserError for an unknown name or a value of another type than the default's."""
    known = {one.name: one for one in fields(schema)}
    for name, value in values.items():
        if name not in known:
            raise UserError(f"{where}.{name}", value, "no such setting here; machine and twin differ in their versions")
        default = known[name].default
        if METADATA in known[name].metadata and not _fits(value, default):
            raise UserError(f"{where}.{name}", value, f"must be a value like {default!r}")
    return schema(**values)


def _fits(value: Any, default: Any) -> bool:
    """Whether a value has the type of a default; a whole number also fits a float, and anything fits other defaults."""
    if not isinstance(default, bool | int | float | str):
        return True
    return type(value) is type(default) or (type(value) is int and isinstance(default, float))
