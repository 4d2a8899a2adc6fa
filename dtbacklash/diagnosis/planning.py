"""What a diagnosis leaves for the experiment after it: models that are open, and how the machine was seen to move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from dtbacklash.files import json_able


@dataclass(frozen=True)
class OpenModel:
    """A model that the recording does not tell from the one that was found.

    instead_of : (place, effect) that was found. effects : what stands in its place; nothing, where that does as well.
    Where what changed is open (``compare=change``), both are ("", title). rig : the content of its rig file, with its
    values as fitted; of several recordings, as in the last. lead : by which the found one is likelier (-2 log
    likelihood, with what parameters cost).
    """

    instead_of: tuple[str, str]
    effects: tuple[tuple[str, str], ...]
    rig: dict[str, Any]
    lead: float


@dataclass(frozen=True)
class Observed:
    """How a recording saw the machine, and what it leaves open.

    Attributes
    ----------
    sample_time_s, duration_s : of the longest recording. command : largest absolute command, in the rig's unit.
    travel, speed : body -> how far it went from where it began, and how fast, at most, SI.
    noise : channel -> rms, SI. unknown : body -> rms force that stays unknown, SI. open : the models.
    slow : body -> rms over stretches of ``stretch_s`` of the mean force that the found rig lacks there, SI.
    """

    sample_time_s: float
    duration_s: float
    command: float
    travel: dict[str, float]
    speed: dict[str, float]
    noise: dict[str, float]
    unknown: dict[str, float]
    open: tuple[OpenModel, ...] = field(repr=False, default=())
    slow: dict[str, float] = field(default_factory=dict)
    stretch_s: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """``observed`` of ``diagnosis.json``."""
        row: dict[str, Any] = json_able(asdict(self))
        return row

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Observed:
        """The same from ``diagnosis.json``; KeyError or TypeError where it has another form."""
        models = tuple(
            OpenModel(tuple(one["instead_of"]), tuple(map(tuple, one["effects"])), one["rig"], one["lead"])
            for one in content["open"]
        )
        return cls(**{**content, "open": models})
