"""A rig as the YAML file that describes it."""

from dataclasses import asdict
from typing import Any

import numpy as np
import yaml

from dtbacklash.physics.rig import Rig


def rig_yaml(rig: Rig) -> str:
    """The text of a file for ``rig=FILE`` that gives this rig again, effects with all of their parameters."""
    config = rig.config
    head = yaml.safe_dump({"name": config.name, "description": config.description}, sort_keys=False, allow_unicode=True)
    sections = (
        {"parameters": {name: asdict(parameter) for name, parameter in config.parameters.items()}},
        {"elements": config.elements},
        {"effects": {place: {n: rig_leaves(rig, place, n) for n in there} for place, there in rig.effects.items()}},
        {"sensors": config.sensors},
    )
    # a leaf on one line, as in the files that come with the package; numbers with all their digits
    texts = [
        yaml.safe_dump(plain_numbers(section), sort_keys=False, default_flow_style=None, width=160, allow_unicode=True)
        for section in sections
    ]
    return "# Values are SI; `tolerance` is relative, one standard deviation.\n" + "\n".join([head, *texts])


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
