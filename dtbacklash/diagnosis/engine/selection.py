"""One loop: what joins, what leaves, what is exchanged; columns propose, quick fits sift, exact fits decide.

All models are compared by one number, the score of :class:`.fit.FittedModel`: -2 log likelihood with priors and log N
for each parameter. A name joins if it earns a share of the number of readings, and stays if taking it out costs that.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.attempts import attempt, attempts
from dtbacklash.diagnosis.engine.candidates import CandidateSensitivities, Proposal
from dtbacklash.diagnosis.engine.fit import STIFF, FitProblem, FittedModel, share_of, without_name
from dtbacklash.diagnosis.engine.hypotheses import Hypothesis
from dtbacklash.diagnosis.engine.motion import Motion, motion_of
from dtbacklash.diagnosis.engine.parameters import Key, taken_out
from dtbacklash.diagnosis.engine.predictor import LOST, Predictor
from dtbacklash.diagnosis.engine.recording_effects import alike, differ, named_apart
from dtbacklash.diagnosis.engine.scale_errors import ScaleError
from dtbacklash.diagnosis.engine.segments import Segments, Sizes
from dtbacklash.diagnosis.settings import SETTINGS, DiagnoseSettings
from dtbacklash.errors import UserError
from dtbacklash.physics.catalogue import find, simpler
from dtbacklash.physics.effects.declare import Values
from dtbacklash.physics.effects.slots import Filter, Late
from dtbacklash.physics.effects.table import VALUES
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

#: names that are looked for at most
MOST = 4
#: -2 log likelihood that anything has to earn: the best of some hundred columns of noise hardly reaches it
LEAST = 60.0
#: a rate is too coarse where a finer one leaves less than this share of the unknown force
CLOSER = 0.5
#: the beginning of a recording on which quick fits are made
SHARE = 1.0 / 3.0
#: so many names that the beginning says most for are looked at on all
PROMISING = 12
#: slots that make a signal late: of a slow motion one is nearly the other
LATE = (Filter, Late)
#: sizes at which columns are looked at as well while much is unknown (shares)
STRICT = (0.1, 0.01)

Tell = Callable[[str, float], None]
#: a rig that was fitted quickly: squares with their cost, what was fitted, values; then score, rig, names, sizes
_Rough = tuple[float, FitProblem, Floats]
_Tuned = tuple[float, Rig, tuple[Key, ...], Sizes]


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
    first_columns: tuple[FittedModel, Predictor, CandidateSensitivities | None] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Recalibrate the nominal rig."""
        rig = self.segments.nominal
        sizes, _ = self.segments.tuned(rig)
        self.look_at(sizes)
        far = self.begin.rig if self.begin else rig
        at = self.segments.tuned(far)[0] if self.begin else sizes
        self.motion: Motion = motion_of(self.segments, far, self.segments.gains(far, at))
        found = FitProblem(self.segments, rig, (), self.motion).homotopy_fit(sizes, None, (1.0,), 6)
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
        self.first_columns = self._on_beginning(self.now)
        columns = self.first_columns[-1]
        self.likely = columns.ranked[0].keys[0] if columns and columns.ranked else None

    def _on_beginning(self, model: FittedModel) -> tuple[FittedModel, Predictor, CandidateSensitivities | None]:
        """A model, the predictor of the beginning, and the columns around the model there; kept of :meth:`preview`."""
        beginning, kept = self.segments.predictors[self.segments.telling], self.first_columns
        if kept and kept[0] is model and kept[1] is beginning:
            return kept
        columns = attempt(CandidateSensitivities, self.quick, model, self.segments.of_first(model.sizes))
        return model, beginning, columns

    def look_at(self, sizes: Sizes) -> None:
        """Make quick fits on the stretch that says most of what is missing, at these sizes."""
        self.segments = replace(self.segments, telling=self.segments.most_telling(sizes))
        self.quick = self.segments.first(SHARE)

    def unknown(self, model: FittedModel) -> float:
        """The largest unknown force of a model, a share of the motion."""
        return self.segments.most_unknown(model.sizes)

    def explains(self, model: FittedModel) -> bool:
        """Whether a model explains most of what was unknown before, or leaves hardly anything."""
        return self.unknown(model) < max(
            self.rules.unexplained_attention, self.rules.clearing_ratio * self.unknown(self.nothing)
        )

    def far(self, model: FittedModel) -> bool:
        """Whether much is unexplained, so that smaller sizes see more than the present ones."""
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
        """A rig with these names fitted on all, from the sizes of a model."""
        given = self.segments, rig, keys, self.motion, model.stiff if stiff is None else stiff, model.smooth
        found = attempt(lambda: FitProblem(*given).homotopy_fit(model.sizes, None, rungs, steps))
        if found is not None:
            key = tuple(sorted(found.keys))
            self.tried[key] = min(self.tried.get(key, np.inf), found.score)
        return found

    def without(self, model: FittedModel, key: Key, steps: int = 3, stiff: float | None = None) -> FittedModel | None:
        """A model without one of its names, fitted anew: what else explains it fits where the name's sizes are kept.

        Or from the sizes that it then needs: a name may hide how far.
        """
        bare = attempt(without_name, self.segments, model, key)
        if bare is None:
            return None
        rungs = (1.0, 0.1, 1.0) if stiff is not None else (1.0,)
        starts = (replace(bare, sizes=model.sizes), bare)
        found = [self.fitted(start.rig, start, start.keys, rungs, steps, stiff) for start in starts]
        best = min((m for m in found if m is not None), key=lambda m: m.score, default=None)
        # a name that has come to nothing meanwhile is none
        return best and replace(best, keys=tuple(k for k in best.keys if best.rig.effect(*k) is not None))

    def proposals(
        self, model: FittedModel, without: tuple[Key, ...] = (), quick: bool = False, alone: bool = False
    ) -> list[tuple[Rig, tuple[Key, ...]]]:
        """Rigs to try: the best singles and pairs of columns, at the present sizes and at smaller ones.

        alone : see :class:`.candidates.CandidateSensitivities`.
        """
        far, found, without = self.far(model), [], (*without, *self.rejected)
        seen: dict[tuple[Key, ...], list[list[Values]]] = {}
        # where much is unexplained, the beginning tells as well what explains it
        much = self.unknown(model) > self.rules.max_unexplained and len(self.segments.recordings) == 1
        whole = self.quick if much else self.segments
        levels = [(self.quick, 1.0, 5 if alone else 3, 0)] if quick else [(whole, 1.0, 5, 3)]
        if far and not quick:
            levels += [(self.quick, share, 4 - n, 2 - n) for n, share in enumerate(STRICT)]
        for segments, share, singles, pairs in levels:
            if segments is self.quick and share == 1.0 and not without and not alone:
                columns = self._on_beginning(model)[-1]
            else:
                at = self.segments.of_first(model.sizes) if segments is self.quick else model.sizes
                columns = attempt(
                    CandidateSensitivities, segments, model, segments.scaled(at, share), without, alone=alone,
                    only=None if segments is self.quick else self._promising(model),
                )  # fmt: skip
            if columns is None:
                continue
            ranked = columns.ranked
            if share == 1.0 and not quick:
                self._note_gains(ranked, segments)
                self.apart = columns.differing() if len(segments.recordings) > 1 else []
            ranked = [p for p in ranked if far or p.gain > 0.3 * self.rules.min_gain * segments.count]
            chosen: list[Proposal] = ranked[:singles] + (columns.pairs(ranked[:5])[:pairs] if pairs else [])
            for p in ranked[:singles]:  # the simpler law that it may become
                ((h, _),) = p.parts
                if law := simpler(h.effect):
                    simple = (o for o, _ in columns.hypotheses if o.key == (h.place, law.name))
                    chosen += [Proposal(0.0, ((o, None),)) for o in simple][:1]
            for p in chosen:
                values = [h.values for h, _ in p.parts]
                there = seen.setdefault(p.keys, [])
                if len(there) >= 3 or values in there:
                    continue
                there.append(values)
                if (rig := attempt(p.put, model.rig)) is not None:
                    found.append((rig, (*model.keys, *(h.key for h, _ in p.parts))))
        return found

    def _promising(self, model: FittedModel) -> set[Key] | None:
        """Names that the beginning says most for, alone and in pairs; None, all of them, where recordings may differ."""
        first = self._on_beginning(model)[-1] if len(self.segments.recordings) == 1 else None
        if first is None:
            return None
        self._note_gains(first.ranked, self.quick)
        pairs = first.pairs(first.ranked[:5])[:PROMISING]
        return {p.keys[0] for p in first.ranked[:PROMISING]} | {key for p in pairs for key in p.keys}

    def _note_gains(self, ranked: Sequence[Proposal], segments: Segments) -> None:
        """Keep what the column of each name promises, as if on all."""
        for p in ranked:
            self.gains.setdefault(p.keys[0], p.gain * self.segments.count / segments.count)

    def alternatives_to(self, less: FittedModel, key: Key, best: int = 3) -> list[FittedModel]:
        """The likeliest others in the place of a name of the model; less : the model without it, fitted anew.

        What stands for it explains what is left where it is taken out and all else stays; or what is left at last.
        """
        bare = replace(self.now, rig=taken_out(self.now.rig, key), keys=less.keys)
        mine, proposals = ".".join(key) + ".", []
        if any(title.startswith(mine) for there in self.now.rig.own for title in there):
            self.look_at(less.sizes)  # one recording alone may show it, and others have sizes of their own as well
            for m in (bare, less):
                columns = CandidateSensitivities(self.segments, m, m.sizes, (key,), alone=m is bare)
                found = named_apart(self.segments, m, columns.differing()[: best + 1])
                proposals += [(rig, keys) for *_, rig, keys in found]
        else:
            proposals = [p for m in (bare, less) for p in self.proposals(m, (key,), quick=True, alone=m is bare)]
        values = self.now.rig.effects[key[0]][key[1]]
        for place in self.now.rig.places:  # the same law elsewhere
            unread = place.startswith(SENSOR_PREFIX) and place not in self.segments.sensors
            takes = key[1] in self.now.rig.takes(place) and bare.rig.effect(place, key[1]) is None
            if place == key[0] or unread or not takes or (place, key[1]) in self.rejected:
                continue
            own = {
                (k, title.replace(mine, f"{place}.{key[1]}.")): value
                for k, there in enumerate(self.now.rig.own) for title, value in there.items() if title.startswith(mine)
            }  # fmt: skip
            if (rig := attempt(_put, bare.rig, (place, key[1]), dict(values), own)) is not None:
                proposals.append((rig, (*bare.keys, (place, key[1]))))
        return self.screened(less, proposals, best, key)

    def screened(
        self,
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
        quick, n = self.quick, np.log(self.quick.count)
        sizes = self.segments.of_first(model.sizes) if len(model.sizes) != len(quick.predictors) else model.sizes
        most = self.unknown(model)
        strict = quick.scaled(sizes, 0.1 if most > self.rules.unexplained_attention else 1.0)
        near = attempt(self._near, model, strict) or {}

        def solved(one: tuple[Rig, tuple[Key, ...]]) -> _Rough | None:
            problem = FitProblem(quick, *one, self.motion, model.stiff, model.smooth)
            x, squares = problem.solved(strict, 3, near)
            return (squares + n * problem.counts, problem, x) if np.isfinite(squares) else None

        def tuned(one: _Rough) -> _Tuned | None:
            _, problem, x = one
            rig = problem.rig(x)
            if any(rig.effect(*key) is None for key in problem.keys):
                return None  # it came to nothing
            sizes, likelihood = quick.tuned(rig, strict, steps=(2.0, 0.7), refresh=1)
            beside = problem.prior_residuals(x)
            return likelihood + float(beside @ beside) + n * problem.counts, rig, problem.keys, sizes

        rough = sorted(attempts(solved, proposals), key=lambda r: r[0])
        gone = self.rejected | ({instead} if instead else set())
        rough += attempts(solved, attempt(_as_late, rough, model, gone) or [])
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
            _, rig, keys, sizes = one
            rungs = (0.1, 0.1, 1.0) if quick.most_unknown(sizes) > 3e-3 else (1.0,)
            return FitProblem(quick, rig, keys, self.motion, model.stiff, model.smooth).homotopy_fit(sizes, None, rungs)

        first = near_best + simple
        some: list[FittedModel] = []
        # where the likeliest end at a bound, which the data have not chosen, others are tried
        for few_at_once in (first, [s for s in second if s not in first]):
            some = some or [m for m in attempts(climbed, few_at_once) if not m.at_end]
        some.sort(key=lambda m: m.score)
        full: list[FittedModel] = []
        for m in some:
            if len(full) < 2 and (m.score < some[0].score + 0.1 * quick.count or len(m.keys) == few):
                full += attempt(self._on_all, m, model, instead is not None) or []
        return sorted((m for m in full if m.score < LOST), key=lambda m: m.score)

    def _on_all(self, m: FittedModel, model: FittedModel, small: bool) -> list[FittedModel]:
        """A proposed model fitted on all, without what is too small a law beside the model; none where that is all."""
        other = len(m.sizes) != len(model.sizes)
        start = replace(m, sizes=self.segments.back(m.sizes, model.sizes)) if other else m
        done = self.fitted(m.rig, start, m.keys, steps=4)
        while done is not None and not done.at_end:
            # what takes the unknown force away is never too small
            idle = (
                () if small or self.unknown(done) < self.rules.clearing_ratio * self.unknown(model) else self.idle(done)
            )
            if not idle:
                return [done]
            if len(done.keys) - 1 <= len(model.keys):
                return []
            done = self.without(done, idle[0])
        return []

    def _near(self, model: FittedModel, sizes: Sizes) -> dict[str, Floats]:
        """Nominal columns around a model on the beginning."""
        problem = FitProblem(self.quick, model.rig, model.keys, self.motion, model.stiff, model.smooth)
        gains = self.quick.gains(model.rig, sizes)
        x = problem.start()
        rows = problem.residuals(x, gains)
        if rows is None:
            return {}
        data = problem.innovation_rows
        return {f.title: problem.sensitivity(j, x, gains, rows)[:data] for j, f in enumerate(problem.free) if f.prior}

    def add_forward(self) -> None:
        """Add the best name or pair while one earns its place."""
        count, been = self.segments.count, set()
        while len(self.now.keys) < self.most and frozenset(self.now.keys) not in been:
            been.add(frozenset(self.now.keys))
            self.look_at(self.now.sizes)
            there = len(self.now.keys)
            self.tell(f"round {there + 1}: ranking what may be missing", 0.1 + 0.1 * there)
            proposed = self.proposals(self.now)
            if proposed:
                self.tell(f"round {there + 1}: fitting the {len(proposed)} likeliest", 0.1 + 0.1 * there)
            self.first_columns = None
            found = self.screened(self.now, proposed)
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
            if self.segments.refine(best.rig, best.sizes, self.rules.min_gain * count):
                self.quick = self.segments.first(SHARE)
                best = self.fitted(best.rig, best, best.keys, (1.0, 0.1, 1.0), 5) or best
            self.now = best
            if self.finer is not None and self.unknown(best) > self.rules.max_unexplained:
                self.too_coarse = self.finer(best) < CLOSER * self.unknown(best)
                if self.too_coarse:
                    return
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
            found = attempt(self.alternatives_to, less, key, 2) or []
            self.beaten[key] = found
            if (
                found
                and found[0].score < self.now.score - self.rules.tie_ratio * self.rules.min_gain * self.segments.count
            ):
                self.now = found[0]
                self.eliminate_backward()
                return True
        return False

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
        if law is None or self.now.rig.effect(key[0], law.name) is not None:
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
            columns = attempt(CandidateSensitivities, self.segments, start, start.sizes, tables=True)
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
            lambda: FitProblem(*given).homotopy_fit(self.segments.of_first(start.sizes), None, (0.1, 1.0), 3)
        )
        if first is None:
            return None
        back = replace(model, sizes=self.segments.back(first.sizes, start.sizes))
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

    def idle(self, model: FittedModel) -> tuple[Key, ...]:
        """Laws of a model that make little of what moves their place, and hardly more than what stays unknown."""
        least = min(self.rules.min_effect, self.unknown(model) / self.rules.clearing_ratio)
        return tuple(key for key in model.keys if share_of(self.segments, model, key) < least)


def _put(rig: Rig, key: Key, values: Values, own: dict[tuple[int, str], float]) -> Rig:
    """The rig with an effect; own : (recording, title) -> value there."""
    return rig.with_effect(*key, values).owning(own)


def _as_late(rough: list[_Rough], model: FittedModel, without: Collection[Key]) -> list[tuple[Rig, tuple[Key, ...]]]:
    """Other filters in the place of the best new one of fitted rigs, or of a sensor's delay: each as late as that."""
    for _, problem, x in rough:
        rig = problem.rig(x)
        for key in (k for k in problem.keys if k not in model.keys):
            entry, values = rig.takes(key[0])[key[1]], rig.effect(*key)
            late = entry.slot.late(values) if isinstance(entry.slot, Filter) and values else 0.0
            late = values[entry.size.name] if entry.is_delay and values else late
            others = {
                e.name: e.slot for e in rig.takes(key[0]).values()
                if isinstance(e.slot, Filter) and rig.effect(key[0], e.name) is None and (key[0], e.name) not in without
            }  # fmt: skip
            if not late > 0.0 or not others:
                continue
            bare, rest = taken_out(rig, key), [k for k in problem.keys if k != key]
            return [
                (bare.with_effect(key[0], name, slot.as_late(late)), (*rest, (key[0], name)))
                for name, slot in others.items()
            ]
    return []


def described(model: FittedModel) -> list[str]:
    """The names of a model with their values, for logs."""
    found = []
    for place, name in model.keys:
        values = model.rig.effects.get(place, {}).get(name, {})
        knots = [p for p in values if p in VALUES]
        shown = {n: v for n, v in values.items() if n not in knots and not (knots and n[0] == "x")}
        found.append(f"{place}.{name}({', '.join(f'{n} {v:.5g}' for n, v in shown.items())})")
    return found
