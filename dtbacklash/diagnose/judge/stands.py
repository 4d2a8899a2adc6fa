"""Whether a name stands: its effect is needed, and neither another place nor another law does as well in its stead.

Every statement is one comparison (:func:`.comparison.lead`) of two fits that have ended, to the same samples under the
same pull: the model, and the model with a rival in the place of the effect, with everything else fitted anew. The law
also has to have the form of an effort of free form over its own state.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from dtbacklash.diagnose.fit.comparison import TOLD, Lead, formulations, lead, merit, ratio_in_each
from dtbacklash.diagnose.fit.free import Key
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import ON
from dtbacklash.diagnose.named import Alternative, Ground, Stands
from dtbacklash.diagnose.search.leave_out import fit_without, refit_with
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.diagnose.shown import LawShown
from dtbacklash.diagnose.spread import spread
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.drawing import drawing_of
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.rig import Rig

#: so many rivals at the place, and elsewhere, are fitted in the place of an effect: the best when it was found
RIVALS = 2
#: a law explains this share of the effort of free form over its state
FORM = 0.9


class Start(NamedTuple):
    """Where the fit of a rival begins: its values, and the rig in whose nominal parameters; None: the model's."""

    values: Values
    near: Rig | None = None


@dataclass(frozen=True)
class Rival:
    """Another effect in the place of a named one: its fit, and what the model leads it by."""

    key: Key
    fitted: Fit
    behind: Lead


def stands(model: Model, log: Log, key: Key, law: LawShown | None, rivals: list[Rival]) -> Stands:
    """What a name rests on.

    law : with the effort of free form; None where it has no state. rivals : that were fitted in its place.
    """
    share = law.share if law is not None and math.isfinite(law.share) else None
    elsewhere = _against([r for r in rivals if r.key[0] != key[0]])
    here = _against([r for r in rivals if r.key[0] == key[0]])
    formed = share is None or share >= FORM
    law_ground = Ground(here.stands and formed, here.ratio, here.t, here.agree, here.against, share)
    without = fit_without(model, log, key) if len(model.named) > 1 else model.nominal
    allowed = formulations(model.evidence, without)
    needed = lead(model.evidence, without, model.fitted, TOLD, "used", allowed)
    each = ratio_in_each(model.evidence, without, model.fitted)
    size = Ground(needed.clear, needed.ratio, needed.t, needed.agree, recordings=each if len(each) > 1 else ())
    return Stands(elsewhere, law_ground, size)


def _against(rivals: list[Rival]) -> Ground:
    """The ground of the closest of some rivals."""
    if not rivals:
        return Ground(True)
    close = min(rivals, key=lambda r: (r.behind.clear, r.behind.ratio))
    behind = close.behind
    return Ground(behind.clear, behind.ratio, behind.t, behind.agree, Alternative(*close.key))


def leader(model: Model, rivals: dict[Key, list[Rival]]) -> tuple[Key, Rival] | None:
    """The named effect and the rival in whose place clearly less is left; None if there is none."""
    ahead = [
        (key, rival) for key, group in rivals.items() for rival in group
        if not rival.behind.clear and lead(model.evidence, model.fitted, rival.fitted, part="used").clear
    ]  # fmt: skip
    return min(ahead, key=lambda pair: merit(model.evidence, pair[1].fitted), default=None)


def rivals_of(
    model: Model, log: Log, key: Key, law: LawShown | None, tell: Callable[[int, int], None] = lambda done, of: None
) -> list[Rival]:  # fmt: skip
    """The effects that came nearest to a named one, and its law at other places, fitted in its place.

    A law with more parameters that comes out as the named one is not a rival. tell : called with (done, of).
    """
    starts = _starts(model, log, key)
    fits = spread(lambda other: _in_place(model, key, other, starts[other]), starts, tell)
    rivals = [
        Rival(other, fitted, lead(model.evidence, fitted, model.fitted, TOLD, "used"))
        for other, fitted in zip(starts, fits, strict=True) if fitted is not None
    ]  # fmt: skip
    return [r for r in rivals if r.behind.clear or not _is_the_same_law(model, key, r, law)]


def _is_the_same_law(model: Model, key: Key, rival: Rival, law: LawShown | None) -> bool:
    """Whether a law with more parameters has the efforts of the named one wherever the recording went."""
    place, rig = key[0], model.fitted.rig
    one, other = (find(rig.kind_at(k[0]), k[1], k[0]) for k in (key, rival.key))
    mine, its, values = drawing_of(one), drawing_of(other), rival.fitted.rig.effect(*rival.key)
    if law is None or mine is None or its is None or values is None or rival.key[0] != place:
        return False
    if mine.state != its.state or "loop" in (mine.shape, its.shape) or len(other.parameters) <= len(one.parameters):
        return False
    apart = its.effort(values, rig.elements[place].values, law.law_state) - law.law_effort
    return float(apart @ apart) <= (1.0 - FORM) * float(law.law_effort @ law.law_effort)


def _starts(model: Model, log: Log, key: Key) -> dict[Key, list[Start]]:
    """Rival -> where its fits begin: as it was tried, and the same law elsewhere also with the values of the named."""
    tried, mine = sorted(model.about(key).tried, key=lambda t: t.held_out), model.fitted.rig.effect(*key) or {}
    starts: dict[Key, list[Start]] = {}
    for there in (True, False):
        group = [t for t in tried if (t.key[0] == key[0]) is there and t.key not in model.keys]
        chosen = {t.key: t for t in reversed(group)}  # the best of each
        for trial in sorted(chosen.values(), key=lambda t: t.held_out)[:RIVALS]:
            if values := trial.fitted.rig.effect(*trial.key):
                starts[trial.key] = [Start(values, trial.fitted.rig)]
    for score in log.scores:
        other = score.candidate.key
        if other[1] == key[1] and other[0] != key[0] and other not in model.keys:
            alike = {p.name for p in score.candidate.effect.parameters} == set(mine)
            starts.setdefault(other, []).append(Start(mine if alike else score.values))
    return starts


def _in_place(model: Model, key: Key, other: Key, starts: list[Start]) -> Fit | None:
    """The best fit with another effect in the place of a named one; None if such a rig cannot be."""
    evidence = model.evidence
    try:
        fits = [refit_with(evidence, model.fitted, [(other, s.values)], key, ON, near=s.near) for s in starts]
    except UserError:
        return None
    return min(fits, key=lambda f: merit(evidence, f))
