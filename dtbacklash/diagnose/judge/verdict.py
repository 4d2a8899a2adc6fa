"""Verdict: what a finished search amounts to, from what its last fit leaves and what had to move."""

from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.comparison import other_formulations
from dtbacklash.diagnose.fit.free import Errors, Key, apply, as_given, nominal_free, standing, tolerances_away
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.judge.free_form import Recovered
from dtbacklash.diagnose.result import CONSISTENT, MISSING, PARAMETERS, UNEXPLAINED, Confidence, Verdict
from dtbacklash.diagnose.search.model import Model
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

#: parameter of the rig, or place.effect.parameter of an effect that it has -> (value, standard error)
Moved = dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Left:
    """What the last fit leaves of one block.

    share : of the recalibrated model's excess over the floor, in the worst channel; 0 where noise is left.
    real : whether it is more than noise and more than what another formulation of the same laws would leave.
    formulation : what that would be, the largest mean square of a channel, in units of the floor's.
    """

    share: float
    real: bool
    formulation: float


def decide(left: dict[str, Left], depends: bool, model: Model, moved: Moved) -> Verdict:
    """The verdict. left : per block. depends : whether what is left depends on a state, see :func:`depends_on`."""
    if depends or any(block.real for block in left.values()):
        return UNEXPLAINED
    if model.keys:
        return MISSING
    return PARAMETERS if moved else CONSISTENT


def remaining(model: Model, left_out: dict[Key, Residuals], white: set[str], coloured: set[str]) -> dict[str, Left]:
    """Per block, what the last fit leaves.

    left_out : per effect of the rig, what is left without it. white : the channels of which white noise is left; a
    little more of that than was expected is a floor that was expected too low. coloured : those of which something is
    left that no noise would; of that a little is more than noise.
    """
    evidence = model.evidence
    rules = settings()
    first, last = _squares(evidence, model.nominal), _squares(evidence, model.fitted)
    least, left = evidence.least(), {}
    channels = {block.name: block.channels for block in evidence.blocks}
    other = {part: other_formulations(evidence, model.fitted, left_out, part) for part in ("train", "held")}
    for name in least:
        most = np.where([c in coloured for c in channels[name]], rules.coloured_floors, rules.noise_floors)
        quiet = last[0][name] < most * least[name]
        # what happens in one part only has not been explained either: then that part counts
        once = quiet & (last[1][name] > rules.noise_part_floors * least[name])
        after = np.where(once, last[1][name], last[0][name]) - 1.0
        before = np.where(once, first[1][name], first[0][name]) - 1.0
        above = ~quiet | once
        also = rules.formulation_deviations * model.formulations.get(name, np.zeros(len(channels[name])))
        parts = {part: other[part][name] + also for part in ("train", "held")}
        formulation = np.where(once, np.maximum(parts["train"], parts["held"]), parts["held"])
        noisy = np.array([c in white for c in channels[name]]) & (last[1][name] < rules.noise_part_floors)
        real = above & (after > formulation) & ~noisy
        share = float(np.max(np.where(above, after / np.maximum(before, 1e-9), 0.0)))
        left[name] = Left(share, bool(real.any()), float(formulation.max()))
    return left


def depends_on(form: Recovered | None, left: dict[str, Left]) -> bool:
    """Whether what is left depends on a state: an effort over it, with no law assumed, beats nothing on unseen data.

    By more than another formulation of the rig's laws would.
    """
    least = max(settings().depends_floors, *(block.formulation for block in left.values()))
    return form is not None and form.t > settings().depends_errors and form.fall > least


def confidence(model: Model, key: Key, left_out: Residuals, rest: Recovered | None, unexplained: bool) -> Confidence:
    """How sure a finding is where something is left: its name stands if what is left lies elsewhere and is small.

    Findings near what is left count as left: they stand in for it.

    Where a wrong value of a parameter would explain as much, no finding is sure.

    rest : where what is left lies; None where nothing shows that. unexplained : whether anything is left.
    """
    evidence = model.evidence
    rules = settings()
    if not unexplained:
        return "sure" if model.could_be is None else "partial"
    # what shows itself nowhere may be here
    if rest is None or not rest.shown or rest.place in _near(evidence.nominal, key[0]):
        return "partial"
    unknown = evidence.mean_square(_without_stand_ins(model, rest), "held")
    without = evidence.mean_square(left_out, "held")
    worth = max(
        float(np.max((without[n] - 1.0) / np.maximum(unknown[n] - 1.0, rules.noise_floors - 1.0))) for n in unknown
    )
    return "sure" if worth > rules.stands_out_ratio else "partial"


def _without_stand_ins(model: Model, rest: Recovered) -> Residuals:
    """What is left without the findings near the rest, which stand in for the same unknown physics."""
    evidence = model.evidence
    rig, places = model.fitted.rig, set[str]()
    for key in model.keys:
        if rest.place in _near(evidence.nominal, key[0]):
            rig, places = as_given(evidence.nominal, rig, key), places | {key[0]}
    return evidence.residuals(rig, model.fitted.residuals, places) if places else model.fitted.residuals


def _near(rig: Rig, place: str) -> set[str]:
    """The place, its neighbours, and all that drives it or is driven by it: any effort there moves it alike.

    A sensor is where what it measures is.
    """
    if place.startswith(SENSOR_PREFIX):
        return {place} | _near(rig, rig.sensors[place.removeprefix(SENSOR_PREFIX)].of)
    ends = {
        e.name: {n for to in e.neighbours.values() for n in ([to] if isinstance(to, str) else to)}
        for e in rig.elements.values()
    }
    near = {place, *ends.get(place, ()), *(name for name, to in ends.items() if place in to)}
    driving = {e.neighbours["drives"]: e.name for e in rig.elements.values() if "drives" in e.neighbours}
    driven = {drives: to for to, drives in driving.items()}
    for way in (driving, driven):
        end = place
        while end in way:
            end = way[end]
            near.add(end)
    return near


def _squares(evidence: Evidence, fitted: Fit) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Per block, (channels,) the smaller and the larger mean square of the two parts, in units of the floor's."""
    train, held = evidence.mean_square(fitted.residuals, "train"), evidence.mean_square(fitted.residuals, "held")
    return (
        {name: np.minimum(train[name], held[name]) for name in train},
        {name: np.maximum(train[name], held[name]) for name in train},
    )


def moved_parameters(evidence: Evidence, given: Rig, fitted: Fit, errors: Errors) -> Moved:
    """The parameters of the rig that had to move. given : the nominal rig with the tolerances that were given."""
    if not _needed(evidence, fitted):
        return {}
    values: Moved = {}
    clearly: dict[str, float] = {}
    for f in nominal_free(evidence.nominal, rig=fitted.rig):
        error, x = errors.get((f.place, f.effect, f.name)), standing(f, fitted.rig)
        if error is not None:
            values[f.title] = (f.value(x), error)
            clearly[f.title] = abs(x) * f.scale / max(error, 1e-300)
    away = tolerances_away(given, fitted.rig)
    # where all that moved did so by a trifle of its tolerance, that trifle was needed
    moved = [name for name in values if away[name] > settings().moved_share] or list(values)
    least = min(settings().moved_errors, max((clearly[name] for name in moved), default=0.0))
    return {name: values[name] for name in moved if clearly[name] >= least}


def _needed(evidence: Evidence, fitted: Fit) -> bool:
    """Whether recalibration improves the held-out part at all."""
    nominal = evidence.mean_square(evidence.residuals(_uncalibrated(evidence, fitted)), "held")
    here = evidence.mean_square(fitted.residuals, "held")
    # what lies below the floor is noise either way
    return any(bool(np.any(nominal[n] > settings().needed_ratio * np.maximum(here[n], 1.0))) for n in here)


def _uncalibrated(evidence: Evidence, fitted: Fit) -> Rig:
    """The fitted rig with the parameters as they were given."""
    known = nominal_free(evidence.nominal, rig=fitted.rig)
    return apply(fitted.rig, known, np.zeros(len(known)))
