"""What a diagnosis on its way can say already: what it has found, and how much of it is done by what its steps took."""

import time
from collections.abc import Callable

from dtbacklash import units
from dtbacklash.diagnose.engine.free import unit_at
from dtbacklash.diagnose.engine.search import Search
from dtbacklash.diagnose.words import named_in_words
from dtbacklash.physics.catalogue import find

#: where a search begins, where what it found is judged, and what comes last, as the search counts
BEGINS, JUDGED, LAST = 0.1, 0.6, 0.9


class Pace:
    """The share that is done: of the time until now and that of the steps ahead, which take as long as those before."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock, self._begun = clock, clock()
        self._searching: float | None = None
        self._stages: list[str] = []
        self._share = 0.0

    def share(self, stage: str, counted: float, names: int) -> float:
        """The share done as a stage begins; it never falls.

        counted : how far it is as the search counts. names : that are found, if nothing more is.
        """
        now = self._clock()
        if counted < BEGINS or counted >= 1.0 or self._searching is None:
            self._searching = now if BEGINS <= counted < 1.0 else self._searching
            self._share = max(self._share, min(counted, 0.05) if counted < 1.0 else 1.0)
            return self._share
        if stage not in self._stages:
            self._stages.append(stage)
        ahead = 1.0
        if counted < JUDGED:
            ahead += 1.0 + names + (names if names > 1 else 0)
        elif counted < LAST:
            ahead += round(names * (LAST - counted) / (LAST - JUDGED))
        each = (now - self._searching) / len(self._stages)
        done = now - self._begun
        self._share = max(self._share, done / max(done + ahead * each, 1e-9))
        return self._share


def known(search: Search) -> str:
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
    return ", ".join([*told, f"{left} of what moves the machine is unexplained"])
