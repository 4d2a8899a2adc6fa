"""Named effects are tried against their rivals once more when others have joined: each may hide another one."""

from dataclasses import replace
from functools import partial

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import TOLD, alike, held_loss, lead
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import QUICK
from dtbacklash.diagnose.search.attempts import best_of_each, finish
from dtbacklash.diagnose.search.leave_out import borne, fit_without
from dtbacklash.diagnose.search.model import Log, Model, Trial
from dtbacklash.diagnose.search.order import meet
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.spread import spread
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig


def reconsider(model: Model, log: Log, keys: tuple[Key, ...], rivals: int, alone: bool = False) -> Model:
    """Try effects against the best ``rivals`` of their time, now that others have joined.

    alone : also one that is alone in its blocks; else what was tried when it was added stands.
    """
    for key in keys:
        joined = alone or any(meet(model.evidence, key, other) for other in model.keys if other != key)
        if joined and not borne(model, key):
            model = _against_rivals(model, log, key, rivals)
    return model


def _against_rivals(model: Model, log: Log, key: Key, most: int) -> Model:
    """The model with a rival in the place of an effect where it leads, or is simpler and fits as well."""
    evidence, without, named = model.evidence, fit_without(model, log, key), model.about(key)
    former = [t for t in named.tried if t.key not in (*model.keys, *log.refused)]
    trials = _in_place(model, log, without, sorted(former, key=lambda t: t.held_out)[:most])
    others = tuple(t for t in named.tried if t.key not in {trial.key for trial in trials})
    named = replace(named, tried=(*trials, *others))
    for trial in trials:
        fewer = _count(evidence, trial.key) < _count(evidence, named.key)
        simpler = fewer and alike(evidence, model.fitted, trial.fitted, TOLD)
        if simpler or lead(evidence, model.fitted, trial.fitted).clear:
            log.tried(evidence, [trial])
            log.verdicts.append((trial, f"took the place of {named.key[1]}"))
            former_key, named = named.key, replace(named, key=trial.key)
            model = model.instead(trial.fitted, former_key, named)
    return model.instead(model.fitted, named.key, named)


def _in_place(model: Model, log: Log, without: Fit, rivals: list[Trial]) -> list[Trial]:
    """The rivals in the place of an effect of the last fit; those that leave far more are not finished.

    What has been fitted beside the same effects before is not fitted again.
    """
    evidence, made = model.evidence, log.in_place(without)
    most = SETTINGS.hopeless_ratio * max(held_loss(evidence, model.fitted), SETTINGS.close_floors)
    starts = [(t, rig) for t in rivals if t.key not in made for rig in _starts(evidence, without, t, most)]
    looks = spread(lambda start: finish(evidence, replace(without, rig=start[1]), start[0], rounds=QUICK), starts)
    quick = best_of_each(evidence, looks)
    near = [t for t in quick if t.held_out < most]
    fresh = spread(partial(_gone_on_with, evidence, without), near) + [t for t in quick if t.held_out >= most]
    log.note_in_place(without, fresh)
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
