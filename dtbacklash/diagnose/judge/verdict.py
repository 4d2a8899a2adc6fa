"""Verdict: what a finished search amounts to, from what its last fit leaves and what had to move."""

from dataclasses import dataclass

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.fit.comparison import other_formulations
from dtbacklash.diagnose.fit.free import Errors, Key, apply, nominal_free, standing, tolerances_away
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.judge.free_form import Recovered
from dtbacklash.diagnose.result import CONSISTENT, MISSING, PARAMETERS, UNEXPLAINED, Verdict
from dtbacklash.diagnose.search.model import Model
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.shown import Explained
from dtbacklash.physics.rig import Rig

#: such a residual is more than noise from here on (floors, mean square)
COLOURED_FLOORS = 1.05
#: the same of the part of a recording where it is larger (floors, mean square)
NOISE_PART_FLOORS = 2.0
#: a parameter that moved by less has not (share of its tolerance)
MOVED_SHARE = 0.2
#: nor one by less than this: it follows another along a direction that cannot be seen (standard errors)
MOVED_ERRORS = 0.7

#: parameter of the rig, or place.effect.parameter of an effect that it has -> (value, standard error)
Moved = dict[str, tuple[float, float]]
#: what is left is small beside what was missing where it is less than this share of its mean square
LEFT_SMALL = 0.25
#: a channel shows the mismatch where it has this share of the largest mean square, in floors
SHOWS = 0.01


@dataclass(frozen=True)
class BlockLeft:
    """What the last fit leaves of one block.

    share : of the recalibrated model's excess over the floor, in the worst channel; 0 where noise is left.
    real : whether it is more than noise and more than what another formulation of the same laws would leave.
    formulation : what that would be, the largest mean square of a channel, in units of the floor's.
    """

    share: float
    real: bool
    formulation: float


def decide(
    model: Model, left: dict[str, BlockLeft], depends: bool, sure: bool, explained: Explained, moved: Moved
) -> Verdict:
    """The verdict.

    left : per block. depends : whether what is left depends on a state, see :func:`depends_on`. sure : whether a
    finding is. explained : how much of the mismatch is.
    """
    if not explained.beats_a_constant:
        return UNEXPLAINED
    noise = not depends and not any(block.real for block in left.values())
    if explained.enough or noise:
        return MISSING if model.keys else PARAMETERS if moved else CONSISTENT
    small = _share_left(model) < LEFT_SMALL
    return MISSING if sure and small else UNEXPLAINED


def _share_left(model: Model) -> float:
    """Share of the recalibrated rig's excess over the floor that is left of what judges, in the worst channel."""
    evidence = model.evidence
    before, after = (evidence.mean_square(f.residuals, "held") for f in (model.nominal, model.fitted))
    rows = [(a - 1.0, b - 1.0) for name in before for a, b in zip(after[name], before[name], strict=True)]
    most = max(b for _, b in rows)
    # a channel that hardly shows the mismatch does not say how much of it is left
    return max(max(a, 0.0) / b if b > 0.0 else 0.0 for a, b in rows if b >= SHOWS * most) if most > 0.0 else 0.0


def remaining(
    model: Model, left_out: dict[Key, Residuals], white: set[str], coloured: set[str]
) -> dict[str, BlockLeft]:
    """Per block, what the last fit leaves.

    left_out : per effect of the rig, what is left without it. white : the channels of which white noise is left; a
    little more of that than was expected is a floor that was expected too low. coloured : those of which something is
    left that no noise would; of that a little is more than noise.
    """
    evidence = model.evidence
    first, last = _squares(evidence, model.nominal), _squares(evidence, model.fitted)
    least, left = evidence.least(), {}
    channels = {block.name: block.channels for block in evidence.blocks}
    other = {part: other_formulations(evidence, model.fitted, left_out, part) for part in ("train", "held")}
    for name in least:
        most = np.where([c in coloured for c in channels[name]], COLOURED_FLOORS, SETTINGS.noise_floors)
        quiet = last[0][name] < most * least[name]
        # what happens in one part only has not been explained either: then that part counts
        once = quiet & (last[1][name] > NOISE_PART_FLOORS * least[name])
        after = np.where(once, last[1][name], last[0][name]) - 1.0
        before = np.where(once, first[1][name], first[0][name]) - 1.0
        above = ~quiet | once
        also = SETTINGS.formulation_deviations * model.formulations.get(name, np.zeros(len(channels[name])))
        parts = {part: other[part][name] + also for part in ("train", "held")}
        formulation = np.where(once, np.maximum(parts["train"], parts["held"]), parts["held"])
        noisy = np.array([c in white for c in channels[name]]) & (last[1][name] < NOISE_PART_FLOORS)
        real = above & (after > formulation) & ~noisy
        share = float(np.max(np.where(above, after / np.maximum(before, 1e-9), 0.0)))
        left[name] = BlockLeft(share, bool(real.any()), float(formulation.max()))
    return left


def depends_on(form: Recovered | None, left: dict[str, BlockLeft]) -> bool:
    """Whether what is left depends on a state: an effort over it, with no law assumed, beats nothing on unseen data.

    By more than another formulation of the rig's laws would.
    """
    least = max(SETTINGS.depends_floors, *(block.formulation for block in left.values()))
    return form is not None and form.t > SETTINGS.depends_errors and form.fall > least


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
    moved = [name for name in values if away[name] > MOVED_SHARE] or list(values)
    least = min(MOVED_ERRORS, max((clearly[name] for name in moved), default=0.0))
    return {name: values[name] for name in moved if clearly[name] >= least}


def _needed(evidence: Evidence, fitted: Fit) -> bool:
    """Whether recalibration improves the held-out part at all."""
    nominal = evidence.mean_square(evidence.residuals(_uncalibrated(evidence, fitted)), "held")
    here = evidence.mean_square(fitted.residuals, "held")
    # what lies below the floor is noise either way
    return any(bool(np.any(nominal[n] > SETTINGS.needed_ratio * np.maximum(here[n], 1.0))) for n in here)


def _uncalibrated(evidence: Evidence, fitted: Fit) -> Rig:
    """The fitted rig with the parameters as they were given."""
    known = nominal_free(evidence.nominal, rig=fitted.rig)
    return apply(fitted.rig, known, np.zeros(len(known)))
