"""Fits with effects added or left out, and effects that are taken out of the model again."""

from dataclasses import replace

import numpy as np

from dtbacklash.diagnose.data.compare import places_of
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import formulations, lead, merit
from dtbacklash.diagnose.fit.free import (
    Key,
    all_free,
    as_given,
    effect_free,
    effects_of_rig,
    is_known,
    nominal_free,
    standing,
)
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import FULL, Rounds, fit
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.errors import UserError
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.rig import Rig


def refit_with(evidence: Evidence, current: Fit, added: list[tuple[Key, dict[str, float]]], left_out: Key | None = None,
               rounds: Rounds = FULL, near: Rig | None = None) -> Fit:  # fmt: skip
    """Fit effects anew with some added or one left out, with the nominal parameters of the blocks they touch.

    near : a rig in whose nominal parameters the fit begins, if not in those of ``current``.
    """
    base = current.rig
    for (place, name), values in added:
        base = base.with_effect(place, name, values)
    if left_out:
        base = as_given(evidence.nominal, base, left_out)
    changed = {key[0] for key, _ in added} | ({left_out[0]} if left_out else set())
    touched = set().union(*(
        places_of(rig, b) for b in evidence.blocks for rig in (base, current.rig) if changed & places_of(rig, b)
    ))  # fmt: skip
    free = nominal_free(evidence.nominal, touched, base)
    start = [standing(f, near or base) for f in free]
    for key, values in effects_of_rig(base).items():
        if key[0] in touched and not is_known(base, key):
            more = effect_free(base, *key, values, evidence.bounds(key))
            free += more
            start += [0.0] * len(more)
    known = {
        b.name: current.residuals[b.name] for b in evidence.blocks if not changed & places_of(base, b)
        and not changed & places_of(current.rig, b)
    }  # fmt: skip
    return fit(evidence, base, free, np.array(start), known, rounds)


def fit_without(model: Model, log: Log, key: Key) -> Fit:
    """The fit without one of the effects."""
    return log.left_out(model.fitted, key, lambda: refit_with(model.evidence, model.fitted, [], key))


def borne(model: Model, key: Key) -> bool:
    """Whether another effect of the rig needs this one, as a force on a mass needs the screw that lets it move."""
    try:
        compile_plant(model.fitted.rig.with_effect(*key, None), model.evidence.records[0].sample_time_s)
    except UserError:
        return True
    return False


def drop(model: Model, log: Log, key: Key, why: str) -> Model:
    """Take an effect out of the model, for good."""
    fitted = fit_without(model, log, key)
    log.refuse(key, f"taken back: {why}")
    # an effect that needs another one goes with it
    model = model.minus(fitted, key, *(k for k in model.keys if fitted.rig.effect(*k) is None))
    if model.named:
        return model
    best = min(fitted, model.nominal, key=lambda f: merit(model.evidence, f))
    return replace(model, nominal=best, fitted=best, could_be=None)


def eliminate(model: Model, log: Log, part: str = "held") -> Model:
    """Take out what does not earn its place in a part of the recordings, beside the others or alone."""
    model = _recalibrated_again(model, log)
    for key in model.keys:
        if borne(model, key):
            continue
        without = fit_without(model, log, key)
        allowed = formulations(model.evidence, without)
        if not lead(model.evidence, without, model.fitted, part=part, allowed=allowed).clear:
            model = _recalibrated_again(model.minus(without, key), log)
    return model if model.named else replace(model, fitted=model.nominal)


def _recalibrated_again(model: Model, log: Log) -> Model:
    """Fit the nominal rig from where the last fit ended, too: it may have ended in a better local minimum."""
    if not model.named:
        return model
    if len(model.named) == 1:
        again = fit_without(model, log, model.keys[0])
    else:
        rig = model.fitted.rig
        for key in model.keys:
            rig = as_given(model.evidence.nominal, rig, key)
        again = fit(model.evidence, rig, *all_free(model.evidence, rig))
    better = merit(model.evidence, again) < merit(model.evidence, model.nominal)
    return replace(model, nominal=again) if better else model
