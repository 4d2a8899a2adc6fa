"""Grow the model: fit the best candidates in full, keep what earns its place on held-out data, and go on.

Adding is greedy with a look ahead; what was added first is tried against its rivals once more when others have joined,
and each is tried without in the end.
"""

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from dtbacklash.diagnose.data.candidates import candidates
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.approach import approached
from dtbacklash.diagnose.fit.comparison import formulations, lead, merit, worst
from dtbacklash.diagnose.fit.free import (
    Key,
    at_limit,
    nominal_free,
    standing,
    tolerances_away,
)
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import ON, fit
from dtbacklash.diagnose.propose.locate import Score, bank
from dtbacklash.diagnose.search.attempts import attempt, finish, weakened
from dtbacklash.diagnose.search.course import Course
from dtbacklash.diagnose.search.leave_out import eliminate, refit_with
from dtbacklash.diagnose.search.model import Asked, Log, Model, Named, Trial, seen_by
from dtbacklash.diagnose.search.order import (
    apart,
    is_named_already,
    promising,
    simplest_first,
)
from dtbacklash.diagnose.search.rivals import reconsider
from dtbacklash.diagnose.search.wrong_value import explains_alone, own_parameter, wrong_value_instead
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.spread import spread
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.rig import Rig

#: how much is looked for: nothing (the rig is calibrated as it is), what is large, everything
Depth = Literal["none", "quick", "full"]
NONE: Depth = "none"
QUICK: Depth = "quick"
FULL: Depth = "full"
#: a quick search names at most so many (effects)
QUICK_EFFECTS = 2
#: one recording does not carry more (effects)
EFFECTS_MAX = 4
#: the best of the quick fits that are fitted in full (candidates)
FULL_FITS = 3
#: rivals that it is tried against in the end (candidates)
FINAL_RIVALS = 4
#: a quick fit that leaves so much more than the best, which leaves noise, is not finished (ratio)
HOPELESS_RATIO_NOISE = 1.5

#: where all that was found only led out of a wrong recalibration, the search begins once more from the right one
ATTEMPTS = 2
#: of an effect that the rig has and the machine may not have, this share is left where its fit begins
ALMOST_GONE = 1e-3
#: shares of a diagnosis: where the first, the second ... effect is looked for, and what comes then
LOOKED_FOR = (0.1, 0.3, 0.5, 0.6, 0.7)
TRIED, RECONSIDERED = 0.7, 0.75
#: before effects are looked for, one element's own parameter is tried where its signature leaves at most this share
OWN_LIKELY = 0.7


def search(evidence: Evidence, course: Course, depth: Depth = FULL) -> tuple[Model, Log]:
    """Find the effects that the recording needs, one after the other.

    Where one wrong number alone leaves nothing but noise, one effect is held against it first, and more are looked for
    only if that fits better: a conspiracy of several is less likely than one wrong number.
    """
    course.at("recalibrating the nominal rig", 0.02)
    nominal, log = _recalibrated(evidence), Log()
    model = Model(evidence, nominal, nominal)
    course.believe(model, log)
    if depth == NONE:
        return model, log
    if depth == QUICK:
        return _add_quickly(model, log, course), log
    if explains_alone(model, log, _recalibrated) or own_parameter(evidence, nominal, OWN_LIKELY):
        model = _explain(model, log, 1, course)
        if model.wrong_value is not None or not model.named:
            return model, log
    return _explain(model, log, EFFECTS_MAX, course), log


def _add_quickly(model: Model, log: Log, course: Course) -> Model:
    """Add the effects that stand out among quick fits, and try nothing else."""
    for number in range(QUICK_EFFECTS):
        course.at(f"looking for effect {number + 1}", 0.2 + 0.3 * number, 0.5 + 0.3 * number)
        larger = _add(model, log, course, thorough=False)
        if larger is None:
            break
        model = larger
        course.believe(model, log)
    return model


def _explain(model: Model, log: Log, most: int, course: Course) -> Model:
    """Add up to ``most`` effects that earn their place, take out what is not needed, try one wrong value instead."""
    before = model.keys
    for _ in range(ATTEMPTS):
        model = _add_all(model, log, most, course)
        if not model.named:
            break
        course.at("trying to do without", TRIED)
        model = eliminate(model, log)
        course.believe(model, log)
        if model.named:
            break
    if before and model.keys == before:
        return model  # nothing has joined since they were judged
    model = replace(model, could_be=None)
    if len(model.named) > 1:
        course.at("what else would fit", RECONSIDERED)
        model = reconsider(model, log, model.keys, FINAL_RIVALS)
        course.believe(model, log)
    return wrong_value_instead(model, log)


def _recalibrated(evidence: Evidence) -> Fit:
    """The fit of the nominal rig's own parameters."""
    rig, free = evidence.nominal, nominal_free(evidence.nominal)
    direct = fit(evidence, rig, free)
    if not _astray(evidence, direct) or worst(evidence, direct) < SETTINGS.nearly_noise_floors:
        return direct
    led = fit(evidence, rig, free, approached(evidence, rig, free, np.zeros(len(free))))
    return min(direct, led, key=lambda f: merit(evidence, f))


def _astray(evidence: Evidence, fitted: Fit) -> bool:
    """Whether a nominal parameter is so far from nominal that it may have been led there by something else."""
    away = tolerances_away(evidence.nominal, fitted.rig)
    return max(away.values(), default=0.0) >= SETTINGS.astray_tolerances


def _add_all(model: Model, log: Log, most: int, course: Course) -> Model:
    """Add effects until none earns its place.

    Of two that hide each other none may (one half of a friction that differs by direction makes the moves to one side
    fit better and those to the other worse): where none does, and more than noise is left, the best that takes away
    enough is added on trial. Without another one that earns its place beside it, it is taken back in the end.
    """
    on_trial = False
    while len(model.named) < most:
        number = len(model.named)
        course.at(f"looking for effect {number + 1}", LOOKED_FOR[number], LOOKED_FOR[number + 1])
        model = _with_lower_floor(_with_weaker_pull(model, log))
        course.believe(model, log)
        larger = _release(model) or _add(model, log, course)
        if larger is None and not on_trial and len(model.named) + 2 <= most:
            larger, on_trial = _on_trial(model, log), True
        elif larger is not None:
            on_trial = False
        if larger is None:
            break
        model = larger
        course.believe(model, log)
    return model


def _on_trial(model: Model, log: Log) -> Model | None:
    """The model with the best of what was tried last, if more than noise is left and it takes away enough of it."""
    evidence = model.evidence
    trials = [t for t, of in log.trials if of is evidence and t.beside == len(model.named) and t.key not in model.keys]
    best = next(iter(simplest_first(evidence, trials)), None)
    if best is None or worst(evidence, model.fitted) <= SETTINGS.noise_floors:
        return None
    allowed = formulations(evidence, model.fitted)
    far = lead(evidence, model.fitted, best.fitted, allowed=allowed).far
    return _take(model, log, best, trials) if far else None


def _release(model: Model) -> Model | None:
    """Let an effect of the nominal rig go that stands at the end of what its tolerance allows, where that earns it.

    Then it is found, as one that the rig lacked: what the rig says of it is wrong.
    """
    evidence, rig = model.evidence, model.fitted.rig
    known = [f for f in nominal_free(evidence.nominal, rig=rig) if f.effect]
    for key in dict.fromkeys((f.place, f.effect) for f in known if at_limit(f, standing(f, rig))):
        trials = [refit_with(evidence, model.fitted, [(key, values)]) for values in _let_go(rig, key)]
        trial = min(trials, key=lambda t: merit(evidence, t))
        if lead(evidence, model.fitted, trial).clear:
            return model.plus(trial, Named(key))
    return None


def _let_go(rig: Rig, key: Key) -> list[Values]:
    """Where the fit of an effect begins that is let go: where it stands, and near nothing: it may not be there."""
    values = rig.effects[key[0]][key[1]]
    gone = weakened(rig, key, values, ALMOST_GONE)
    return [values] if gone == values else [values, gone]


def _with_weaker_pull(model: Model, log: Log) -> Model:
    """Weaken the pull as far as what was found bears it, and try its rivals once more there.

    Under the pull that the nominal rig needs, what is measured is followed whatever the model does.
    """
    evidence = model.evidence.pulled_for(model.fitted.rig)
    if not model.named or evidence is model.evidence:
        return model
    nominal = fit(evidence, evidence.nominal, model.nominal.free, model.nominal.x)
    effects = [(key, model.fitted.effects[key]) for key in model.keys]
    fitted = refit_with(evidence, seen_by(evidence, model.fitted), effects, rounds=ON)
    model = replace(model, evidence=evidence, nominal=nominal, fitted=fitted)
    return reconsider(model, log, model.keys, FINAL_RIVALS, alone=True)


def _with_lower_floor(model: Model) -> Model:
    """Lower the floor where what the last fit leaves shows that there is less noise."""
    evidence = model.evidence.quieter(model.fitted.residuals)
    if evidence is model.evidence:
        return model
    model = model.seen_by(evidence)
    # the weights of the channels have changed: the same structure, fitted anew
    if not model.named:
        nominal = fit(evidence, evidence.nominal, model.nominal.free, model.nominal.x)
        return replace(model, nominal=nominal, fitted=nominal)
    effects = [(key, model.fitted.effects[key]) for key in model.keys]
    return replace(model, fitted=refit_with(evidence, model.fitted, effects))


def scores_about(model: Model, log: Log) -> list[Score]:
    """The bank about the last fit, without what has been refused."""
    evidence = model.evidence
    listed = candidates(model.fitted.rig, evidence.blocks, evidence.moving)
    signatures, scores = bank(evidence, model.fitted, [c for c in listed if c.key not in log.refused])
    log.banks.append(Asked(evidence, scores, signatures.residual))
    return scores


def _add(model: Model, log: Log, course: Course, thorough: bool = True) -> Model | None:
    """The model with the best candidate that earns its place; None if there is none.

    thorough : whether those that come near are fitted in full.
    """
    evidence, current = model.evidence, model.fitted
    scores = promising(evidence, scores_about(model, log))[: SETTINGS.quick_fits]
    trials = spread(partial(attempt, evidence, current), scores, course.part(0.1, 0.6))
    trials = sorted(trials, key=lambda t: merit(evidence, t.fitted))
    trials = _finished(model, trials, course) if thorough else trials
    trials = [replace(trial, beside=len(model.named)) for trial in trials]
    log.tried(evidence, trials)
    allowed = formulations(evidence, current)
    for group in apart(evidence, trials):
        for trial in simplest_first(evidence, group):
            if lead(evidence, current, trial.fitted, allowed=allowed).clear:
                return _take(model, log, trial, group)
    return None


def _finished(model: Model, trials: list[Trial], course: Course) -> list[Trial]:
    """The trials, the best first, of which those that come near are fitted in full."""
    evidence, current = model.evidence, model.fitted
    is_close = bool(trials) and trials[0].held_out < SETTINGS.close_floors
    far = HOPELESS_RATIO_NOISE if is_close else SETTINGS.hopeless_ratio
    near = [
        t
        for t in trials[:FULL_FITS]
        if t.held_out < far * trials[0].held_out
        and merit(evidence, t.fitted) < merit(evidence, current)
        and not is_named_already(model, t)
    ]
    finished = spread(partial(finish, evidence, current, near=True), near, course.part(0.6, 1.0))
    return [*finished, *(t for t in trials if t.key not in {f.key for f in finished})]


def _take(model: Model, log: Log, trial: Trial, group: list[Trial]) -> Model:
    """The model with what was tried; ``group`` : what was tried beside it."""
    log.verdicts.append((trial, "added"))
    tried = tuple(t for t in group if t is not trial)
    return model.plus(trial.fitted, Named(trial.key, tried))
