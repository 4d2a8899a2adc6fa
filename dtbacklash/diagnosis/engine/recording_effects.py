"""What differs between recordings: a parameter or a law's size that is free in each instead of shared.

Freed, a parameter has the rows of its column in each recording as a column of its own. So how much any difference would
explain follows from the columns that a fit has anyway, with all that is shared projected out; the best are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.candidates import OWN
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.hypotheses import Hypothesis
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.parameters import FreeParameter, Key
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig, build_rig

if TYPE_CHECKING:
    from dtbacklash.diagnosis.engine.selection import StepwiseSelection

#: so many of the likeliest differences are fitted, and so many are looked for at most
FITTED, MOST = 2, 4


def differ(search: StepwiseSelection, named: Sequence[FittedModel]) -> bool:
    """Free in each recording what differs between them, of the present model or of one with a new name; whether.

    named : models with a new name that is shared. Where those leave much unknown, or gain less than sizes that differ
    promise, the names that explain most beyond what they do with one size are fitted with a size in each recording: one
    alone may have it, and what it leaves there is little in all of them.

    It has to earn what a name has to, and more than the best new name. A parameter of the rig is not freed while much
    is unknown: it would stand for what is missing.
    """
    segments, now, rules = search.segments, search.now, search.rules
    if len(segments.recordings) < 2 or len(search.differences) >= MOST:
        return False
    found: list[tuple[FittedModel, str]] = []
    for model in (now, *named[:1]):
        for gain, title in differing(segments, model, search.motion)[:FITTED]:
            if gain > search.least and (done := _freed(search, model, title)) is not None:
                left = search.unknown(done)
                if "." in title or left < max(
                    rules.unexplained_attention, min(rules.max_unexplained, rules.clearing_ratio * search.unknown(now))
                ):
                    found.append((done, title))
    promised = max((gain for gain, *_ in search.apart), default=-np.inf)
    if not named or now.score - named[0].score < promised or search.unknown(named[0]) > rules.max_unexplained:
        found += _differing_names(search)
    if not found:
        return False
    best, title = min(found, key=lambda one: one[0].score)
    least = named[0].score if named else np.inf
    if best.score > min(least - search.least, now.score - search.asked(best, now)):
        return False
    search.now, search.differences = best, (*search.differences, title)
    search.eliminate_backward()
    return True


def _differing_names(search: StepwiseSelection) -> list[tuple[FittedModel, str]]:
    """The likeliest new names, one alone, each with a size that is free in each recording, from what each asks for."""
    found: list[tuple[FittedModel, str]] = []
    for gain, title, rig, keys in named_apart(search.segments, search.now, search.apart)[:FITTED]:
        done = search.fitted(rig, search.now, keys, (0.1, 0.1, 1.0), 5) if gain > search.least else None
        if done is not None and not done.at_end:
            found.append((done, title))
    return found


def named_apart(
    segments: Segments, model: FittedModel, differing: Sequence[tuple[float, Hypothesis, Floats]]
) -> list[tuple[float, str, Rig, tuple[Key, ...]]]:
    """Gain, title, rig with a new name whose size is each recording's own, and all its names, best first.

    differing : :meth:`.CandidateSensitivities.differing` of the model.
    """
    found = []
    for gain, h, sizes in differing:
        size = h.effect.size
        title = f"{h.place}.{h.effect.name}.{size.name}"
        owned = ((k, title) for k in segments.recordings)
        each = dict(zip(owned, np.clip(sizes, size.low, size.high), strict=True))
        try:
            rig = h.put(model.rig, None if h.as_it_is else sizes[np.argmax(np.abs(sizes))][None])
        except UserError:
            continue
        found.append((gain, title, rig.owning(each), (*model.keys, h.key)))
    return found


def _freed(search: StepwiseSelection, model: FittedModel, title: str) -> FittedModel | None:
    """A model with a value free in each recording; None where it does not fit."""
    rig = freed(model.rig, title, search.segments.recordings)
    done = search.fitted(rig, model, model.keys, (1.0, 0.1, 1.0), 5)
    return None if done is None or done.at_end else done


def alike(search: StepwiseSelection) -> None:
    """Share again what was found to differ, if it differs by less than it is worth; or free another in its place."""
    for title in search.differences:
        place, *rest = search.now.rig.path(title)
        others = tuple(t for t in search.differences if t != title)
        if rest and search.now.rig.effect(place, rest[0]) is None:
            search.differences = others
            continue
        now, segments = search.now, search.segments
        one = joined(now.rig, title, segments.recordings)
        whole = all(one.effect(*key) is not None for key in now.keys)
        less = search.fitted(one, now, now.keys, (1.0, 0.1, 1.0), 5) if whole else None
        if less is None or less.at_end:
            continue
        if less.score < now.score + search.asked(now, less):
            search.now, search.differences = less, others
            continue
        for _, other in differing(segments, less, search.motion)[:FITTED]:
            done = _freed(search, less, other) if other != title else None
            if done is not None and done.score < search.now.score - search.least:
                search.now, search.differences = done, (*others, other)


def differing(segments: Segments, model: FittedModel, motion: Motion) -> list[tuple[float, str]]:
    """(fall of -2 log likelihood less what it costs, title) of what may differ between recordings, best first."""
    problem = FitProblem(segments, model.rig, model.keys, motion, model.stiff, model.smooth)
    x, gains = problem.start(), segments.gains(model.rig, model.noise_levels)
    rows = problem.residuals(x, gains)
    if rows is None or len(segments.recordings) < 2:
        return []
    jacobian = problem.jacobian(x, gains, rows)
    norms = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
    basis, _ = np.linalg.qr(jacobian[:, norms > 0.0] / norms[norms > 0.0])
    left = rows - basis @ (basis.T @ rows)
    found = []
    for j, f in enumerate(problem.free):
        if not may_differ(f, model.rig):
            continue
        columns = split(segments, jacobian[:, j])[:, 1:]  # the first follows from the others and the shared one
        own = columns - basis @ (basis.T @ columns)
        columns = own[:, (own**2).sum(axis=0) > OWN * np.maximum((columns**2).sum(axis=0), 1e-300)]
        if not columns.size:
            continue
        told = np.linalg.lstsq(columns, left, rcond=OWN)[0]
        gain = float(left @ left - np.sum((left - columns @ told) ** 2))
        found.append((gain - float(np.log(segments.count)) * columns.shape[1], f.shared_title))
    return sorted(found, reverse=True)


def may_differ(f: FreeParameter, rig: Rig) -> bool:
    """Whether a shared parameter is one of the rig, or the size of an effect."""
    if f.recording is not None:
        return False
    return not f.effect or f.name == find(rig.kind_at(f.place), f.effect, f.place).size.name


def split(segments: Segments, column: Floats) -> Floats:
    """(rows, recordings) a column's rows in each recording, 0 in the others; rows of priors are in none."""
    found, first = np.zeros((len(column), len(segments.recordings))), 0
    for p in segments.predictors:
        at = slice(first, first + p.readings.y.size)
        found[at, segments.recordings.index(p.readings.recording)] = column[at]
        first = at.stop
    return found


def freed(rig: Rig, title: str, recordings: Sequence[int]) -> Rig:
    """The rig in which a shared value is each recording's own, from where it stands."""
    return rig.owning({(k, title): shared_value(rig, title) for k in recordings})


def joined(rig: Rig, title: str, recordings: Sequence[int]) -> Rig:
    """The rig in which what was each recording's own is shared again, in their middle; an effect stays one."""
    each = [rig.own[k][title] for k in recordings]
    middle = float(np.median(each)) or max(each, key=abs)
    rig = rig.owning({(k, title): None for k in recordings})
    return build_rig(rig.config.with_values({rig.path(title): middle}), rig.own)


def shared_value(rig: Rig, title: str) -> float:
    """A parameter's value that recordings share, SI."""
    place, *rest = rig.path(title)
    return rig.effects[place][rest[0]][rest[1]] if rest else rig.config.parameters[title].value
