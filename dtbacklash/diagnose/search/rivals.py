"""What was found is tried against its rivals once more, when others have joined: each hides, or bears, another one."""

from dataclasses import replace
from functools import partial

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import earns, held_loss, merit, nearly, same
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import QUICK
from dtbacklash.diagnose.search.attempts import best_of_each, finish
from dtbacklash.diagnose.search.leave_out import borne, fit_without
from dtbacklash.diagnose.search.objections import objection
from dtbacklash.diagnose.search.order import meet
from dtbacklash.diagnose.search.trials import Search, Trial
from dtbacklash.diagnose.settings import settings
from dtbacklash.diagnose.spread import spread
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig


def note_instead(evidence: Evidence, found: Search, key: Key, fits: tuple[Fit, Fit], trials: list[Trial]) -> None:
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


def reconsider(evidence: Evidence, found: Search, keys: list[Key], rivals: int) -> None:
    """Try effects against the best ``rivals`` of their time, now that others have joined."""
    for earlier in keys:
        key = earlier
        if not any(meet(evidence, key, other) for other in found.order if other != key):
            continue  # alone in its blocks: what was found when it was added stands
        if borne(found.fitted, key, evidence.records[0].sample_time_s):
            continue
        without = fit_without(found, key)
        former = [t for t in found.tried.get(key, []) if t.key not in (*found.order, *found.refused)]
        former = sorted(former, key=lambda t: t.held_out)[:rivals]
        trials = _against(found, without, former)
        note_instead(evidence, found, key, (without, found.fitted), trials)
        found.rivals[key] = []
        for trial in trials:
            if same(evidence, found.fitted, trial.fitted):
                found.rivals[key].append(trial)
            fewer = _count(evidence, trial.key) < _count(evidence, key)
            simpler = fewer and nearly(evidence, found.fitted, trial.fitted)
            better = merit(evidence, trial.fitted) < merit(evidence, found.fitted)
            better = better and not nearly(evidence, trial.fitted, found.fitted)
            if (simpler or better) and not objection(evidence, trial.fitted.rig, trial.key):
                found.fitted = trial.fitted
                found.order = [trial.key if k == key else k for k in found.order]
                trial.verdict = f"took the place of {key[1]}"
                found.trials.append(trial)
                found.rivals[trial.key] = [t for t in found.rivals.pop(key) if t is not trial]
                found.tried[trial.key] = found.tried.pop(key, [])
                key = trial.key


def _against(found: Search, without: Fit, rivals: list[Trial]) -> list[Trial]:
    """The rivals in the place of an effect of the last fit; those that leave far more are not finished.

    What has been fitted beside the same effects before is not fitted again.
    """
    evidence, made = found.evidence, {t.key: t for beside, t in found.against if beside is without}
    most = settings().hopeless_ratio * max(held_loss(evidence, found.fitted), settings().close_floors)
    starts = [(t, rig) for t in rivals if t.key not in made for rig in _starts(evidence, without, t, most)]
    looks = spread(lambda start: finish(evidence, replace(without, rig=start[1]), start[0], rounds=QUICK), starts)
    quick = best_of_each(evidence, looks)
    near = [t for t in quick if t.held_out < most]
    fresh = spread(partial(_gone_on_with, evidence, without), near) + [t for t in quick if t.held_out >= most]
    found.against += [(without, t) for t in fresh]
    return fresh + [made[t.key] for t in rivals if t.key in made]


def _starts(evidence: Evidence, without: Fit, rival: Trial, most: float) -> list[Rig]:
    """The rigs from which a rival is fitted beside the effects of ``without``: as they stand there, and as beside it.

    Without any of two effects that share a motion the other one takes over what it can, and from there the way to where
    it stands beside a rival may be barred: where that was as good as ``most``, it is another beginning.
    """
    beside = without.rig if rival.held_out >= most else _as_beside(evidence, without, rival)
    return [without.rig] if beside is without.rig else [without.rig, beside]


def _as_beside(evidence: Evidence, without: Fit, rival: Trial) -> Rig:
    """The rig of ``without`` with its effects that share a block with a rival as they stand beside that."""
    rig = without.rig
    for key, values in rival.fitted.effects.items():
        if key in without.effects and meet(evidence, key, rival.key):
            rig = rig.with_effect(*key, values)
    return rig


def _gone_on_with(evidence: Evidence, without: Fit, trial: Trial) -> Trial:
    """A full fit from where a quick one ended, in all that shares a block with it."""
    return finish(evidence, replace(without, rig=_as_beside(evidence, without, trial)), trial, near=True)


def _count(evidence: Evidence, key: Key) -> int:
    """How many parameters an effect has."""
    return len(find(evidence.nominal.kind_at(key[0]), key[1], key[0]).parameters)
