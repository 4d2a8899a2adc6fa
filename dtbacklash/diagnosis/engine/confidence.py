"""How sure a name is: what leads every rival in every view is, and what a few others fit alike is one of these.

A rival is the rig without the name, with each of the best other names or pairs in its place, and with a table over a
state of its place, each fitted anew and compared at several horizons (:mod:`.horizons`). A name that loses to the rig
without it explains nothing there, however well it fits at the short one: it leaves, and the search goes on without it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dtbacklash.diagnosis.engine.attempts import attempt
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities, Proposal
from dtbacklash.diagnosis.engine.fit import FittedModel
from dtbacklash.diagnosis.engine.horizons import LONG, VIEWS, WHITE, Horizons, paired_t
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.engine.predictor import ASTRAY
from dtbacklash.diagnosis.engine.scale_errors import ScaleError, numbers_instead
from dtbacklash.diagnosis.engine.selection import StepwiseSelection
from dtbacklash.diagnosis.findings import Confidence
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Role

#: t of a rival that does not follow the recording at the noise levels at which models are compared
OPEN = 0.0


@dataclass(frozen=True)
class Rival:
    """What was tried in the place of a name.

    keys : what stands there instead; none where nothing does. model : with it. lead : its score less that of the model
    with the name. t : view -> lead over it in standard errors. agree : share of the stretches, in all views.
    ratio : rms that it leaves at the long horizon, over that of the model. container : whether its law holds the
    name's as a special case. beaten : whether the name leads it in every view, and it costs more, at the noise levels
    of the name and at its own. ahead : whether it leads the name in one, and leaves less there by as much.
    suffices : whether it leads where the readings correct little, parameters counted as Akaike does (Vuong,
    Econometrica 57 (1989) 307): of the rig without the name, that the name adds nothing there.
    """

    keys: tuple[Key, ...]
    model: FittedModel = field(repr=False)
    lead: float
    t: dict[str, float]
    agree: float
    ratio: float
    container: bool
    beaten: bool
    ahead: bool = False
    suffices: bool = False

    @property
    def least(self) -> float:
        """The smallest lead, in standard errors."""
        return min(self.t.values())


@dataclass(frozen=True)
class JudgedModel:
    """A model and what each of its names rests on.

    rivals : per name. explains : per name, the fall of -2 log likelihood beside the model without it. adds : per name,
    what the best table at its place adds beside it, a share of that. tables : per name, the table that comes nearest to
    the force that is missing without it (recovered, with its errors).
    certainty : per name; see :class:`ConfidenceTest`.
    rest : the best tables beside all names, best first. numbers : of the rig, that a wrong gain only stands for.
    simpler : per name, the law of its place that does the same, as the motion does not reach the end of its shape, or
    empty.
    """

    model: FittedModel
    rivals: Mapping[Key, tuple[Rival, ...]] = field(default_factory=dict)
    explains: Mapping[Key, float] = field(default_factory=dict)
    adds: Mapping[Key, float] = field(default_factory=dict)
    tables: Mapping[Key, tuple[Proposal, ...]] = field(default_factory=dict)
    certainty: Mapping[Key, Confidence] = field(default_factory=dict)
    rest: tuple[Proposal, ...] = ()
    numbers: tuple[ScaleError, ...] = ()
    simpler: Mapping[Key, str] = field(default_factory=dict)


class ConfidenceTest:
    """Judges the model at which a search has ended.

    A name is ``sure`` if it leads every rival in every view, and ``one_of`` if those that it does not lead are laws or
    tables of its place, or single laws of other places that fit alike, or if another law of its place may be meant
    (:attr:`JudgedModel.simpler`, :attr:`JudgedModel.adds`); else ``partial``. All names are partial where
    most of what was unknown before is left, and where a number of the rig does what a gain does, so that no size is
    known.
    """

    def __init__(self, search: StepwiseSelection) -> None:
        self.search, self.segments, self.rules = search, search.segments, search.rules
        self._take(search.now)

    def _take(self, model: FittedModel) -> None:
        """Judge this model."""
        self.model, self.horizons = model, Horizons(self.segments, self.search.motion, model)

    def judged(self) -> JudgedModel:
        """All names of the model that explain something."""
        search, without = self.search, self._without()
        model = self.model
        rest = self._tables(model, None)
        first = self.segments.of_first(model.noise_levels)
        numbers = numbers_instead(search.quick, first, model, search.motion, self.rules.min_gain)
        rivals: dict[Key, tuple[Rival, ...]] = {}
        explains: dict[Key, float] = {}
        adds: dict[Key, float] = {}
        tables: dict[Key, tuple[Proposal, ...]] = {}
        certainty: dict[Key, Confidence] = {}
        simpler: dict[Key, str] = {}
        for n, (key, bare) in enumerate(without.items()):
            search.tell(f"trying what else could stand for {key[1]} at {key[0]}", 0.6 + 0.3 * n / len(without))
            less = bare.model
            explains[key] = max(less.score - model.score, 0.0)
            tables[key] = self._tables(less, key[0])
            tried = [*self._others(less, key), *self._with_tables(less, tables[key])]
            rivals[key] = bare, *(r for r in (self._rival(m, key, less) for m in tried) if r is not None)
            best = max((p.gain for p in rest if p.keys[0][0] == key[0]), default=0.0)
            adds[key] = max(best, 0.0) / max(explains[key], 1e-300)
            entry = find(model.rig.kind_at(key[0]), key[1], key[0])
            simpler[key] = entry.simpler_at(model.rig.effects[key[0]][key[1]], search.motion(key[0]))
            doubted = bool(simpler[key]) or adds[key] >= self.rules.tie_ratio
            known = not numbers and search.explains(model)
            certainty[key] = _certainty(key, rivals[key], doubted) if known else "partial"
        return JudgedModel(model, rivals, explains, adds, tables, certainty, rest, tuple(numbers), simpler)

    def _without(self) -> dict[Key, Rival]:
        """Per name, the rig without it; where a name loses to that, the search goes on without the name first."""
        while True:
            found: dict[Key, Rival] = {}
            for key in self.model.keys:
                if find(self.model.rig.kind_at(key[0]), key[1], key[0]).is_table:
                    continue
                less = self.search.without(self.model, key)
                rival = self._rival(less, key, less) if less is not None else None
                if rival is not None:
                    found[key] = rival
            ahead = [key for key, rival in found.items() if rival.suffices]
            if not ahead:
                return found
            worst = min(ahead, key=lambda key: found[key].ratio)
            self.search.reject(worst, found[worst].model)
            self._take(self.search.now)

    def _others(self, less: FittedModel, key: Key) -> list[FittedModel]:
        """The best other names in the place of one: those of the search, and those that columns now propose."""
        search = self.search
        known = {tuple(sorted(m.keys)): m for m in search.beaten.get(key, []) if key not in m.keys}
        known |= {tuple(sorted(m.keys)): m for m in search.alternatives(less, key)}
        kept = [m for k, m in known.items() if set(less.keys) <= set(k)]
        return sorted(kept, key=lambda m: m.score)[:3]

    def _tables(self, model: FittedModel, place: str | None) -> tuple[Proposal, ...]:
        """Tables that explain something beside a model, at one place or anywhere, best first."""
        found = attempt(CandidateSensitivities, self.segments, model, model.noise_levels, tables=True)
        return tuple(p for p in (found.ranked if found else ()) if place is None or p.keys[0][0] == place)

    def _with_tables(self, less: FittedModel, tables: Sequence[Proposal]) -> list[FittedModel]:
        """The model without a name, with the best table of its place."""
        found = [self.search.tabled(less, p) for p in tables[:1]]
        return [m for m in found if m is not None]

    def _rival(self, m: FittedModel, key: Key, less: FittedModel) -> Rival | None:
        """A model in the place of a name, compared; None where its law holds the name's and explains hardly more."""
        keys = tuple(k for k in m.keys if k not in less.keys)
        container = self._contains(keys, key)
        gained, lead = less.score - self.model.score, m.score - self.model.score
        if container and -lead < self.rules.tie_ratio * max(gained, 0.0):
            return None
        mine, other = self.horizons.reference, attempt(self.horizons.squares, m)
        if mine is None or other is None:  # a rival that strays at these noise levels, far behind at its own, is none
            strays = mine is not None and lead > self.rules.min_gain * self.segments.count
            t, agree, ratio = dict.fromkeys(VIEWS, ASTRAY if strays else OPEN), 0.0, np.nan
            costs, ahead, suffices = lead, lead < -self.search.least, False
        else:
            t = {view: paired_t(other.views[view], mine.views[view]) for view in VIEWS}
            agree = float(np.mean([other.views[view] > mine.views[view] for view in VIEWS]))
            ratio = float(np.sqrt(other.views[LONG].sum() / mine.views[LONG].sum()))
            costs = other.cost - mine.cost
            falls = {v: self.segments.count * np.log(mine.views[v].sum() / other.views[v].sum()) for v in VIEWS}
            ahead = any(t[view] < -self.rules.min_t and falls[view] > self.search.least for view in VIEWS)
            fewer = np.exp(-2.0 * (self.model.counts - m.counts) / self.segments.count)
            suffices = min(paired_t(fewer * other.views[view], mine.views[view]) for view in (LONG, WHITE)) < 0.0
        # what earns no name tells none from another, either: at the noise levels of the name, and at its own
        beaten = min(t.values()) > self.rules.min_t and min(costs, lead) > self.search.least
        return Rival(keys, m, lead, t, agree, ratio, container, beaten, ahead, suffices)

    def _contains(self, keys: tuple[Key, ...], key: Key) -> bool:
        """Whether another law at the place is a table, becomes it, or has more parameters: friction, filter, wave."""
        if len(keys) != 1 or keys[0][0] != key[0]:
            return False
        kind = self.model.rig.kind_at(key[0])
        mine, other = find(kind, key[1], key[0]), find(kind, keys[0][1], key[0])
        becomes = other.becomes is not None and other.becomes[1] == mine.name
        waves = all(effect.of_role(Role.ANGLE) is not None for effect in (mine, other))
        alike = type(mine.slot) is type(other.slot) and (isinstance(mine.slot, (slots.Contact, slots.Filter)) or waves)
        return other.is_table or becomes or (alike and other.counts > mine.counts)


def confidence_set(rivals: Sequence[Rival]) -> list[Rival]:
    """The rivals that a name does not lead: with it a model confidence set.

    Hansen, Lunde and Nason, Econometrica 79 (2011) 453. Two names that lead nowhere are none where one of them does it
    alone.
    """
    open_ = [rival for rival in rivals if not rival.beaten]
    alone = {rival.keys[0] for rival in open_ if len(rival.keys) == 1}
    return [rival for rival in open_ if len(rival.keys) < 2 or rival.ahead or alone.isdisjoint(rival.keys)]


def _certainty(key: Key, rivals: Sequence[Rival], doubted: bool) -> Confidence:
    """How sure a name is by what it leads. doubted : whether another law of its place may be meant.

    A law of another place that leads the name in one view shows that neither is right.
    """
    left = confidence_set(rivals)
    elsewhere = [rival for rival in left if any(place != key[0] for place, _ in rival.keys)]
    if any(not rival.keys for rival in left) or any(len(r.keys) > 1 or r.ahead for r in elsewhere):
        return "partial"
    return "one_of" if left or doubted else "sure"
