"""A constant effort beside dry friction that is larger is friction whose level differs between the directions.

Friction levels F+ and F- equal one level (F+ + F-)/2 and a constant effort -(F+ - F-)/2, at every speed and at rest: no
recording can tell them apart. The search adds one law after the other and finds the effort. Where the dry friction is
larger, both levels are friction, and an engineer calls their difference asymmetric friction; the effort stays as a
rival that fits as well.
"""

from dataclasses import replace

from dtbacklash.diagnose.fit.comparison import alike, held_loss, lead
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Log, Model, Named
from dtbacklash.physics.catalogue import effects_of, find
from dtbacklash.physics.effects.declare import Alias, Values, name_in_words
from dtbacklash.physics.rig import Rig


def call_by_direction(model: Model, log: Log) -> Model:
    """Call each constant effort that was found beside larger dry friction a friction that differs by direction."""
    nominal = model.evidence.nominal
    for key in model.keys:
        alias = find(nominal.kind_at(key[0]), key[1], key[0]).alias
        if alias is None or not _is_friction(nominal, model.fitted.rig, key, alias):
            continue
        fitted = _fitted(model, key, alias)
        if alike(model.evidence, model.fitted, fitted):
            model = _renamed(model, log, key, alias, fitted)
    return model


def _is_friction(nominal: Rig, rig: Rig, key: Key, alias: Alias) -> bool:
    """Whether both levels are friction, and neither the load nor its other name is known from the nominal rig."""
    place = key[0]
    if nominal.effect(*key) is not None or nominal.effect(place, alias.effect) is not None:
        return False
    dry = effects_of(rig.kind_at(place)).get(alias.friction)
    # a brake's level is one of its own parameters
    level = rig.elements[place].values.get("friction", 0.0)
    if dry is not None:
        level += (rig.effect(place, dry.name) or {}).get(dry.size.name, 0.0)
    return level > abs(_size(rig, key))


def _size(rig: Rig, key: Key) -> float:
    return (rig.effect(*key) or {}).get(find(rig.kind_at(key[0]), key[1], key[0]).size.name, 0.0)


def _fitted(model: Model, key: Key, alias: Alias) -> Fit:
    """The fit by the other name: with all differences free, or with that of the levels alone where it does as well.

    A search that may name few effects need not have come to the others.
    """
    evidence, before = model.evidence, model.fitted
    other, entry = (key[0], alias.effect), find(before.rig.kind_at(key[0]), alias.effect, key[0])
    known: Values = before.rig.effect(*other) or {}
    there = {**known, alias.parameter: known.get(alias.parameter, 0.0) - _size(before.rig, key)}
    renamed = refit_with(evidence, before, [(other, there)], key)
    there = renamed.rig.effect(*other) or {}
    if known or not there:
        return renamed
    start = entry.start_values(evidence.moving(key[0]))[0][entry.size.name]
    both = refit_with(evidence, renamed, [(other, {**there, entry.size.name: start})])
    return both if lead(evidence, renamed, both).clear else renamed


def _renamed(model: Model, log: Log, key: Key, alias: Alias, fitted: Fit) -> Model:
    """The model in which the other name takes the place of a finding, or joins it.

    The effort alone stays as a rival where it fits as well.
    """
    evidence, before, other = model.evidence, model.fitted, (key[0], alias.effect)
    former, joined = model.about(key), model.about(other) if other in model.keys else None
    twins = (*former.alike, *(joined.alike if joined else ()))
    twins = tuple(t for t in twins if t.key not in (key, other))
    tried = [trial for trial, _ in log.trials if trial.key == key]
    if tried and joined is None and alike(evidence, fitted, before):
        left = held_loss(evidence, before)
        twins = (*twins, replace(tried[-1], fitted=before, held_out=left, reason=alias.reason))
    for trial in tried:
        log.verdicts.append((trial, f"is called {name_in_words(alias.effect)}: {alias.reason}"))
    if joined is None:
        return model.instead(fitted, key, Named(other, former.tried, twins))
    known = replace(joined, alike=twins, tried=former.tried + joined.tried)
    return model.instead(fitted, other, known).minus(fitted, key)
