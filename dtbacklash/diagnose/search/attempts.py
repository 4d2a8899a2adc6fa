"""A candidate is fitted beside what is named: quickly, to see what it promises, and in full.

A law that waves over a position has a local minimum for each wave more or less over the travel; the regression that
starts it tells the right one only roughly. So a full fit also tries the neighbouring minima.
"""

import numpy as np

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import held_loss, lead, merit, worst
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import FULL, QUICK, Rounds
from dtbacklash.diagnose.propose.locate import Score
from dtbacklash.diagnose.search.leave_out import refit_with
from dtbacklash.diagnose.search.model import Trial
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Role, Values
from dtbacklash.physics.rig import Rig

#: where a fit begins anew, an effect has this share of what the bank gives it: it grows with what it takes over
WEAK = 0.1


def attempt(evidence: Evidence, current: Fit, score: Score) -> Trial:
    """The best quick fit: from where ``current`` stands and, where it leaves more than noise, from the nominal rig.

    Parameters make up for what is missing as well as they can, and from there the way to the truth may be barred.
    """
    key, values = score.candidate.key, score.values
    fits = [refit_with(evidence, current, [(key, values)], rounds=QUICK)]
    if worst(evidence, current) > SETTINGS.nearly_noise_floors:
        weak = weakened(current.rig, key, values, WEAK)
        fits.append(refit_with(evidence, current, [(key, weak)], rounds=QUICK, near=evidence.nominal))
    fitted = min(fits, key=lambda f: merit(evidence, f))
    return Trial(key, score, fitted, held_loss(evidence, fitted))


def weakened(rig: Rig, key: Key, values: Values, share: float) -> Values:
    """The values of an effect with a share of its amplitudes."""
    amplitudes = find(rig.kind_at(key[0]), key[1], key[0]).amplitudes
    return {**values, **{p.name: share * values[p.name] for p in amplitudes if p.neutral == 0.0 and p.name in values}}


def finish(evidence: Evidence, current: Fit, trial: Trial, near: bool = False, rounds: Rounds = FULL) -> Trial:
    """A full fit; ``near`` : the trial was a quick one beside the same effects, and is gone on with."""
    values = trial.fitted.rig.effect(*trial.key)
    if values is None:
        return trial
    fitted = refit_with(
        evidence, current, [(trial.key, values)], near=trial.fitted.rig if near else None, rounds=rounds
    )
    if rounds is FULL and lead(evidence, current, fitted).clear:
        fitted = in_the_best_valley(evidence, current, trial.key, fitted)
    return Trial(trial.key, trial.score, fitted, held_loss(evidence, fitted))


def best_of_each(evidence: Evidence, trials: list[Trial]) -> list[Trial]:
    """The best trial of each candidate, the best first."""
    best: dict[Key, Trial] = {}
    for trial in sorted(trials, key=lambda t: merit(evidence, t.fitted)):
        best.setdefault(trial.key, trial)
    return list(best.values())


#: so many to one side are looked at: further away the regression is not wrong
VALLEYS = 10


def in_the_best_valley(evidence: Evidence, current: Fit, key: Key, fitted: Fit) -> Fit:
    """A full fit of a law beside those of ``current``, where the number of waves explains most."""
    best = _best_valley(evidence, current, key, fitted)
    values = best.rig.effect(*key)
    if best is fitted or values is None:
        return fitted
    again = refit_with(evidence, current, [(key, values)], near=best.rig)
    return min(fitted, again, key=lambda f: merit(evidence, f))


def _best_valley(evidence: Evidence, current: Fit, key: Key, fitted: Fit) -> Fit:
    """The best of a fit and of quick ones in the valleys beside it; itself where its law does not wave."""
    place, name = key
    entry, values = find(evidence.nominal.kind_at(place), name, place), fitted.rig.effect(*key)
    wave, angle = entry.of_role(Role.WAVE), entry.of_role(Role.ANGLE)
    if wave is None or angle is None or values is None or (way := evidence.moving(place).way) <= 0.0:
        return fitted
    lowest = evidence.moving.lowest(place)
    low, high = evidence.bounds(key).get(wave.name, (wave.low, wave.high))
    best = fitted
    for one_more in (2.0 * np.pi / way, -2.0 * np.pi / way):
        for _ in range(VALLEYS):
            values = best.rig.effect(*key) or values
            waves = values[wave.name] + one_more
            if not max(low, wave.low) < waves < min(high, wave.high):
                break
            # at both ends, where a motion is slow as it turns, the waves stay where they are
            phase = float(np.angle(np.exp(1j * (values[angle.name] - one_more * lowest))))
            there = {**values, wave.name: waves, angle.name: phase}
            beside = refit_with(evidence, current, [(key, there)], rounds=QUICK, near=best.rig)
            if merit(evidence, beside) >= merit(evidence, best):
                break
            best = beside
        if best is not fitted:
            break
    return best
