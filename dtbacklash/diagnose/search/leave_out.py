"""Fits with effects added or left out, and what is taken back of what was found."""

import numpy as np

from dtbacklash.diagnose.data.compare import places_of
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import earns, merit
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
from dtbacklash.diagnose.search.trials import Search
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


def fit_without(found: Search, key: Key) -> Fit:
    """The fit without one of the effects; those about the last fit are remembered."""
    if found.left_out_of is not found.fitted:
        found.left_out, found.left_out_of = {}, found.fitted
    if key not in found.left_out:
        found.left_out[key] = refit_with(found.evidence, found.fitted, [], key)
    return found.left_out[key]


def borne(fitted: Fit, key: Key, step_s: float) -> bool:
    """Whether another effect of the rig needs this one: a force on a mass that only a yielding screw lets move."""
    try:
        compile_plant(fitted.rig.with_effect(*key, None), step_s)
    except UserError:
        return True
    return False


def drop(found: Search, key: Key, why: str) -> None:
    """Take a finding back, for good."""
    found.fitted = fit_without(found, key)
    found.order = [k for k in found.order if k != key and found.fitted.rig.effect(*k) is not None]
    found.refused[key] = f"taken back: {why}"
    if not found.order:
        found.as_well = None
        found.nominal = found.fitted = min(found.fitted, found.nominal, key=lambda f: merit(found.evidence, f))


def eliminate(evidence: Evidence, found: Search) -> None:
    """Take out what does not earn its place beside the others, or alone."""
    _recalibrate_again(evidence, found)
    for key in list(found.order):
        if borne(found.fitted, key, evidence.records[0].sample_time_s):
            continue
        without = fit_without(found, key)
        if not earns(evidence, without, found.fitted, found.nominal):
            found.fitted = without
            found.order.remove(key)
            _recalibrate_again(evidence, found)
    if not found.order:
        found.fitted = found.nominal


def _recalibrate_again(evidence: Evidence, found: Search) -> None:
    """Fit the nominal rig from where the last fit ended, too: a law that led out of another valley is none."""
    if not found.order:
        return
    if len(found.order) == 1:
        again = fit_without(found, found.order[0])
    else:
        rig = found.fitted.rig
        for key in found.order:
            rig = as_given(evidence.nominal, rig, key)
        again = fit(evidence, rig, *all_free(evidence, rig))
    if merit(evidence, again) < merit(evidence, found.nominal):
        found.nominal = again
