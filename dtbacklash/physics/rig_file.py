"""A rig as plain data, and as the YAML file that describes it."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import yaml

from dtbacklash.config.rig import ParameterConfig, RigConfig
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig, build_rig

#: what is always said of a parameter; bounds where there are some
STATED = ("value", "unit", "tolerance", "description")
#: what the names of tables end in
TABLE = "_table"
#: the sections of a rig's file below its name and description
SECTIONS = ("commands", "fixed", "joints", "parameters", "elements", "effects", "laws", "sensors")


def rig_content(rig: Rig) -> dict[str, Any]:
    """What the file of a rig holds, in plain numbers, texts, lists and mappings; effects with all their parameters.

    What is of single recordings, as sensors' zeros, is not the rig's.
    """
    config = rig.config
    effects = {place: {name: rig_leaves(rig, place, name) for name in there} for place, there in rig.effects.items()}
    content: dict[str, Any] = plain_numbers({
        "name": config.name, "description": config.description,
        "parameters": {name: _stated(parameter) for name, parameter in config.parameters.items()},
        "elements": config.elements, "effects": effects, "laws": rig.laws(), "sensors": config.sensors,
    })  # fmt: skip
    if config.model:
        content |= {"model": config.model, "commands": config.commands, "fixed": list(config.fixed)}
    if config.joints:
        content["joints"] = config.joints
    return content if content["laws"] else {name: one for name, one in content.items() if name != "laws"}


def _stated(parameter: ParameterConfig) -> dict[str, Any]:
    """What is said of a parameter; its bounds where it has some."""
    said = asdict(parameter)
    return {name: said[name] for name in said if name in STATED or said[name] is not getattr(ParameterConfig, name)}


def rig_of(content: Mapping[str, Any]) -> Rig:
    """The rig that plain data describe.

    Raises
    ------
    UserError : an unknown section; data that describe no rig. TypeError, KeyError : a parameter of another form.
    """
    known = [one.name for one in fields(RigConfig)]
    for name in content:
        if name not in known:
            raise UserError(f"rig.{name}", content[name], f"unknown; a rig has {', '.join(known)}")
    parameters = {name: ParameterConfig(**one) for name, one in content["parameters"].items()}
    return build_rig(RigConfig(**{**content, "parameters": parameters}))


def rig_yaml(rig: Rig) -> str:
    """The text of a file for ``rig=FILE`` that gives this rig again."""
    content = rig_content(rig)
    head = {name: value for name, value in content.items() if name not in SECTIONS}
    # a leaf on one line, as in the files that come with the package; numbers with all their digits
    texts = [
        yaml.safe_dump({name: content[name]}, sort_keys=False, default_flow_style=None, width=160, allow_unicode=True)
        for name in SECTIONS
        if name in content
    ]
    header = yaml.safe_dump(head, sort_keys=False, allow_unicode=True)
    tables = any(name.endswith(TABLE) for there in rig.effects.values() for name in there)
    beyond = "# A table has the values f1.. at the states x1.., and is constant beyond; `bend` holds its fit back.\n"
    about = "# Values are SI; `tolerance` is relative, one standard deviation.\n" + (beyond if tables else "")
    return about + "\n".join([header, *texts])


def rig_leaves(rig: Rig, place: str, name: str) -> dict[str, Any]:
    """An effect's parameters: a number, or value and tolerance where it has one."""
    known = rig.tolerances.get(place, {}).get(name, {})
    values = rig.effects[place][name]
    return {p: {"value": v, "tolerance": known[p]} if p in known else v for p, v in values.items()}


def plain_numbers(value: Any) -> Any:
    """The same with NumPy's numbers as Python's, which YAML knows."""
    if isinstance(value, dict):
        return {key: plain_numbers(item) for key, item in value.items()}
    return value.item() if isinstance(value, np.generic) else value
