"""What a diagnosis on its way can say already: at which stage it is, and what it has found."""

from typing import Literal

from dtbacklash import units
from dtbacklash.diagnosis.engine.parameters import unit_at
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.diagnosis.labels import named_in_words
from dtbacklash.physics.catalogue import find

#: how much is looked for: all; what is large, without rivals; nothing, the rig is calibrated as it is
Depth = Literal["full", "quick", "none"]

READING, DRAWING = "reading the recording", "drawing the report"
#: the stages of each depth between reading and drawing, by what a search has counted as each begins
STAGES: dict[Depth, tuple[float, ...]] = {"full": (0.0, 0.1, 0.6, 0.9), "quick": (0.0, 0.1, 0.9), "none": (0.0, 0.9)}


class Stages:
    """The stages of a diagnosis: reading, recalibrating, looking for names, trying rivals, modelling the rest, drawing.

    A depth that names nothing has fewer.
    """

    def __init__(self, depth: Depth) -> None:
        self._counted = STAGES[depth]
        self._now = 0

    @property
    def number(self) -> int:
        """How many there are."""
        return len(self._counted) + 2

    def reached(self, step: str, counted: float) -> tuple[str, float]:
        """The step with its stage in words, and the share of the stages that are done, which never falls.

        counted : how far it is as the search counts, 0 to 1.
        """
        begun = sum(counted >= at for at in self._counted) if step != READING else 0
        self._now = max(self._now, self.number - 1 if step == DRAWING else begun)
        return f"stage {self._now + 1} of {self.number}, {step}", self._now / self.number


def known(search: StepwiseSelection) -> str:
    """The names that a search has found, with their sizes; the likeliest while there is none; what is unknown still."""
    model, rig = search.now, search.now.rig
    told = []
    for place, name in model.keys:
        entry = find(rig.kind_at(place), name, place)
        value = (rig.effect(place, name) or {}).get(entry.size.name)
        unit = unit_at(rig, place, entry.size.unit)
        factor, shown = units.scaled(unit, value or 0.0)
        size = f" ({entry.size.name.replace('_', ' ')} {(value or 0.0) / factor:.3g} {shown if shown != '1' else ''})"
        told.append(named_in_words(name, place) + ("" if entry.is_table else size.replace(" )", ")")))
    likely = max(search.gains, key=lambda key: search.gains[key]) if search.gains else search.likely
    if not told and likely is not None:
        told.append(f"likeliest {named_in_words(likely[1], likely[0])}")
    percent = 100.0 * search.unknown(model)
    left = "nearly all" if percent > 99.0 else "less than 0.1 %" if percent < 0.1 else f"{percent:.2g} %"
    return ", ".join([*told, f"{left} of what acts is unexplained"])
