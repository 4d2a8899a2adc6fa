"""Name: try the best candidates in full, keep what earns its place on data that it was not fitted to, and go on.

Adding is greedy with a look ahead; what was added first is tried against its rivals once more when others have joined,
and each is tried without in the end.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import call

import numpy as np

from dtbacklash.diagnose.data.candidates import candidates
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.approach import approached
from dtbacklash.diagnose.fit.comparison import earns, held_loss, merit, paired, same, worst
from dtbacklash.diagnose.fit.free import (
    Key,
    all_free,
    apply,
    at_limit,
    nominal_free,
    standing,
    tolerances_away,
)
from dtbacklash.diagnose.fit.problem import Fit, weights_for
from dtbacklash.diagnose.fit.refit import fit
from dtbacklash.diagnose.propose.locate import Bank, Score, bank
from dtbacklash.diagnose.search.attempts import attempt, best_of_each, finish
from dtbacklash.diagnose.search.beyond_tolerance import beyond_instead, explains_alone
from dtbacklash.diagnose.search.leave_out import eliminate, refit_with
from dtbacklash.diagnose.search.objections import objection
from dtbacklash.diagnose.search.order import (
    apart,
    hopeful,
    is_found_already,
    promising,
    runners_up,
    siblings,
    simplest_first,
    twins,
)
from dtbacklash.diagnose.search.own_value import own_instead, own_parameter
from dtbacklash.diagnose.search.rivals import note_instead, reconsider
from dtbacklash.diagnose.search.trials import Asked, Search, Trial
from dtbacklash.diagnose.settings import settings
from dtbacklash.diagnose.spread import spread
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.rig import Rig

#: where all that was found only led out of a wrong recalibration, the search begins once more from the right one
ATTEMPTS = 2
#: of an effect that the rig has and the machine may not have, this share is left where its fit begins
ALMOST_GONE = 1e-3
#: before effects are looked for, one element's own parameter is tried where its signature leaves at most this share
OWN_LIKELY = 0.7


def silent(text: str, share: float) -> None:
    """What to call with a text and a share, 0 to 1, where nobody asked for progress."""


def search(evidence: Evidence, say: Callable[[str, float], None] = silent) -> Search:
    """Find the effects that the recording needs, one after the other.

    Where one wrong number alone leaves nothing but noise, one effect is held against it first, and more are looked for
    only if that fits better: a conspiracy of several is less likely than one wrong number.
    """
    say("recalibrating the nominal rig", 0.02)
    nominal = _recalibrated(evidence)
    found = Search(evidence, nominal, nominal, [])
    if explains_alone(found, _recalibrated) or own_parameter(evidence, nominal, OWN_LIKELY):
        found.most = 1
        _explain(found, say)
        if found.beyond is not None or not found.order:
            return found
        found.most = settings().effects_max
    _explain(found, say)
    return found


def _explain(found: Search, say: Callable[[str, float], None]) -> None:
    """Add effects as long as they earn their place, take out what is not needed, and try one wrong number instead."""
    before = list(found.order)
    for _ in range(ATTEMPTS):
        _add_all(found, say)
        if not found.order:
            break
        say("trying to do without", 0.8)
        eliminate(found.evidence, found)
        if found.order:
            break
    if before and found.order == before:
        return  # nothing has joined since they were judged
    found.as_well = None
    if len(found.order) > 1:
        say("what else would fit", 0.9)
        reconsider(found.evidence, found, list(found.order), settings().final_rivals)
    beyond_instead(found, _recalibrated)
    if found.beyond is None:
        own_instead(found)


def _recalibrated(evidence: Evidence) -> Fit:
    """The fit of the nominal rig's own parameters."""
    rig, free = evidence.nominal, nominal_free(evidence.nominal)
    direct = fit(evidence, rig, free)
    if not _astray(evidence, direct) or worst(evidence, direct) < settings().nearly_noise_floors:
        return direct
    led = fit(evidence, rig, free, approached(evidence, rig, free, np.zeros(len(free))))
    return min(direct, led, key=lambda f: merit(evidence, f))


def _astray(evidence: Evidence, fitted: Fit) -> bool:
    """Whether a nominal parameter is so far from nominal that it may have been led there by something else."""
    away = tolerances_away(evidence.nominal, fitted.rig)
    return max(away.values(), default=0.0) >= settings().astray_tolerances


def _add_all(found: Search, say: Callable[[str, float], None]) -> None:
    """Add effects until none earns its place."""
    rules = settings()
    while len(found.order) < found.most:
        _listen(found)
        say(f"looking for effect {len(found.order) + 1}", 0.1 + 0.2 * len(found.order))
        if not (_release(found.evidence, found) or _add(found.evidence, found)):
            break
        reconsider(found.evidence, found, found.order[:-1], rules.swap_rivals)
        _from_the_middle(found.evidence, found)


def _release(evidence: Evidence, found: Search) -> bool:
    """Let an effect of the nominal rig go that stands at the end of what its tolerance allows, where that earns it.

    Then it is found, as one that the rig lacked: what the rig says of it is wrong.
    """
    rig = found.fitted.rig
    known = [f for f in nominal_free(evidence.nominal, rig=rig) if f.effect]
    for key in dict.fromkeys((f.place, f.effect) for f in known if at_limit(f, standing(f, rig))):
        trials = [refit_with(evidence, found.fitted, [(key, values)]) for values in _let_go(rig, key)]
        trial = min(trials, key=lambda t: merit(evidence, t))
        if earns(evidence, found.fitted, trial, found.nominal):
            found.fitted = trial
            found.order.append(key)
            return True
    return False


def _let_go(rig: Rig, key: Key) -> list[Values]:
    """Where the fit of an effect begins that is let go: where it stands, and near nothing: it may not be there."""
    values, entry = rig.effects[key[0]][key[1]], find(rig.kind_at(key[0]), key[1], key[0])
    gone = {**values, **{p.name: ALMOST_GONE * values[p.name] for p in entry.amplitudes if p.neutral == 0.0}}
    return [values] if gone == values else [values, gone]


def _from_the_middle(evidence: Evidence, found: Search) -> None:
    """Fit once more from the nominal parameters where some were led astray before the effects were known."""
    if not _astray(evidence, found.fitted):
        return
    known = nominal_free(evidence.nominal, rig=found.fitted.rig)
    middle = apply(found.fitted.rig, known, np.zeros(len(known)))
    free, x = all_free(evidence, middle)
    if worst(evidence, found.fitted) > settings().nearly_noise_floors:
        x = approached(evidence, middle, free, x)
    again = fit(evidence, middle, free, x)
    if merit(evidence, again) < merit(evidence, found.fitted):
        found.fitted = again


def _listen(found: Search) -> None:
    """Lower the floor where what the last fit leaves shows that there is less noise."""
    before, evidence = found.evidence, found.evidence.quieter(found.fitted.residuals)
    if evidence is before:
        return

    def seen(fitted: Fit) -> Fit:
        residuals = evidence.rescaled(fitted.residuals, before)
        return replace(fitted, residuals=residuals, weights=weights_for(evidence, residuals))

    found.evidence = evidence
    found.nominal, found.fitted = seen(found.nominal), seen(found.fitted)
    for trial in found.trials:
        trial.fitted = seen(trial.fitted)
        trial.held_out = held_loss(evidence, trial.fitted)
    # the weights of the channels have changed: the same structure, fitted anew
    if not found.order:
        found.nominal = found.fitted = fit(evidence, evidence.nominal, found.nominal.free, found.nominal.x)
    else:
        found.fitted = refit_with(evidence, found.fitted, [(key, found.fitted.effects[key]) for key in found.order])


def scores_about(evidence: Evidence, found: Search) -> list[Score]:
    """The bank about the last fit, without what has been refused."""
    signatures, scores = _bank_about(evidence, found, found.fitted)
    found.last = Asked(evidence, scores, signatures.residual)
    return scores


def _bank_about(evidence: Evidence, found: Search, fitted: Fit) -> tuple[Bank, list[Score]]:
    listed = candidates(fitted.rig, evidence.blocks, evidence.moving)
    return bank(evidence, fitted, [c for c in listed if c.key not in found.refused])


def _add(evidence: Evidence, found: Search) -> bool:
    """Add the best candidate that earns its place."""
    rules = settings()
    scores = scores_about(evidence, found)
    if not found.scores:
        found.scores = scores
    current = found.fitted
    trials = spread(partial(attempt, evidence, current), promising(evidence, scores)[: rules.quick_fits])
    trials = _and_from_the_middle(evidence, found, trials)
    trials += spread(partial(attempt, evidence, current), twins(evidence, scores, trials))
    trials.sort(key=lambda t: merit(evidence, t.fitted))
    is_close = bool(trials) and trials[0].held_out < rules.close_floors
    far = rules.hopeless_ratio_noise if is_close else rules.hopeless_ratio
    rest = [
        t for t in trials[:rules.full_fits]
        if t.held_out < far * trials[0].held_out and hopeful(evidence, current, t.fitted)
        and not is_found_already(found, t)
    ]  # fmt: skip
    full = [partial(finish, evidence, current, t, near=True) for t in rest]
    full += [partial(finish, evidence, current, t) for t in runners_up(found, rest)]
    finished = spread(call, full)
    trials = [*finished, *(t for t in trials if t.key not in {f.key for f in finished})]
    trials += spread(partial(attempt, evidence, current), siblings(evidence, scores, trials))
    for trial in trials:
        trial.beside = len(found.order)
    found.trials += trials
    for group in apart(evidence, trials):
        for trial in simplest_first(evidence, group):
            if earns(evidence, found.fitted, trial.fitted, found.nominal) and _believed(evidence, found, trial):
                _take(evidence, found, trial, group)
                return True
    # in noise no two effects hide each other
    several = len(found.order) + 2 <= found.most and worst(evidence, current) > rules.noise_floors
    return several and _add_pair(evidence, found, trials)


def _and_from_the_middle(evidence: Evidence, found: Search, trials: list[Trial]) -> list[Trial]:
    """The same with trials that begin at the nominal parameters, where those of the last fit were led astray.

    Missing physics leads them there, and from there its own law may find no way back. The better trial of each counts.
    """
    current = found.fitted
    if not _astray(evidence, current) or worst(evidence, current) < settings().nearly_noise_floors:
        return trials
    known = nominal_free(evidence.nominal, rig=current.rig)
    middle = fit(evidence, apply(current.rig, known, np.zeros(len(known))), [])
    scores = promising(evidence, _bank_about(evidence, found, middle)[1])[: settings().quick_fits]
    again = spread(partial(attempt, evidence, current, near=middle.rig), scores)
    return best_of_each(evidence, [*trials, *again])


def _take(evidence: Evidence, found: Search, trial: Trial, group: list[Trial]) -> None:
    """Add what was tried; ``group`` : what was tried beside it."""
    note_instead(evidence, found, trial.key, (found.fitted, trial.fitted), group)
    found.fitted, trial.verdict = trial.fitted, "added"
    found.order.append(trial.key)
    found.tried[trial.key] = [t for t in group if t is not trial]
    found.rivals[trial.key] = [t for t in found.tried[trial.key] if same(evidence, trial.fitted, t.fitted)]


def _add_pair(evidence: Evidence, found: Search, trials: list[Trial]) -> bool:
    """Add two effects of which the first takes away enough, but not surely: what the second makes hides that.

    Friction that differs by direction and is not known to does: with the one half of it the moves to the one side fit
    better, and those to the other side worse. Each is tried without the other in the end.
    """
    rules, current = settings(), found.fitted
    able = [
        t for t in sorted(trials, key=lambda t: merit(evidence, t.fitted))
        if paired(evidence, current, t.fitted)[0] > rules.earn_excess_share
        and not objection(evidence, t.fitted.rig, t.key)
    ]  # fmt: skip
    for first in able[: rules.pair_firsts]:
        scores = _bank_about(evidence, found, first.fitted)[1]
        quick = spread(partial(attempt, evidence, first.fitted), promising(evidence, scores)[: rules.quick_fits])
        quick.sort(key=lambda t: merit(evidence, t.fitted))
        beside = spread(partial(finish, evidence, first.fitted, near=True), quick[: rules.full_fits])
        for trial in beside:
            trial.beside = len(found.order) + 1
        found.trials += beside
        for second in simplest_first(evidence, sorted(beside, key=lambda t: merit(evidence, t.fitted))):
            sure = earns(evidence, first.fitted, second.fitted, found.nominal)
            if sure and earns(evidence, current, second.fitted, found.nominal) and _believed(evidence, found, second):
                _take(evidence, found, first, trials)
                _take(evidence, found, second, beside)
                return True
    return False


def _believed(evidence: Evidence, found: Search, trial: Trial) -> bool:
    """Whether nothing speaks against a trial; else it is refused, and not tried again."""
    why = objection(evidence, trial.fitted.rig, trial.key)
    if why:
        found.refused[trial.key] = trial.verdict = f"fits, but {why}"
    return not why
