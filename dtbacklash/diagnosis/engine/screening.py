"""Screening of proposed rigs: quick fits of all on the beginning, exact fits of the best on all."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.attempts import attempt, attempts
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.parameters import Key, taken_out
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.errors import UserError
from dtbacklash.physics.effects import slots
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

if TYPE_CHECKING:
    from dtbacklash.diagnosis.engine.selection import StepwiseSelection

#: a rig that was fitted quickly: squares with their cost, what was fitted, values; then score, rig, names, noise levels
_Rough = tuple[float, FitProblem, Floats]
_Tuned = tuple[float, Rig, tuple[Key, ...], NoiseLevels]


def screen(
    search: StepwiseSelection,
    model: FittedModel,
    proposals: list[tuple[Rig, tuple[Key, ...]]],
    best: int = 3,
    instead: Key | None = None,
) -> list[FittedModel]:
    """The likeliest of some rigs, best first: quick fits of all on the beginning, exact ones of the best on all.

    instead : the name in whose place they are tried; they may make less than what is a law.
    """
    if not proposals:
        return []
    quick, n = search.quick, np.log(search.quick.count)
    noise_levels = (
        search.segments.of_first(model.noise_levels)
        if len(model.noise_levels) != len(quick.predictors)
        else model.noise_levels
    )
    most = search.unknown(model)
    strict = quick.scaled(noise_levels, 0.1 if most > search.rules.unexplained_attention else 1.0)
    near = attempt(_nominal_columns, search, model, strict) or {}

    def solved(one: tuple[Rig, tuple[Key, ...]]) -> _Rough | None:
        problem = FitProblem(quick, *one, search.motion, model.stiff, model.smooth)
        x, squares = problem.solved(strict, 3, near)
        return (squares + n * problem.counts, problem, x) if np.isfinite(squares) else None

    def tuned(one: _Rough) -> _Tuned | None:
        _, problem, x = one
        rig = problem.rig(x)
        if any(rig.effect(*key) is None for key in problem.keys):
            return None  # it came to nothing
        noise_levels, likelihood = quick.tuned(rig, strict, steps=(2.0, 0.7), refresh=1)
        beside = problem.prior_residuals(x)
        return likelihood + float(beside @ beside) + n * problem.counts, rig, problem.keys, noise_levels

    rough = sorted(attempts(solved, proposals), key=lambda r: r[0])
    gone = search.rejected | ({instead} if instead else set())
    rough += attempts(solved, attempt(_other_filters, rough, model, gone) or [])
    rough.sort(key=lambda r: r[0])
    kept: dict[frozenset[Key], _Rough] = {}
    for one in rough:  # another start of the same is none more
        if len(kept) < best + 2:
            kept.setdefault(frozenset(one[1].keys), one)
    second = [found for one in kept.values() if (found := attempt(tuned, one)) is not None]
    second.sort(key=lambda r: r[0])
    few = min(len(keys) for _, _, keys, _ in second) if second else 0
    near_best = [s for s in second if s[0] < second[0][0] + 0.2 * quick.count][:best]
    # a pair may have been first by what it cannot keep
    simple = [s for s in second if len(s[2]) == few][:1] if all(len(s[2]) > few for s in near_best) else []

    def climbed(one: _Tuned) -> FittedModel | None:
        _, rig, keys, noise_levels = one
        rungs = (0.1, 0.1, 1.0) if quick.most_unknown(noise_levels) > 3e-3 else (1.0,)
        return FitProblem(quick, rig, keys, search.motion, model.stiff, model.smooth).homotopy_fit(
            noise_levels, None, rungs
        )

    first = near_best + simple
    some: list[FittedModel] = []
    # where the likeliest end at a bound, which the data have not chosen, others are tried
    for few_at_once in (first, [s for s in second if s not in first]):
        some = some or [m for m in attempts(climbed, few_at_once) if not m.at_end]
    return _best_on_all(search, sorted(some, key=lambda m: m.score), model, few, instead is not None)


def _best_on_all(
    search: StepwiseSelection, ranked: list[FittedModel], model: FittedModel, few: int, small: bool
) -> list[FittedModel]:
    """At most two of quickly fitted models, fitted on all; what fits the beginning alone is no better there."""
    full: list[FittedModel] = []
    for m in ranked:
        if len(full) < 2 and (m.score < ranked[0].score + 0.1 * search.quick.count or len(m.keys) == few):
            done = attempt(_fit_on_all, search, m, model, small) or []
            full += [better for better in done if better.score < model.score]
    return sorted(full, key=lambda m: m.score)


def _fit_on_all(search: StepwiseSelection, m: FittedModel, model: FittedModel, small: bool) -> list[FittedModel]:
    """A proposed model fitted on all, without what is too small a law beside the model; none where that is all."""
    other = len(m.noise_levels) != len(model.noise_levels)
    start = replace(m, noise_levels=search.segments.back(m.noise_levels, model.noise_levels)) if other else m
    done = search.fitted(m.rig, start, m.keys, steps=4)
    while done is not None and not done.at_end:
        # what takes the unknown force away is never too small
        idle = (
            ()
            if small or search.unknown(done) < search.rules.clearing_ratio * search.unknown(model)
            else idle_laws(search, done)
        )
        if not idle:
            return [done]
        if len(done.keys) - 1 <= len(model.keys):
            return []
        done = search.without(done, idle[0])
    return []


def _nominal_columns(search: StepwiseSelection, model: FittedModel, noise_levels: NoiseLevels) -> dict[str, Floats]:
    """Nominal columns around a model on the beginning."""
    problem = FitProblem(search.quick, model.rig, model.keys, search.motion, model.stiff, model.smooth)
    gains = search.quick.gains(model.rig, noise_levels)
    x = problem.start()
    rows = problem.residuals(x, gains)
    if rows is None:
        return {}
    data = problem.innovation_rows
    return {f.title: problem.sensitivity(j, x, gains, rows)[:data] for j, f in enumerate(problem.free) if f.prior}


def _other_filters(
    rough: list[_Rough], model: FittedModel, without: Collection[Key]
) -> list[tuple[Rig, tuple[Key, ...]]]:
    """Other filters in the place of the best new one of fitted rigs, or of a sensor's delay: each as late as that."""
    for _, problem, x in rough:
        rig = problem.rig(x)
        for key in (k for k in problem.keys if k not in model.keys):
            entry, values = rig.takes(key[0])[key[1]], rig.effect(*key)
            late = entry.slot.late(values) if isinstance(entry.slot, slots.Filter) and values else 0.0
            late = values[entry.size.name] if entry.is_delay and values else late
            others = {
                e.name: e.slot for e in rig.takes(key[0]).values()
                if isinstance(e.slot, slots.Filter)
                and rig.effect(key[0], e.name) is None
                and (key[0], e.name) not in without
            }  # fmt: skip
            if not late > 0.0 or not others:
                continue
            bare, rest = taken_out(rig, key), [k for k in problem.keys if k != key]
            return [
                (bare.with_effect(key[0], name, slot.as_late(late)), (*rest, (key[0], name)))
                for name, slot in others.items()
            ]
    return []


def idle_laws(search: StepwiseSelection, model: FittedModel) -> tuple[Key, ...]:
    """Laws of a model that make little of what moves their place, and hardly more than what stays unknown."""
    least = min(search.rules.min_effect, search.unknown(model) / search.rules.clearing_ratio)
    return tuple(key for key in model.keys if share_of(search.segments, model, key) < least)


def share_of(segments: Segments, model: FittedModel, key: Key) -> float:
    """The part that a law makes of what acts at its place, or a sensor's error of what it reads.

    Rms, or a tenth of its largest where it acts rarely.
    """
    entry = model.rig.takes(key[0])[key[1]]
    if entry.is_delay:
        return np.inf
    most = 0.0
    try:
        bare = taken_out(model.rig, key)
        all_gains = segments.gains(model.rig, model.noise_levels)
    except UserError:
        return np.inf
    except np.linalg.LinAlgError:
        return 0.0
    for p, gains in zip(segments.predictors, all_gains, strict=True):
        found = p.run(model.rig, gains)
        n, v = len(p.linear.bodies), p.linear.speed
        gaps = sum(bool(bare.active(place, slots.JointPlay)) for place in bare.effects)
        needs = len(p.simulated.linear(bare).states) + 2 * gaps  # with position and speed in each
        only_gap = isinstance(entry.slot, slots.JointPlay) and not gaps
        if found.X.shape[1] != needs + 2 * only_gap:
            return np.inf
        X = found.X[:, :needs]
        if key[0].startswith(SENSOR_PREFIX):
            there = p.simulated.shown(model.rig, found.X)
            made, whole = there - p.simulated.shown(bare, X), there.std(axis=0)
        else:
            there = p.simulated.onwards(model.rig, found.X)[:-1, v : v + n]
            made = there - p.simulated.onwards(bare, X)[:-1, v : v + n]
            whole = p.force / p.linear.inertia * p.readings.sample_time_s
        size = np.maximum(np.sqrt((made**2).mean(axis=0)), 0.1 * np.abs(made).max(axis=0))
        share = size / (whole + 1e-300)
        most = max(most, float(np.nan_to_num(share, nan=np.inf).max()))
    return most
