"""One loop: what joins, what leaves, what is exchanged; columns propose, quick fits sift, exact fits decide.

All models are compared by one number, the score of :class:`.fit.FittedModel`: -2 log likelihood with priors and log N
for each parameter. A name joins if it earns a share of the number of readings, and stays if taking it out costs that.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.attempts import attempt
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities, Proposal
from dtbacklash.diagnosis.engine.fit import STIFF, FitProblem, FittedModel, without_name
from dtbacklash.diagnosis.engine.hypotheses import Hypothesis
from dtbacklash.diagnosis.engine.motion import Motion, motion_of
from dtbacklash.diagnosis.engine.parameters import Key, taken_out
from dtbacklash.diagnosis.engine.predictor import Predictor
from dtbacklash.diagnosis.engine.proposals import alternatives_to, propose
from dtbacklash.diagnosis.engine.recording_effects import alike, differ
from dtbacklash.diagnosis.engine.scale_errors import ScaleError
from dtbacklash.diagnosis.engine.screening import screen
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.diagnosis.settings import SETTINGS, DiagnoseSettings
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find, simpler
from dtbacklash.physics.effects.slots import Filter, Lag, Late
from dtbacklash.physics.effects.table import VALUES
from dtbacklash.physics.rig import Rig

#: names that are looked for at most
MOST = 4
#: -2 log likelihood that anything has to earn: the best of some hundred columns of noise hardly reaches it
LEAST = 60.0
#: a rate is too coarse where a finer one leaves less than this share of the unknown force
CLOSER = 0.5
#: the beginning of a recording on which quick fits are made
SHARE = 1.0 / 3.0
#: slots that make a signal late: of a slow motion one is nearly the other
LATE = (Filter, Late)

Tell = Callable[[str, float], None]


@dataclass
class StepwiseSelection:
    """What a rig lacks, by stepwise selection.

    nothing : the recalibrated rig. now : the best model so far.
    names : the same before a table was added. beaten : name -> models that were tried in its place.
    tried : names -> the least score that an exact fit with them had. likely : what :meth:`preview` shows first.
    most : so many names are looked for. begin : a gain that is so far off that the search begins with it.
    differences : titles of what is free in each recording as the search found it to differ.
    apart : what names with a size in each recording would explain beside the model that was last proposed to.
    rejected : names that explain nothing at a longer horizon, and are proposed no more.
    exchanged : what was tried in the place of a name, by the names beside it, those rejected, and how stiff priors are.
    first_columns : what :meth:`preview` compared, for the first proposals.
    """

    segments: Segments
    rules: DiagnoseSettings = SETTINGS
    tell: Tell = lambda text, share: None
    finer: Callable[[FittedModel], float] | None = None
    most: int = MOST
    too_coarse: bool = False
    begin: ScaleError | None = None
    beaten: dict[Key, list[FittedModel]] = field(default_factory=dict)
    tried: dict[tuple[Key, ...], float] = field(default_factory=dict)
    gains: dict[Key, float] = field(default_factory=dict)
    likely: Key | None = None
    differences: tuple[str, ...] = ()
    apart: list[tuple[float, Hypothesis, Floats]] = field(default_factory=list)
    rejected: set[Key] = field(default_factory=set)
    exchanged: dict[tuple[object, ...], list[FittedModel]] = field(default_factory=dict)
    first_columns: tuple[FittedModel, Predictor, CandidateSensitivities | None] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Recalibrate the nominal rig."""
        rig = self.segments.nominal
        noise_levels, _ = self.segments.tuned(rig)
        self.look_at(noise_levels)
        far = self.begin.rig if self.begin else rig
        at = self.segments.tuned(far)[0] if self.begin else noise_levels
        self.motion: Motion = motion_of(self.segments, far, self.segments.gains(far, at))
        found = FitProblem(self.segments, rig, (), self.motion).homotopy_fit(noise_levels, None, (1.0,), 6)
        if found is None:
            raise UserError("recording", "", "the nominal rig does not follow it: its simulation does not stay finite")
        self.nothing = self.now = self.names = found
        keys = (self.begin.key,) if self.begin else ()
        begun = keys and FitProblem(self.segments, far, keys, self.motion).homotopy_fit(at, None, (1.0, 0.1, 1.0))
        if begun and not begun.at_end and begun.score < found.score - self.asked(begun, found):
            self.now = self.names = begun
        else:
            self.begin = None

    def run(self) -> FittedModel:
        """The whole search; it ends early where the rate turns out to be too coarse."""
        self.add_forward()
        self.too_coarse |= self.finer is not None and of_timing(self.now)
        if self.too_coarse:
            return self.now
        for _ in range(2):
            if not self.swap():
                break
            self.add_forward()
        self.simplify()
        if self.far(self.now):
            self.add_table()
        self.final_fit()
        return self.now

    def reject(self, key: Key, less: FittedModel) -> None:
        """Go on without a name, or what makes its place late as it does, from a model that does without it."""
        late = [e.name for e in less.rig.takes(key[0]).values() if isinstance(e.slot, LATE)]
        self.rejected |= {(key[0], name) for name in (late if key[1] in late else [key[1]])}
        self.now = self.fitted(less.rig, less, less.keys, (1.0, 0.1, 1.0), 5) or less
        self.finer = None
        self.run()

    def preview(self) -> None:
        """What explains most on the beginning, by its column: a first answer, and nothing else takes note of it."""
        self.first_columns = self.on_beginning(self.now)
        columns = self.first_columns[-1]
        self.likely = columns.ranked[0].keys[0] if columns and columns.ranked else None

    def on_beginning(self, model: FittedModel) -> tuple[FittedModel, Predictor, CandidateSensitivities | None]:
        """A model, the predictor of the beginning, and the columns around the model there; kept of :meth:`preview`."""
        beginning, kept = self.segments.predictors[self.segments.telling], self.first_columns
        if kept and kept[0] is model and kept[1] is beginning:
            return kept
        columns = attempt(CandidateSensitivities, self.quick, model, self.segments.of_first(model.noise_levels))
        self.first_columns = model, beginning, columns
        return self.first_columns

    def look_at(self, noise_levels: NoiseLevels) -> None:
        """Make quick fits on the stretch that says most of what is missing, at these noise levels."""
        self.segments = replace(self.segments, telling=self.segments.most_telling(noise_levels))
        self.quick = self.segments.first(SHARE)

    def unknown(self, model: FittedModel) -> float:
        """The largest unknown force of a model, a share of the motion."""
        return self.segments.most_unknown(model.noise_levels)

    def explains(self, model: FittedModel) -> bool:
        """Whether a model explains most of what was unknown before, or leaves hardly anything."""
        return self.unknown(model) < max(
            self.rules.unexplained_attention, self.rules.clearing_ratio * self.unknown(self.nothing)
        )

    def far(self, model: FittedModel) -> bool:
        """Whether much is unexplained, so that smaller noise levels see more than the present ones."""
        left = self.unknown(model)
        if not model.keys:
            return left > 3e-4
        return left > max(3e-3, 0.1 * self.unknown(self.nothing))

    def fitted(
        self,
        rig: Rig,
        model: FittedModel,
        keys: Sequence[Key],
        rungs: tuple[float, ...] = (1.0,),
        steps: int = 3,
        stiff: float | None = None,
    ) -> FittedModel | None:
        """A rig with these names fitted on all, from the noise levels of a model."""
        given = self.segments, rig, keys, self.motion, model.stiff if stiff is None else stiff, model.smooth
        found = attempt(lambda: FitProblem(*given).homotopy_fit(model.noise_levels, None, rungs, steps))
        if found is not None:
            key = tuple(sorted(found.keys))
            self.tried[key] = min(self.tried.get(key, np.inf), found.score)
        return found

    def without(self, model: FittedModel, key: Key, steps: int = 3, stiff: float | None = None) -> FittedModel | None:
        """A model without one of its names, fitted anew: what else explains it fits at the name's noise levels.

        Or from the noise levels that it then needs: a name may hide how far.
        """
        bare = attempt(without_name, self.segments, model, key)
        if bare is None:
            return None
        rungs = (1.0, 0.1, 1.0) if stiff is not None else (1.0,)
        starts = (replace(bare, noise_levels=model.noise_levels), bare)
        found = [self.fitted(start.rig, start, start.keys, rungs, steps, stiff) for start in starts]
        best = min((m for m in found if m is not None), key=lambda m: m.score, default=None)
        # a name that has come to nothing meanwhile is none
        return best and replace(best, keys=tuple(k for k in best.keys if best.rig.effect(*k) is not None))

    def add_forward(self) -> None:
        """Add the best name or pair while one earns its place."""
        count, been = self.segments.count, set()
        while len(self.now.keys) < self.most and frozenset(self.now.keys) not in been and not self.too_coarse:
            been.add(frozenset(self.now.keys))
            self.look_at(self.now.noise_levels)
            there = len(self.now.keys)
            self.tell(f"round {there + 1}: ranking what may be missing", 0.1 + 0.1 * there)
            proposed = propose(self, self.now)
            if proposed:
                self.tell(f"round {there + 1}: fitting the {len(proposed)} likeliest", 0.1 + 0.1 * there)
            self.first_columns = None
            found = screen(self, self.now, proposed)
            if attempt(differ, self, found):
                been.clear()
                continue
            if not found:
                return
            close = [m for m in found if m.score < found[0].score + self.rules.tie_ratio * self.rules.min_gain * count]
            best = min(close, key=lambda m: (m.counts, m.score))
            if best.score > self.now.score - self.asked(best, self.now):
                return
            if self.far(best):
                again = self.fitted(best.rig, best, best.keys, (0.1, 0.1, 1.0), 5)
                if again is not None and not again.at_end and again.score < best.score:
                    best = again
            new = [k for k in best.keys if k not in self.now.keys]
            for key in new:
                self.beaten[key] = [m for m in found if m is not best]
            self.take(best)

    def begin_with(self, model: FittedModel, differences: tuple[str, ...]) -> None:
        """Begin with a model of the same recordings at another rate, or with another course of the command.

        Its names are fitted anew, without those that come to nothing, and taken where together they earn their places.
        differences : see the attribute, of the search that found the model.
        """
        rig, keys, noise_levels = model.rig, model.keys, self.segments.tuned(model.rig)[0]
        while keys:
            start = replace(self.nothing, noise_levels=noise_levels)
            best = self.fitted(rig, start, keys, (1.0, 0.1, 1.0), 5)
            if best is None:
                return
            idle = {key for key in keys if key in best.ends or best.rig.effect(*key) is None}
            if not idle:
                if best.score < self.now.score - self.asked(best, self.now):
                    self.differences = differences
                    self.take(best)
                return
            keys = tuple(key for key in keys if key not in idle)
            for key in idle:
                rig = taken_out(rig, key)

    def take(self, best: FittedModel) -> None:
        """Go on from a better model, without what it makes idle; in finer steps, or at a faster rate, if it asks so."""
        if self.segments.refine(best.rig, best.noise_levels, self.rules.min_gain * self.segments.count):
            self.quick = self.segments.first(SHARE)
            best = self.fitted(best.rig, best, best.keys, (1.0, 0.1, 1.0), 5) or best
        self.now = best
        if self.finer is not None and self.unknown(best) > self.rules.max_unexplained:
            self.too_coarse = self.finer(best) < CLOSER * self.unknown(best)
        if not self.too_coarse:
            self.eliminate_backward()

    def eliminate_backward(self, stiff: float | None = None) -> None:
        """Out with what costs less than it is worth."""
        attempt(alike, self)
        for key in self.now.keys:
            if len(self.now.keys) < (2 if stiff is None else 1):
                return
            less = self.without(self.now, key, 3 if stiff is None else 6, stiff)
            if less is not None and not less.at_end and less.score < self.now.score + self.asked(self.now, less):
                self.now = less

    def asked(self, model: FittedModel, less: FittedModel) -> float:
        """What a model has to earn beside one that does without a name of it."""
        clears = self.unknown(model) < self.rules.clearing_ratio * self.unknown(less)
        return self.least if clears else self.rules.min_gain * self.segments.count

    @property
    def least(self) -> float:
        """What anything has to earn."""
        return max(self.rules.min_gain_if_clearing * self.segments.count, LEAST)

    def swap(self) -> bool:
        """Another name, or two, in the place of each of several; whether one was better."""
        for key in self.now.keys if len(self.now.keys) > 1 else ():
            self.tell(f"trying others in the place of {key[1]} at {key[0]}", 0.5)
            less = self.without(self.now, key)
            if less is None:
                continue
            found = self.beaten[key] = self.alternatives(less, key)
            if (
                found
                and found[0].score < self.now.score - self.rules.tie_ratio * self.rules.min_gain * self.segments.count
            ):
                self.now = found[0]
                self.eliminate_backward()
                return True
        return False

    def alternatives(self, less: FittedModel, key: Key) -> list[FittedModel]:
        """Others in the place of a name, looked for once of the same model. less : the model without the name."""
        asked = key, frozenset(self.now.keys), frozenset(self.rejected), self.differences, less.stiff
        if asked not in self.exchanged:
            self.exchanged[asked] = attempt(alternatives_to, self, less, key) or []
        return self.exchanged[asked]

    def simplify(self) -> None:
        """The simpler law that a name may become, where it explains hardly less."""
        for key in self.now.keys:
            self.now = attempt(self._simpler, key) or self.now

    def _simpler(self, key: Key) -> FittedModel | None:
        """The model with the simpler law in the place of a name; None where there is none, or it explains less.

        Where the motion does not reach the end of the name's shape, the simpler law may explain clearly less.
        """
        entry = find(self.now.rig.kind_at(key[0]), key[1], key[0])
        law = simpler(entry)
        if law is None or (key[0], law.name) in self.rejected or self.now.rig.effect(key[0], law.name) is not None:
            return None
        less = self.without(self.now, key)
        if less is None:
            return None
        values, other = self.now.rig.effects[key[0]][key[1]], (key[0], law.name)
        rig = less.rig.with_effect(*other, {law.size.name: values[entry.size.name]})
        done = self.fitted(rig, less, (*less.keys, other), (1.0, 0.1, 1.0), 5)
        gained = less.score - self.now.score
        unseen = entry.simpler_at(values, self.motion(key[0])) == law.name
        most = (self.rules.clearing_ratio if unseen else self.rules.tie_ratio) * gained
        return done if done is not None and not done.at_end and done.score - self.now.score < most else None

    def add_table(self) -> None:
        """A table over a state of some place, beside the names and alone, where it takes the unknown force away."""
        names = self.names = self.now
        found: list[FittedModel] = []
        for start in [names, *([self.nothing] if names.keys else [])]:
            columns = attempt(CandidateSensitivities, self.segments, start, start.noise_levels, tables=True)
            for p in columns.ranked[: 1 if start is names and names.keys else 2] if columns else ():
                done = self.tabled(start, p) if p.gain > self.rules.min_gain_if_clearing * self.segments.count else None
                if done is not None and self.unknown(done) < self.rules.clearing_ratio * self.unknown(names):
                    found.append(done)
        best = min(found, key=lambda m: m.score, default=None)
        if best is None or best.score > names.score - self.asked(best, names):
            return
        self.now = best
        table = next(k for k in best.keys if k in best.smooth)
        for key in [k for k in best.keys if k != table]:  # names that the table makes idle
            less = self.without(self.now, key)
            if less is not None and less.score < self.now.score + self.asked(self.now, less):
                self.now = less
        self.beaten[table] = [names]

    def tabled(self, start: FittedModel, p: Proposal) -> FittedModel | None:
        """A model with a table in it, fitted on the beginning and then on all; None where the rig cannot have it."""
        ((h, _),) = p.parts
        assert p.smooth is not None
        model = replace(start, smooth={**start.smooth, h.key: p.smooth})
        rig = attempt(p.put, start.rig)
        if rig is None:
            return None
        given = self.quick, rig, (*start.keys, h.key), self.motion, STIFF, model.smooth
        first = attempt(
            lambda: FitProblem(*given).homotopy_fit(self.segments.of_first(start.noise_levels), None, (0.1, 1.0), 3)
        )
        if first is None:
            return None
        back = replace(model, noise_levels=self.segments.back(first.noise_levels, start.noise_levels))
        return self.fitted(first.rig, back, first.keys)

    def final_fit(self) -> None:
        """The last fit, with priors as they are given where little is unknown; out with what stood for a parameter."""
        little = self.unknown(self.now) < self.rules.unexplained_attention
        stiff = 1.0 if little else STIFF
        done = self.fitted(self.now.rig, self.now, self.now.keys, steps=5, stiff=stiff)
        if done is not None:
            self.now = done
        if little:
            self.eliminate_backward(stiff)


def of_timing(model: FittedModel) -> bool:
    """Whether a delay, a lag or a filter is among a model's names; averaged readings show these only roughly."""
    found = [find(model.rig.kind_at(place), name, place).slot for place, name in model.keys]
    return any(slot.delays or isinstance(slot, (Lag, Filter)) for slot in found)


def described(model: FittedModel) -> list[str]:
    """The names of a model with their values, for logs."""
    found = []
    for place, name in model.keys:
        values = model.rig.effects.get(place, {}).get(name, {})
        knots = [p for p in values if p in VALUES]
        shown = {n: v for n, v in values.items() if n not in knots and not (knots and n[0] == "x")}
        found.append(f"{place}.{name}({', '.join(f'{n} {v:.5g}' for n, v in shown.items())})")
    return found
