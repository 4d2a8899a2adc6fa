"""One parameter of the rig may be off by far more than its tolerance: looked at before physics is said to be missing.

Tolerances are what the user believes. Where one of them is wrong, an effect that nearly fits is found in its place, and
the other parameters go far from nominal to make up for the rest.
"""

from collections.abc import Callable
from dataclasses import replace

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import held_loss, is_noise, merit, same, worst
from dtbacklash.diagnose.fit.free import (
    known_free,
    nominal_free,
    standing,
    stands_at_limit,
    widened,
    with_tolerance,
)
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import QUICK, fit
from dtbacklash.diagnose.search.trials import Beyond, Search
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.rig import Rig

#: a quick fit that leaves more of the nominal rig's loss than this has not begun to explain it
BEGUN = 0.5


def beyond_tolerance(found: Search, recalibrate: Callable[[Evidence], Fit]) -> Beyond | None:
    """The parameter at its limit that alone, let go further, leaves little more than noise; None if there is none.

    recalibrate : fits the nominal rig of an evidence.
    """
    nominal, trials = found.evidence.nominal, []
    parameters = nominal.config.parameters
    for f in nominal_free(nominal, rig=found.nominal.rig):
        name = f.name
        if not f.effect and stands_at_limit(f, standing(f, found.nominal.rig)):
            wide = widened(parameters[name].tolerance)
            if wide <= parameters[name].tolerance:
                continue  # nobody claimed to know it
            evidence = replace(found.evidence, nominal=with_tolerance(nominal, name, wide))
            if _hopeless(found, evidence):
                continue
            trials.append(Beyond(name, parameters[name].tolerance, evidence, recalibrate(evidence)))
    able = [trial for trial in trials if worst(trial.evidence, trial.fitted) < settings().nearly_noise_floors]
    return min(able, key=lambda trial: merit(trial.evidence, trial.fitted), default=None)


def _hopeless(found: Search, evidence: Evidence) -> bool:
    """Whether a quick fit leaves far more than noise, or than what was found, and most of it."""
    rules = settings()
    quick = fit(evidence, evidence.nominal, *known_free(evidence, found.nominal.rig), rounds=QUICK)
    if worst(found.evidence, found.fitted) > rules.nearly_noise_floors:
        most = max(BEGUN * held_loss(found.evidence, found.nominal), rules.hopeless_ratio)
    else:
        most = rules.hopeless_ratio * max(held_loss(found.evidence, found.fitted), 1.0)
    return held_loss(evidence, quick) > most


def explains_alone(found: Search, recalibrate: Callable[[Evidence], Fit]) -> bool:
    """Whether one parameter, beyond its tolerance, leaves nothing but noise where the nominal rig leaves more.

    Then no two effects are looked for: a conspiracy of them is less likely than one wrong number.
    """
    if is_noise(found.evidence, found.fitted):
        return False
    trial = beyond_tolerance(found, recalibrate)
    return trial is not None and is_noise(trial.evidence, trial.fitted)


def beyond_instead(found: Search, recalibrate: Callable[[Evidence], Fit]) -> None:
    """Let one parameter go beyond its tolerance where that does better; as well as findings, it is said.

    Instead of all findings, or of several parameters that stand at their limits to make up for it.
    """
    trial = beyond_tolerance(found, recalibrate)
    if trial is None:
        return
    if merit(trial.evidence, trial.fitted) + settings().earn_penalty < merit(found.evidence, found.fitted):
        found.refused |= dict.fromkeys(found.order, f"`{trial.name}`, beyond its tolerance, does better alone")
        found.evidence, found.nominal, found.fitted, found.order = trial.evidence, trial.fitted, trial.fitted, []
        found.beyond = trial
    elif found.order and same(trial.evidence, found.fitted, trial.fitted):
        found.as_well = trial


def believed(rig: Rig, trial: Beyond | None) -> Rig:
    """A rig with the tolerance that was given for the parameter which went beyond it, if one did."""
    return rig if trial is None else with_tolerance(rig, trial.name, trial.tolerance)
