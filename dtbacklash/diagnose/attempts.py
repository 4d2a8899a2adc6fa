"""A candidate is fitted beside what was found: quickly, to see what it promises, and in full."""

from dtbacklash.diagnose.earn import earns, held_loss, merit
from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.free import Key
from dtbacklash.diagnose.leave_out import refit_with
from dtbacklash.diagnose.locate import Score
from dtbacklash.diagnose.problem import Fit
from dtbacklash.diagnose.refit import FULL, QUICK, Rounds
from dtbacklash.diagnose.trials import Trial
from dtbacklash.diagnose.valleys import in_the_best_valley
from dtbacklash.physics.rig import Rig


def attempt(evidence: Evidence, current: Fit, score: Score, near: Rig | None = None) -> Trial:
    """A quick fit. ``near`` : a rig in whose parameters it begins, if not in those of ``current``."""
    fitted = refit_with(evidence, current, [(score.candidate.key, score.values)], rounds=QUICK, near=near)
    return Trial(score.candidate.key, score, fitted, held_loss(evidence, fitted))


def finish(evidence: Evidence, current: Fit, trial: Trial, near: bool = False, rounds: Rounds = FULL) -> Trial:
    """A full fit; ``near`` : the trial was a quick one beside the same effects, and is gone on with."""
    values = trial.fitted.rig.effect(*trial.key)
    if values is None:
        return trial
    fitted = refit_with(
        evidence, current, [(trial.key, values)], near=trial.fitted.rig if near else None, rounds=rounds
    )
    if rounds is FULL and earns(evidence, current, fitted, current):
        fitted = in_the_best_valley(evidence, current, trial.key, fitted)
    return Trial(trial.key, trial.score, fitted, held_loss(evidence, fitted))


def best_of_each(evidence: Evidence, trials: list[Trial]) -> list[Trial]:
    """The best trial of each candidate, the best first."""
    best: dict[Key, Trial] = {}
    for trial in sorted(trials, key=lambda t: merit(evidence, t.fitted)):
        best.setdefault(trial.key, trial)
    return list(best.values())
