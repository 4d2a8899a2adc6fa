"""Name: try the best candidates in full, keep what earns its place on data that it was not fitted to, and go on.

Adding is greedy with a look ahead; what was added first is tried against its rivals once more when others have joined,
and each is tried without in the end.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from dtbacklash.diagnose.candidates import candidates, motion_of
from dtbacklash.diagnose.compare import places_of
from dtbacklash.diagnose.earn import FLOOR_MIN, PENALTY_MIN, SHARE_MIN, earns, held_loss, merit, nearly, paired, same
from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.locate import Score, bank
from dtbacklash.diagnose.refit import Fit, all_free, effect_free, fit, nominal_free, weights_for
from dtbacklash.diagnose.spread import spread
from dtbacklash.errors import UserError
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.plant import Floats

#: effects at most in one diagnosis
EFFECTS_MAX = 4
#: of a bank's candidates that promise more than GAIN_MIN, as many are fitted, quickly and then in full
FITTED, FINISHED, GAIN_MIN = 5, 3, 12.0
#: rivals that an effect is tried against when another has joined, and in the end
SWAPPED, RIVALS = 2, 4
#: signatures whose cosine is above this are those of twins; as many are fitted beside the best candidates
TWIN, TWINS_MAX = 0.95, 3
#: a quick fit that has not gained this share of what has to be earned is not finished either
HOPE = 0.25
#: held-out loss, in floors, below which a fit leaves noise only
CLOSE = 1.1
#: a quick fit that leaves this many times what the best one leaves is not finished: where that is noise, and elsewhere
HOPELESS = (1.5, 4.0)
#: a nominal parameter this many tolerances away may have been led astray: the fit starts again from the nominal ones
ASTRAY = 2.5

Key = tuple[str, str]


@dataclass
class Trial:
    """One candidate that was fitted: the fit, what it leaves of the held-out part, beside how many found effects."""

    key: Key
    score: Score
    fitted: Fit
    held_out: float
    verdict: str = ""
    beside: int = 0


@dataclass
class Search:
    """What the search did: the nominal rig's fit, the last fit, every trial, and per effect what would fit as well."""

    evidence: Evidence
    nominal: Fit
    fitted: Fit
    order: list[Key]
    trials: list[Trial] = field(default_factory=list)
    rivals: dict[Key, list[Trial]] = field(default_factory=dict)
    #: per effect what was fitted beside it when it was added
    tried: dict[Key, list[Trial]] = field(default_factory=dict)
    scores: list[Score] = field(default_factory=list)
    #: per effect the simplest at its place that would be named if it were not there, but explains less
    instead: dict[Key, Trial] = field(default_factory=dict)


def refit_with(evidence: Evidence, current: Fit, added: list[tuple[Key, dict[str, float]]], left_out: Key | None = None,
               rounds: int = 2, evaluations: int = 8) -> Fit:  # fmt: skip
    """Fit effects anew with some added or one left out, with the nominal parameters of the blocks they touch."""
    base = current.rig
    for (place, name), values in added:
        base = base.with_effect(place, name, values)
    if left_out:
        base = base.with_effect(*left_out, None)
    changed = {key[0] for key, _ in added} | ({left_out[0]} if left_out else set())
    touched = set().union(*(
        places_of(rig, b) for b in evidence.blocks for rig in (base, current.rig) if changed & places_of(rig, b)
    ))  # fmt: skip
    free = nominal_free(evidence.nominal, touched)
    start = []
    for f in free:
        value = current.rig.config.parameters[f.name].value
        start.append((value - f.centre) / f.scale)
    for place, there in base.effects.items():
        for name, values in there.items():
            if place in touched:
                more = effect_free(base, place, name, values)
                free += more
                start += [0.0] * len(more)
    known = {
        b.name: current.residuals[b.name] for b in evidence.blocks if not changed & places_of(base, b)
        and not changed & places_of(current.rig, b)
    }  # fmt: skip
    return fit(evidence, base, free, np.array(start), known, rounds, evaluations)


def search(evidence: Evidence, progress: Callable[[str, float], None] | None = None) -> Search:
    """Find the effects that the recording needs, one after the other."""
    say = progress or (lambda text, share: None)
    rig = evidence.nominal
    say("recalibrating the nominal rig", 0.02)
    nominal = fit(evidence, rig, nominal_free(rig))
    found = Search(evidence, nominal, nominal, [])
    while len(found.order) < EFFECTS_MAX:
        _listen(found)
        say(f"looking for effect {len(found.order) + 1}", 0.1 + 0.2 * len(found.order))
        if not _add(found.evidence, found):
            break
        _reconsider(found.evidence, found, found.order[:-1], SWAPPED)
        _from_the_middle(found.evidence, found)
    say("trying to do without", 0.8)
    _eliminate(found.evidence, found)
    if len(found.order) > 1:
        say("what else would fit", 0.9)
        _reconsider(found.evidence, found, list(found.order), RIVALS)
    return found


def _from_the_middle(evidence: Evidence, found: Search) -> None:
    """Fit once more from the nominal parameters where some were led astray before the effects were known."""
    values = {n: p.value for n, p in evidence.nominal.config.parameters.items()}
    away = [
        abs(found.fitted.rig.config.parameters[n].value - p.value) / max(abs(p.value) * p.tolerance, 1e-300)
        for n, p in evidence.nominal.config.parameters.items() if p.tolerance
    ]  # fmt: skip
    if max(away, default=0.0) < ASTRAY:
        return
    middle = found.fitted.rig.with_parameters(values)
    again = fit(evidence, middle, *all_free(evidence.nominal, middle), rounds=3)
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


def scores_about(evidence: Evidence, fitted: Fit) -> list[Score]:
    """The bank about a fit."""
    motion = motion_of(fitted.rig, evidence.blocks, evidence.records)
    return bank(evidence, fitted, candidates(fitted.rig, evidence.blocks, motion))[1]


def _promising(evidence: Evidence, scores: list[Score]) -> list[Score]:
    """The scores that promise as much as an effect has to earn."""
    samples = sum(int(r.train.sum()) for r in evidence.records)
    return [s for s in scores if s.gain > max(GAIN_MIN, 0.5 * FLOOR_MIN * samples * s.lightest)]


def _try(evidence: Evidence, current: Fit, score: Score) -> Trial:
    """A quick fit."""
    fitted = refit_with(evidence, current, [(score.candidate.key, score.values)], None, 1, 5)
    return Trial(score.candidate.key, score, fitted, held_loss(evidence, fitted))


def _finish(evidence: Evidence, current: Fit, trial: Trial) -> Trial:
    values = trial.fitted.rig.effect(*trial.key)
    if values is None:
        return trial
    fitted = refit_with(evidence, current, [(trial.key, values)])
    return Trial(trial.key, trial.score, fitted, held_loss(evidence, fitted))


def _add(evidence: Evidence, found: Search) -> bool:
    """Add the best candidate that earns its place."""
    scores = scores_about(evidence, found.fitted)
    if not found.scores:
        found.scores = scores
    current = found.fitted
    trials = spread(partial(_try, evidence, current), _promising(evidence, scores)[:FITTED])
    trials += spread(partial(_try, evidence, current), _twins(evidence, scores, trials))
    trials.sort(key=lambda t: merit(evidence, t.fitted))
    far = HOPELESS[0] if trials and trials[0].held_out < CLOSE else HOPELESS[1]
    rest = [
        t for t in trials[:FINISHED]
        if t.held_out < far * trials[0].held_out and _hopeful(evidence, current, t.fitted)
    ]  # fmt: skip
    finished = spread(partial(_finish, evidence, current), rest)
    trials = [*finished, *(t for t in trials if all(t is not r for r in rest))]
    trials += spread(partial(_try, evidence, current), _siblings(evidence, scores, trials))
    for trial in trials:
        trial.beside = len(found.order)
    found.trials += trials
    for group in _apart(evidence, trials):
        for trial in _simplest_first(evidence, group):
            if earns(evidence, found.fitted, trial.fitted, found.nominal):
                _note_instead(evidence, found, trial.key, (current, trial.fitted), group)
                found.fitted, trial.verdict = trial.fitted, "added"
                found.order.append(trial.key)
                found.tried[trial.key] = [t for t in group if t is not trial]
                found.rivals[trial.key] = [t for t in found.tried[trial.key] if same(evidence, trial.fitted, t.fitted)]
                return True
    return False


def _apart(evidence: Evidence, trials: list[Trial]) -> list[list[Trial]]:
    """All trials, the best first; then, should none of them earn its place, those that share no block with the best.

    What is the best in one block may be worth nothing there and still hide what is missing in another.
    """
    if not trials:
        return []
    best = min(trials, key=lambda t: merit(evidence, t.fitted))
    return [trials, [t for t in trials if not _meet(evidence, best.key, t.key)]]


def _twins(evidence: Evidence, scores: list[Score], trials: list[Trial]) -> list[Score]:
    """Those not tried yet whose signatures are almost that of the best trial."""
    best = min(trials, key=lambda t: merit(evidence, t.fitted), default=None)
    if best is None:
        return []
    known, mine = {t.key for t in trials}, best.score.signature
    near = [s for s in scores if s.candidate.key not in known and abs(_cosine(s.signature, mine)) > TWIN]
    return near[:TWINS_MAX]


def _cosine(a: Floats, b: Floats) -> float:
    return float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300)


def _siblings(evidence: Evidence, scores: list[Score], trials: list[Trial]) -> list[Score]:
    """The best trial's effect at the other places that take it, from the values that were fitted here.

    Only where noise is not all that is left: a resonance that is narrow or a stop that is seldom hit is found at the
    wrong place first, because its grid happens to be nearer there.
    """
    best = min(trials, key=lambda t: merit(evidence, t.fitted), default=None)
    values = best.fitted.rig.effect(*best.key) if best else None
    if best is None or values is None or best.held_out < CLOSE:
        return []
    known = {t.key for t in trials}
    return [
        replace(s, values=values) for s in scores
        if s.candidate.key[1] == best.key[1] and s.candidate.key not in known
        and s.candidate.effect.kind == best.score.candidate.effect.kind
    ]  # fmt: skip


def _hopeful(evidence: Evidence, before: Fit, quick: Fit) -> bool:
    """Whether a quick fit comes near to what it would have to earn."""
    share, floor, _ = paired(evidence, before, quick)
    relief = before.penalty - quick.penalty
    return (share > HOPE * SHARE_MIN and floor > HOPE * FLOOR_MIN) or relief > HOPE * PENALTY_MIN


def _note_instead(evidence: Evidence, found: Search, key: Key, fits: tuple[Fit, Fit], trials: list[Trial]) -> None:
    """Remember the simplest of the trials at the same place that explain less; ``fits`` : without ``key``, with it."""
    without, chosen = fits
    less = [
        t for t in trials
        if t.key != key and t.key[0] == key[0] and not same(evidence, chosen, t.fitted)
        and earns(evidence, without, t.fitted, found.nominal)
    ]  # fmt: skip
    found.instead.pop(key, None)
    if less:
        found.instead[key] = min(
            less, key=lambda t: (len(t.score.candidate.effect.parameters), merit(evidence, t.fitted))
        )


def _simplest_first(evidence: Evidence, trials: list[Trial]) -> list[Trial]:
    """Those that fit as well as the best, the one with the fewest parameters first."""
    ranked = sorted(trials, key=lambda t: merit(evidence, t.fitted))
    if not ranked:
        return []
    best = ranked[0]
    equal = [t for t in ranked if t is best or nearly(evidence, best.fitted, t.fitted)]
    return sorted(equal, key=lambda t: (len(t.score.candidate.effect.parameters), merit(evidence, t.fitted)))


def _reconsider(evidence: Evidence, found: Search, keys: list[Key], rivals: int) -> None:
    """Try effects against the best ``rivals`` of their time, now that others have joined."""
    for earlier in keys:
        key = earlier
        if not any(_meet(evidence, key, other) for other in found.order if other != key):
            continue  # alone in its blocks: what was found when it was added stands
        if _borne(found.fitted, key, evidence.records[0].sample_time_s):
            continue
        without = refit_with(evidence, found.fitted, [], key)
        former = [t for t in found.tried.get(key, []) if t.key not in found.order]
        former = sorted(former, key=lambda t: t.held_out)[:rivals]
        trials = spread(partial(_finish, evidence, without), former)
        _note_instead(evidence, found, key, (without, found.fitted), trials)
        found.rivals[key] = []
        for trial in trials:
            if same(evidence, found.fitted, trial.fitted):
                found.rivals[key].append(trial)
            fewer = _count(evidence, trial.key) < _count(evidence, key)
            simpler = fewer and nearly(evidence, found.fitted, trial.fitted)
            better = merit(evidence, trial.fitted) < merit(evidence, found.fitted)
            if simpler or (better and not nearly(evidence, trial.fitted, found.fitted)):
                found.fitted = trial.fitted
                found.order = [trial.key if k == key else k for k in found.order]
                trial.verdict = f"took the place of {key[1]}"
                found.trials.append(trial)
                found.rivals[trial.key] = [t for t in found.rivals.pop(key) if t is not trial]
                found.tried[trial.key] = found.tried.pop(key, [])
                key = trial.key


def _borne(fitted: Fit, key: Key, step_s: float) -> bool:
    """Whether another effect of the rig needs this one: a force on a mass that only a yielding screw lets move."""
    try:
        compile_plant(fitted.rig.with_effect(*key, None), step_s)
    except UserError:
        return True
    return False


def _meet(evidence: Evidence, first: Key, second: Key) -> bool:
    """Whether two effects act in the same block."""
    return any({first[0], second[0]} <= places_of(evidence.nominal, b) for b in evidence.blocks)


def _count(evidence: Evidence, key: Key) -> int:
    """How many parameters an effect has."""
    return len(find(evidence.nominal.kind_at(key[0]), key[1], key[0]).parameters)


def _eliminate(evidence: Evidence, found: Search) -> None:
    """Take out what does not earn its place beside the others."""
    for key in list(found.order):
        if len(found.order) < 2:
            return
        if _borne(found.fitted, key, evidence.records[0].sample_time_s):
            continue
        without = refit_with(evidence, found.fitted, [], key)
        if not earns(evidence, without, found.fitted, found.nominal):
            found.fitted = without
            found.order.remove(key)
