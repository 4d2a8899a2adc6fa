"""Rigs to try: beside a model, and in the place of one of its names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from dtbacklash.diagnosis.engine.attempts import attempt
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities, Proposal
from dtbacklash.diagnosis.engine.fit import FittedModel
from dtbacklash.diagnosis.engine.parameters import Key, taken_out
from dtbacklash.diagnosis.engine.recording_effects import named_apart
from dtbacklash.diagnosis.engine.screening import screen
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.physics.catalogue import simpler
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

if TYPE_CHECKING:
    from dtbacklash.diagnosis.engine.selection import StepwiseSelection

#: noise levels at which columns are looked at as well while much is unknown (shares)
STRICT = (0.1, 0.01)
#: so many names that the beginning says most for are looked at on all
PROMISING = 12


def propose(
    search: StepwiseSelection,
    model: FittedModel,
    without: tuple[Key, ...] = (),
    quick: bool = False,
    alone: bool = False,
) -> list[tuple[Rig, tuple[Key, ...]]]:
    """Rigs to try: the best singles and pairs of columns, at the present noise levels and at smaller ones.

    alone : see :class:`.candidates.CandidateSensitivities`.
    """
    far, found, without = search.far(model), [], (*without, *search.rejected)
    seen: dict[tuple[Key, ...], list[list[Values]]] = {}
    # where much is unexplained, the beginning tells as well what explains it
    much = search.unknown(model) > search.rules.max_unexplained and len(search.segments.recordings) == 1
    whole = search.quick if much else search.segments
    levels = [(search.quick, 1.0, 5 if alone else 3, 0)] if quick else [(whole, 1.0, 5, 3)]
    if far and not quick:
        levels += [(search.quick, share, 4 - n, 2 - n) for n, share in enumerate(STRICT)]
    for segments, share, singles, pairs in levels:
        if segments is search.quick and share == 1.0 and not without and not alone:
            columns = search.on_beginning(model)[-1]
        else:
            at = search.segments.of_first(model.noise_levels) if segments is search.quick else model.noise_levels
            columns = attempt(
                CandidateSensitivities, segments, model, segments.scaled(at, share), without, alone=alone,
                only=None if segments is search.quick else _promising(search, model),
            )  # fmt: skip
        if columns is None:
            continue
        ranked = columns.ranked
        if share == 1.0 and not quick:
            _note_gains(search, ranked, segments)
            kept = search.first_columns
            _note_gains(search, kept[-1].ranked if kept and kept[0] is model and kept[-1] else (), search.quick)
            search.apart = columns.differing() if len(segments.recordings) > 1 else []
        ranked = [p for p in ranked if far or p.gain > 0.3 * search.rules.min_gain * segments.count]
        chosen: list[Proposal] = ranked[:singles] + (columns.pairs(ranked[:5])[:pairs] if pairs else [])
        for p in ranked[:singles]:  # the simpler law that it may become
            ((h, _),) = p.parts
            if law := simpler(h.effect):
                simple = (o for o, _ in columns.hypotheses if o.key == (h.place, law.name))
                chosen += [Proposal(0.0, ((o, None),)) for o in simple][:1]
        for p in chosen:
            values = [h.values for h, _ in p.parts]
            there = seen.setdefault(p.keys, [])
            if len(there) >= 3 or values in there:
                continue
            there.append(values)
            if (rig := attempt(p.put, model.rig)) is not None:
                found.append((rig, (*model.keys, *(h.key for h, _ in p.parts))))
    return found


def _promising(search: StepwiseSelection, model: FittedModel) -> set[Key] | None:
    """Names that the beginning says most for, alone and in pairs; None, all of them, where recordings may differ."""
    first = search.on_beginning(model)[-1] if len(search.segments.recordings) == 1 else None
    if first is None:
        return None
    ranked = [p for p in first.ranked if p.keys[0] not in search.rejected]
    pairs = first.pairs(ranked[:5])[:PROMISING]
    return {p.keys[0] for p in ranked[:PROMISING]} | {key for p in pairs for key in p.keys}


def _note_gains(search: StepwiseSelection, ranked: Sequence[Proposal], segments: Segments) -> None:
    """Keep what the column of each name promises, as if on all."""
    for p in ranked:
        search.gains.setdefault(p.keys[0], p.gain * search.segments.count / segments.count)


def alternatives_to(search: StepwiseSelection, less: FittedModel, key: Key, best: int = 3) -> list[FittedModel]:
    """The likeliest others in the place of a name of the model; less : the model without it, fitted anew.

    What stands for it explains what is left where it is taken out and all else stays; or what is left at last.
    """
    bare = replace(search.now, rig=taken_out(search.now.rig, key), keys=less.keys)
    mine, proposals = ".".join(key) + ".", []
    if any(title.startswith(mine) for there in search.now.rig.own for title in there):
        search.look_at(less.noise_levels)  # one recording alone may show it, and others have sizes of their own as well
        for m in (bare, less):
            columns = CandidateSensitivities(search.segments, m, m.noise_levels, (key,), alone=m is bare)
            found = named_apart(search.segments, m, columns.differing()[: best + 1])
            proposals += [(rig, keys) for *_, rig, keys in found]
    else:
        proposals = [p for m in (bare, less) for p in propose(search, m, (key,), quick=True, alone=m is bare)]
    values = search.now.rig.effects[key[0]][key[1]]
    for place in search.now.rig.places:  # the same law elsewhere
        unread = place.startswith(SENSOR_PREFIX) and place not in search.segments.sensors
        takes = key[1] in search.now.rig.takes(place) and bare.rig.effect(place, key[1]) is None
        if place == key[0] or unread or not takes or (place, key[1]) in search.rejected:
            continue
        own = {
            (k, title.replace(mine, f"{place}.{key[1]}.")): value
            for k, there in enumerate(search.now.rig.own) for title, value in there.items() if title.startswith(mine)
        }  # fmt: skip
        if (rig := attempt(_put, bare.rig, (place, key[1]), dict(values), own)) is not None:
            proposals.append((rig, (*bare.keys, (place, key[1]))))
    return screen(search, less, proposals, best, key)


def _put(rig: Rig, key: Key, values: Values, own: dict[tuple[int, str], float]) -> Rig:
    """The rig with an effect; own : (recording, title) -> value there."""
    return rig.with_effect(*key, values).owning(own)
