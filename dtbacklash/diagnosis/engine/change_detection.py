"""What changed between two recordings of one machine, whatever else is wrong with its rig.

Each way in which a machine may change has two sets of columns: one shared, which takes what the rig lacks in both, and
one of the second recording alone. What the second set explains beside the first is a change. The likeliest are fitted,
with a value shared and with one in each; a change is as sure as it leads the others that could stand for it.
"""

from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities
from dtbacklash.diagnosis.engine.fit import FittedModel
from dtbacklash.diagnosis.engine.horizons import STRETCHES, paired_t
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.engine.proposals import STRICT
from dtbacklash.diagnosis.engine.recording_effects import MOST, differing, freed, joined, named_apart
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.physics.rig import Rig

#: so many of the likeliest changes are fitted, of each set of columns
FITTED = 3
#: rungs and steps of a fit with a value that is free in each
RUNGS, STEPS = (0.1, 0.1, 1.0), 5


@dataclass(frozen=True)
class Tried:
    """A change, fitted. title : of the value that is free in each. gain : by which that is likelier than one value."""

    title: str
    model: FittedModel
    gain: float


@dataclass(frozen=True)
class Change:
    """A change that was found, and what was tried in its place: title -> lead over it in standard errors,
    and the model."""

    title: str
    gain: float
    rivals: dict[str, tuple[float, FittedModel]]


def grow(search: StepwiseSelection) -> None:
    """Add the likeliest change while one earns what a name has to."""
    while len(search.differences) < MOST:
        search.tell(f"change {len(search.differences) + 1}: fitting the likeliest", 0.6)
        tried = fits(search, search.now)
        best = max(tried, key=lambda one: one.gain, default=None)
        if best is None or best.gain < search.asked(best.model, search.now):
            return
        search.now, search.differences = best.model, (*search.differences, best.title)


def judged(search: StepwiseSelection) -> tuple[Change, ...]:
    """The changes that a search has found, each with what leads it or not."""
    found = []
    for title in search.differences:
        search.tell(f"trying what else could have changed for {title}", 0.8)
        now = search.now
        less = _shared(search, now, title)
        others = [one for one in fits(search, less) if one.title != title] if less else []
        gained = less.score - now.score if less else np.inf
        found.append(Change(title, gained, {one.title: (_paired_t(search, one.model), one.model) for one in others}))
    return tuple(found)


def fits(search: StepwiseSelection, model: FittedModel) -> list[Tried]:
    """The likeliest changes beside a model, fitted."""
    ranked: dict[str, tuple[Rig, tuple[Key, ...]]] = {}
    for share in (1.0, *STRICT[:1]):
        noise_levels = search.segments.scaled(model.noise_levels, share)
        for title, rig, keys in _ranked(search, model, replace(model, noise_levels=noise_levels))[:FITTED]:
            ranked.setdefault(title, (rig, keys))
    found = []
    for title, (rig, keys) in ranked.items():
        own = search.fitted(rig, model, keys, RUNGS, STEPS)
        if own is None or own.at_end or any(own.rig.effect(*key) is None for key in keys):
            continue
        shared = _shared(search, own, title)
        best = min(model.score, np.inf if shared is None else shared.score)
        found.append(Tried(title, own, best - own.score))
    return sorted(found, key=lambda one: -one.gain)


def _shared(search: StepwiseSelection, model: FittedModel, title: str) -> FittedModel | None:
    """A model with one value for both recordings, fitted; None where nothing is left of it."""
    rig = joined(model.rig, title, search.segments.recordings)
    if any(rig.effect(*key) is None for key in model.keys):
        return None
    return search.fitted(rig, model, model.keys, RUNGS, STEPS)


def _ranked(search: StepwiseSelection, model: FittedModel, at: FittedModel) -> list[tuple[str, Rig, tuple[Key, ...]]]:
    """Title, rig with a value in each recording, and names, best first. at : the model at levels to look with."""
    segments = search.segments
    found = [
        (gain, title, freed(model.rig, title, segments.recordings), model.keys)
        for gain, title in differing(segments, at, search.motion)
    ]
    found += named_apart(segments, model, CandidateSensitivities(segments, model, at.noise_levels).differing())
    return [row[1:] for row in sorted(found, key=lambda row: -row[0]) if row[0] > 0.0]


def _paired_t(search: StepwiseSelection, other: FittedModel) -> float:
    """By how many standard errors the search's model leads another one, over stretches of the recordings."""
    sums = []
    for model in (other, search.now):
        rows = search.segments.residuals(model.rig, search.segments.gains(model.rig, search.now.noise_levels))
        if rows is None:
            return np.inf if model is other else 0.0
        sums.append(np.array([(part**2).sum() for part in np.array_split(rows, STRETCHES)]))
    return paired_t(sums[0], sums[1])
