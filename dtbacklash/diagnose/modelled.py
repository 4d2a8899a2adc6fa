"""What a diagnosis models that no law of the catalogue explains: plain data in SI."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from dtbacklash.files import json_able
from dtbacklash.physics.rig import Rig


@dataclass(frozen=True)
class Formula:
    """A family of laws that was fitted to a table, and how it compares with it.

    Attributes
    ----------
    family : in words. law : the formula, in the states and parameters of a law of one's own. parameters : name ->
        (value, low, high), the ends of a 95 % interval. unit : name -> unit, where it has one.
    left : what it leaves of what judges, rms, as a ratio to what the table leaves. tied : whether the recording cannot
        tell it from the best one. chosen : whether it takes the place of the table.
    """

    family: str
    law: str
    parameters: dict[str, tuple[float, float, float]]
    units: dict[str, str]
    left: float
    tied: bool
    chosen: bool = False

    def to_json(self) -> dict[str, Any]:
        """A row of ``formulas``."""
        parameters = {
            name: {"value": value, "unit": self.units.get(name, ""), "ci95": [low, high]}
            for name, (value, low, high) in self.parameters.items()
        }
        return {"family": self.family, "law": self.law, "parameters": json_able(parameters),
                "left": json_able(self.left), "tied": self.tied, "chosen": self.chosen}  # fmt: skip


@dataclass(frozen=True)
class Modelled:
    """The effort that no name explains, as the rig has it now.

    Attributes
    ----------
    location : an element. effect : ``found_1`` where a formula takes the place of the table, else the table's name.
    state, state_unit : over which it is. times : a second state that multiplies it, or empty. unit : of its values.
    points : (state, value, standard error), a row a knot. instead_of : (location, effect) of the names that the rig
        does without, since it leaves less with this alone.
    formulas : families that were tried, the best first. sentence : what a person would say. rig : with all of it.
    """

    location: str
    effect: str
    state: str
    state_unit: str
    times: str
    unit: str
    points: tuple[tuple[float, float, float], ...]
    instead_of: tuple[tuple[str, str], ...]
    formulas: tuple[Formula, ...]
    sentence: str
    rig: Rig = field(repr=False)

    def to_json(self) -> dict[str, Any]:
        """``modelled`` of ``diagnosis.json``."""
        names = ("location", "effect", "state", "state_unit", "times", "unit", "points", "sentence")
        row: dict[str, Any] = json_able({name: getattr(self, name) for name in names})
        row["instead_of"] = [{"location": place, "effect": effect} for place, effect in self.instead_of]
        return row | {"formulas": [formula.to_json() for formula in self.formulas]}
