"""A law that is the limit of another one: a finding that has reached that limit takes the simpler name.

Dry friction across a spring is a hysteresis over a tiny displacement. Where that displacement is small beside the
motion, the simpler name is used unless the data need the other one.
"""

from dataclasses import replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import Key, as_given
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Log, Model, Named, Trial
from dtbacklash.physics.catalogue import find

#: a law whose width is below this share of its spring's stretch has become the sharp one (share of the stretch)
SHARP_STRETCH_SHARE = 0.03
#: the law that another one has become may explain so much less of what that one explains (share)
LIMIT_LESS_SHARE = 0.25
#: and so much of the floor, which is the floor's own uncertainty (floors, mean square)
LIMIT_LESS_FLOORS = 0.03


def has_become(evidence: Evidence, fitted: Fit, key: Key) -> str:
    """The simpler law that an effect equals when its parameter is small beside the motion; else empty."""
    place, name = key
    entry = find(evidence.nominal.kind_at(place), name, place)
    parameter, limit = entry.becomes or ("", "")
    values, stretch = fitted.rig.effect(*key), evidence.moving(place).stretch
    if not limit or values is None or stretch is None:
        return ""
    span = float(np.quantile(np.abs(stretch - np.mean(stretch)), 0.95))
    return limit if values[parameter] < SHARP_STRETCH_SHARE * span else ""


def call_by_its_limit(model: Model, log: Log) -> Model:
    """Replace each effect that has reached its limiting law by that law, if it explains nearly as much.

    What the effect explains beyond that is how another formulation of the same law behaves around rest. It is noted as
    such, so that it does not count as missing physics.
    """
    for key in model.keys:
        evidence, before = model.evidence, model.fitted
        limit = has_become(evidence, before, key)
        if not limit or before.rig.effect(key[0], limit) is not None:
            continue
        entry, simpler = (find(evidence.nominal.kind_at(key[0]), n, key[0]) for n in (key[1], limit))
        size = (before.rig.effect(*key) or {})[entry.size.name]
        fitted = refit_with(evidence, before, [((key[0], limit), {simpler.size.name: size})], key)
        more = _more(evidence, before, fitted, key)
        if more is not None:
            formulations = {n: model.formulations.get(n, np.zeros(len(rise))) + rise for n, rise in more.items()}
            model = replace(_renamed(model, log, key, limit, fitted), formulations=formulations)
    return model


def _more(evidence: Evidence, fitted: Fit, trial: Fit, key: Key) -> dict[str, Floats] | None:
    """Per block, (channels,) mean square that the limit leaves more, in units of the floor's; None if that is much."""
    without = evidence.residuals(as_given(evidence.nominal, fitted.rig, key), fitted.residuals, {key[0]})
    more = {block.name: np.zeros(len(block.channels)) for block in evidence.blocks}
    for part in ("train", "held"):
        before, after, gone = (evidence.mean_square(r, part) for r in (fitted.residuals, trial.residuals, without))
        for name, most in more.items():
            rise = after[name] - before[name]
            allowed = LIMIT_LESS_SHARE * np.maximum(gone[name] - before[name], 0.0) + LIMIT_LESS_FLOORS
            if np.any(rise > allowed):
                return None
            more[name] = np.maximum(most, rise)
    return more


def _renamed(model: Model, log: Log, key: Key, limit: str, fitted: Fit) -> Model:
    """The model with the simpler law in the place of a finding, which then fits as well."""
    former, simpler, before = model.about(key), (key[0], limit), model.fitted
    score = next((s for s in log.scores if s.candidate.key == key), None)
    more = () if score is None else (Trial(key, score, before, model.evidence.rms(before.residuals)),)
    return model.instead(fitted, key, Named(simpler, (*more, *former.tried), former.alike))
