"""From recordings to a diagnosis: inspect, search, judge, and put together what is said and shown."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from dtbacklash.campaign.progress import SO_FAR
from dtbacklash.diagnosis.conclusion import Conclusion, had_to_move, is_there
from dtbacklash.diagnosis.engine.change_detection import Change, grow
from dtbacklash.diagnosis.engine.change_detection import judged as judged_changes
from dtbacklash.diagnosis.engine.confidence import ConfidenceTest, JudgedModel
from dtbacklash.diagnosis.engine.cross_validation import left_out, predicted
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel, without_name
from dtbacklash.diagnosis.engine.formula_fit import modelled
from dtbacklash.diagnosis.engine.intervals import Values, polished, profiles
from dtbacklash.diagnosis.engine.motion import Motion, motion_of
from dtbacklash.diagnosis.engine.parameters import tolerances_away, with_errors, with_priors
from dtbacklash.diagnosis.engine.per_recording import in_each
from dtbacklash.diagnosis.engine.resampling import rate_of
from dtbacklash.diagnosis.engine.scale_errors import ScaleError, begin
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.diagnosis.engine.selection import MOST, StepwiseSelection, of_timing
from dtbacklash.diagnosis.engine.sensor_zeros import zeroed
from dtbacklash.diagnosis.explain.accepted_error import Enough
from dtbacklash.diagnosis.explain.calibration import calibration
from dtbacklash.diagnosis.explain.checks import USUAL, all_checks
from dtbacklash.diagnosis.explain.differences import changes, changes_said, differences_said
from dtbacklash.diagnosis.explain.errors import ErrorTables
from dtbacklash.diagnosis.explain.findings import candidates, findings, limits, located, recalibrated
from dtbacklash.diagnosis.explain.next_experiment import next_experiment
from dtbacklash.diagnosis.explain.observed import observed
from dtbacklash.diagnosis.explain.plot_series import shown
from dtbacklash.diagnosis.explain.sentences import (
    explained_said,
    modelled_said,
    summary,
    tolerances_said,
    unknown_said,
    zeros_said,
)
from dtbacklash.diagnosis.explain.suspected_parameters import suspects, suspects_said
from dtbacklash.diagnosis.inspect.fault import faulty, mended, not_finite, undriven
from dtbacklash.diagnosis.inspect.inspection import inspect
from dtbacklash.diagnosis.parallel import on_cores
from dtbacklash.diagnosis.plot_data import Work
from dtbacklash.diagnosis.predictions import Predictions, segments_of
from dtbacklash.diagnosis.preliminary import Depth, Stages, known
from dtbacklash.diagnosis.records import SMOOTH, STEPPED, Record, ways_to_read
from dtbacklash.diagnosis.result import UNEXPLAINED, Diagnosis
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig

#: what is said while and after a search is stopped
ENDING = "stopped: what is known is judged and written (Ctrl-C once more ends it)"
UNKNOWN = ": nothing was known yet"
STOPPED = "what was found until then, with nothing tried in its place. More may be missing, and no name is sure."
TO_THE_END = "Let the diagnosis run to its end, before anything is measured because of it."
RATE = "Compared at the rate of the motion: each reading is the mean of {every} samples ({hz:.4g} Hz)."

#: where no command drives, so much force stays unknown with one name in a machine that something else moves (share)
UNDRIVEN = 0.5
FULL: Depth = "full"
QUICK: Depth = "quick"
NONE: Depth = "none"
SEARCHED: dict[Depth, str] = {
    NONE: "No physics was looked for (search=none): the rig was calibrated as it is.",
    QUICK: "Only what is large was looked for (search=quick), and nothing was tried in its place: no name is sure.",
    FULL: "",
}


def silent(text: str, share: float) -> None:
    """What to call with a text and a share, 0 to 1, where nobody asked for progress."""


def diagnose_records(
    rig: Rig, records: list[Record], progress: Callable[[str, float], None] | None = None, jobs: int | None = None,
    enough: Enough | None = None, depth: Depth = FULL, keep: bool = False, changes: bool = False,
) -> Diagnosis:  # fmt: skip
    """Diagnose recordings on a rig.

    Parameters
    ----------
    rig : the nominal rig; effects that it has already have tolerances, and are recalibrated as its parameters are.
    records : with masks of the samples to fit and to judge on. progress : called with a text and a share, 0 to 1.
    jobs : threads; None leaves what joblib has been told, else one. enough : a rest that the user accepts.
    depth : how much is looked for. keep : whether Ctrl-C, once the rig is recalibrated, gives what is known so far,
        judged as a quick search is; a second one ends it.
    changes : look for what changed between two recordings, beside what is large and missing in both.

    Raises
    ------
    UserError : no channel of the rig was recorded, or nothing recorded shows some part.
    KeyboardInterrupt : it was interrupted, and nothing is to be kept.
    """
    tell = progress or silent
    # many short products of long vectors: threads of the linear algebra would cost more than they bring
    with on_cores(jobs), threadpool_limits(1, "blas"):
        inspected = inspect(rig, records)
        if inspected.fault is not None:
            return faulty(rig, inspected, inspected.fault)
        try:
            return mended(
                _Course(with_priors(rig), inspected.records, tell, depth, enough or {}, keep, changes).run(),
                inspected,
            )
        except _Undriven as error:
            return faulty(rig, inspected, undriven(rig, inspected, *error.args))
        except np.linalg.LinAlgError as error:
            return faulty(rig, inspected, not_finite(rig, inspected, error))


class _Undriven(Exception):
    """A constant command does not move a machine so: what explains most, and the force that stays unknown (share)."""


class _Course:
    """One diagnosis on its way."""

    def __init__(
        self,
        rig: Rig,
        records: list[Record],
        tell: Callable[[str, float], None],
        depth: Depth,
        enough: Enough,
        keep: bool,
        changes: bool = False,
    ) -> None:
        self.rig, self.records, self._say, self.enough, self.keep = rig, records, tell, enough, keep
        self.depth: Depth = QUICK if changes and depth == FULL else depth
        self.changes: tuple[Change, ...] | None = () if changes else None
        self.every = [
            rate_of(rig, {c: v for c, v in r.y.items() if c in rig.sensors}, r.sample_time_s) for r in records
        ]
        self.step, self._stages, self._ending = "", Stages(self.depth), ""
        self.search: StepwiseSelection | None = None
        self.begin: ScaleError | None = None
        self.course = ""

    def tell(self, step: str, counted: float) -> None:
        """What is being done and at which stage, and what is known so far; counted : as the search counts."""
        self.step = step
        text, share = self._stages.reached(step, counted)
        news = self._ending or (known(self.search) if self.search else "")
        self._say(text + (SO_FAR + news if news else ""), share)

    def run(self) -> Diagnosis:
        """Search, judge, and say it; where it is stopped, what is known so far."""
        try:
            search = self._searched()
            if self.changes is not None:
                grow(search)
                self.changes = judged_changes(search)
            return self._found(search, self.depth)
        except KeyboardInterrupt:
            if not self.keep:
                raise
            if self.search is None:
                raise KeyboardInterrupt(UNKNOWN) from None
            return self._until_now(self.search)

    def _until_now(self, search: StepwiseSelection) -> Diagnosis:
        """What a search has found until it was stopped; a second interruption ends this as well."""
        step, self.changes, self._ending = self.step, None, ENDING  # what changed has not been judged
        self.tell("judging what is known", 0.9)
        try:
            found = self._found(search, QUICK if self.depth == FULL else self.depth)
        except (ValueError, IndexError, KeyError, np.linalg.LinAlgError) as error:  # stopped between two of its changes
            raise KeyboardInterrupt(UNKNOWN) from error
        said = found.summary.removeprefix(SEARCHED[QUICK]).strip()
        summarised = f"Stopped early ({step}): {STOPPED} Known then: {known(search)}. {said}"
        return replace(found, summary=summarised, stopped=step, next_experiment=TO_THE_END)

    def _searched(self) -> StepwiseSelection:
        """The search with the command held between its samples; with another course where that is likelier."""
        self.tell("recalibrating the rig", 0.02)
        ways = {"": self.records, **ways_to_read(self.records, self.rig)}
        held = self.search = self._start(self.records)
        if self.depth != NONE and not self._seen(held).unlogged(held.now.rig):
            held.preview()
            self.tell("recalibrating the rig", 0.04)
        if held.unknown(held.nothing) > held.rules.max_unexplained:
            self.begin = begin(held.quick, held.rules)
            held = self._start(self.records) if self.begin else held
        begun = {
            course: self._start(records) if course else held
            for course, records in ways.items() if course != STEPPED or self._clears(records, held)
        }  # fmt: skip
        scores = {course: search.now.score for course, search in begun.items()}
        likelier = [c for c in begun if scores[c] < scores[""] - held.asked(begun[c].now, held.now)]
        self.course = min(likelier, key=lambda course: scores[course], default="")
        self.records = ways[self.course]
        search = self._at_rates(begun[self.course])
        for course, records in ways.items():  # what was missing may have looked like another course
            better = self._at_course(course, records, search) if course != self.course else None
            if better is None:
                continue
            before = self.course, self.records, self.every
            self.course, self.records = course, records
            other = self._at_rates(self._start(records, better, search.differences))
            if self.every != before[2] or _cost(other, other.now, course) < _cost(search, search.now, before[0]):
                return other  # at another rate the two cannot be compared
            self.course, self.records, self.every = before
            self.search = search
        return search

    def _clears(self, records: list[Record], held: StepwiseSelection) -> bool:
        """Whether with another course hardly any force stays unknown: what is missing looks like steps, too."""
        segments = replace(self._segments(records, self.every), nominal=held.segments.nominal)
        left = segments.most_unknown(segments.tuned(held.now.rig)[0])
        return left < held.rules.clearing_ratio * held.unknown(held.now)

    def _at_course(self, course: str, records: list[Record], search: StepwiseSelection) -> FittedModel | None:
        """A search's model with another course of the command, or that without a name that makes it late.

        None where neither is likelier: each name, and a course other than a held one, has to earn the least.
        """
        segments, now = replace(self._segments(records, self.every), nominal=search.segments.nominal), search.now
        segments = segments if search.segments.coarse is search.segments else segments.fine
        late = [key for key in now.keys if of_timing(replace(now, keys=(key,)))]
        # another course moves all delays and lags alike: where one goes, the values of the others follow
        tried = [now, *(without_name(segments, now, key) for key in late)]
        fitted = [m for m in (_fitted(segments, search.motion, m) for m in tried) if m and not m.at_end]
        best = min(fitted, key=lambda m: _cost(search, m, course), default=None)
        return best if best and _cost(search, best, course) < _cost(search, now, self.course) else None

    def _start(
        self, records: list[Record], model: FittedModel | None = None, differences: tuple[str, ...] = ()
    ) -> StepwiseSelection:
        """Recalibrate the nominal rig, and begin a search with the names of a model of another one."""
        finer = self._at_finer if max(self.every) > 1 else None
        segments, first = self._segments(records, self.every), self.begin
        if first:
            first = replace(first, rig=zeroed(segments, first.rig))
        search = StepwiseSelection(
            replace(segments, nominal=zeroed(segments, self.rig)), tell=self.tell, finer=finer, begin=first
        )
        if model is not None:
            self.search = search  # at this rate, with these records: what is known if it is stopped
            search.begin_with(model, differences)
        return search

    def _segments(self, records: list[Record], every: list[int]) -> Segments:
        """Predictors of records, with the forces that move the rig from which a search begins."""
        return replace(segments_of(self.begin.rig if self.begin else self.rig, records, every), nominal=self.rig)

    def _at_rates(self, search: StepwiseSelection) -> StepwiseSelection:
        """The search at the rate of the motion; at faster ones where much force is unknown, or a law is of timing."""
        driven = any(r.driven for r in self.records)
        while True:
            if self._seen(search).unlogged(search.now.rig):
                self.search = search  # whatever would be found may be what is not in the log
                return search
            search.likely = search.likely or (self.search.likely if self.search else None)
            self.search = search
            if self.depth != NONE and not driven:
                self._moves_by_itself(search)
            if self.depth == FULL:
                search.run()
            elif self.depth == QUICK:
                search.add_forward()
            if self.depth != FULL and not search.too_coarse:
                search.final_fit()
            timing = max(self.every) > 1 and of_timing(search.now)
            if not (search.too_coarse or timing):
                return search
            self.every = [1] * len(self.every) if timing else self._finer()
            self.tell("looking closer, at a faster rate", 0.3)
            found = search.names if search.now.smooth else search.now
            search = self._start(self.records, found if driven else None, search.differences)

    def _seen(self, search: StepwiseSelection) -> Predictions:
        """All records, as the search's present model sees them."""
        return Predictions(search.segments, self.records, self.every, search.now.rig, search.now.noise_levels)

    def _moves_by_itself(self, search: StepwiseSelection) -> None:
        """Look for what explains most where no command drives; raises _Undriven where hardly anything does."""
        search.most = len(search.now.keys) + 1
        search.add_forward()
        left, names = search.unknown(search.now), search.now.keys or ((search.likely,) if search.likely else ())
        if left > UNDRIVEN and not search.too_coarse and self._seen(search).shows(search.now.rig):
            raise _Undriven(names, left)
        search.most = MOST

    def _finer(self) -> list[int]:
        """A third of the samples for a reading, an odd number."""
        return [max(1, (m // 3 + 1) // 2 * 2 - 1) for m in self.every]

    def _at_finer(self, model: FittedModel) -> float:
        """The largest unknown force of a model at a finer rate."""
        segments = self._segments(self.records, self._finer())
        return segments.most_unknown(segments.tuned(model.rig)[0])

    def _found(self, search: StepwiseSelection, depth: Depth) -> Diagnosis:
        """Judge a search, and say what it amounts to."""
        full = depth == FULL
        judged = ConfidenceTest(search).judged() if full else JudgedModel(search.now)
        self.tell("modelling what is left", 0.9)
        said, last = None, None
        tables = [k for k in judged.model.keys if find(self.rig.kind_at(k[0]), k[1], k[0]).is_table]
        if tables:
            names = search.names
            gone = tuple(k for k in names.keys if k not in judged.model.keys)
            last, said = modelled(search, judged.model, tables[0], gone)
            judged = replace(judged, model=_without_tables(search, judged.model, tables) or judged.model)
        last_fit, about, segments, motion = self._last_word(search, judged.model)
        model = replace(judged.model, rig=last_fit.rig)
        if last_fit.keys != model.keys:
            model = replace(
                model, keys=last_fit.keys, noise_levels=search.segments.tuned(last_fit.rig, model.noise_levels)[0]
            )
        judged = replace(judged, model=model)
        seen = Predictions(search.segments, self.records, self.every, (last or model).rig, (last or model).noise_levels)
        moved = had_to_move(search, model, about)
        c = Conclusion(search, judged, moved, about, seen, said, last, self.course, full, changes=self.changes)
        away = [f.shared_title for f in moved]
        c = replace(c, in_each=in_each(segments, model, about, {*c.sizes.values(), *search.differences, *away}))
        if any((r.train & r.held).any() for r in self.records):
            c = self._in_turns(c)
        return replace(self._diagnosis(c, depth), profiles=profiles(segments, motion, last_fit, about, c.label))

    def _in_turns(self, c: Conclusion) -> Conclusion:
        """Each recording left out in turn, to judge."""
        segments, motion = c.search.segments, c.search.motion
        nothing, extended = (left_out(segments, motion, m) for m in (c.search.nothing, c.model))
        less = {key: r.model for key, those in c.judged.rivals.items() if key in c.sizes for r in those if not r.keys}
        said = predicted(segments, motion, extended, c.model, less)
        return replace(c, left_out=(nothing if c.model.keys else extended, extended), predicted=said)

    def _last_word(self, search: StepwiseSelection, model: FittedModel) -> tuple[FittedModel, Values, Segments, Motion]:
        """A model with the values that the recording has at its full rate, their errors, the segments and the motion.

        A law that is not linear is another one, a little, on means: what stood for the difference earns nothing here.
        """
        segments, motion, last = search.segments, search.motion, model
        far = tolerances_away(segments.nominal, model.rig).values()
        if max(self.every) > 1 and (model.keys or max(far, default=0.0) > search.rules.min_shift):
            full = replace(self._segments(self.records, [1] * len(self.every)), nominal=segments.nominal)
            noise_levels, _ = full.tuned(model.rig)
            if full.refine(model.rig, noise_levels, search.rules.min_gain * search.segments.count):
                noise_levels, _ = full.tuned(model.rig, noise_levels)
            along = motion_of(full, model.rig, full.gains(model.rig, noise_levels))
            found = _fitted(full, along, replace(model, noise_levels=noise_levels))
            if found is not None and (len(model.keys) > 1 or not found.at_end):
                segments, motion, last = full, along, found
        several = len(model.keys) > 1 and segments is not search.segments
        ends, segments = last.ends, segments.fine  # what follows is compared with what is polished
        last, about = polished(segments, motion, last)
        for key in model.keys:
            doubted = several or key in ends or not is_there(last, about, key)
            less = _fitted(segments, motion, without_name(segments, last, key)) if doubted else None
            if less is not None and (key in ends or less.score < last.score + search.asked(last, less)):
                last, about = polished(segments, motion, less)
        return last, about, segments, motion

    def _diagnosis(self, c: Conclusion, depth: Depth) -> Diagnosis:
        tables = ErrorTables(c)
        table, free, much = tables.fit(), tables.free_running(), tables.explained(self.enough)
        verdict = c.verdict(much.enough)
        named, moved, where = findings(c), recalibrated(c), located(c, verdict)
        told = replace(c.modelled, sentence=modelled_said(c.modelled, much)) if c.modelled else None
        # a search that was stopped has not tried what the names would explain
        suspected = suspects_said(c, suspects(c)) if verdict == UNEXPLAINED and not self._ending else ""
        parts = (
            suspected, SEARCHED[depth] if c.changes is None else "", differences_said(c),
            summary(
                verdict, named, moved, where, depth != NONE, much.enough, c.seen.unlogged(c.model.rig),
                c.explains and c.with_table is None,
            ) if c.changes is None else changes_said(c, named),
            explained_said(much, bool(named)), unknown_said(much), told.sentence if told else "",
            tolerances_said(c.beyond(), USUAL),
        )  # fmt: skip
        every, record, zeros = max(self.every), self.records[0], zeros_said(c)
        rate = (RATE.format(every=every, hz=1.0 / (every * record.sample_time_s)),) if every > 1 else ()
        return Diagnosis(
            verdict=verdict,
            summary=" ".join(filter(None, parts)),
            findings=named,
            recalibrated=moved,
            fit=table,
            recordings=tables.recordings(),
            candidates=candidates(c),
            located=where,
            suspected=suspected,
            zeros=zeros,
            next_experiment=next_experiment(c, verdict, where),
            nominal=self.rig,
            extended=with_errors(
                c.model.rig, c.values.errors, verdict != UNEXPLAINED, c.search.segments.recordings[-1]
            ),
            free_running=free,
            explained=much,
            checks=all_checks(c, tables, free),
            limits=limits(c) if depth == FULL else (),
            notes=(*filter(None, (c.course, zeros)), *rate),
            shown=shown(c, tables, much.causes),
            work=Work(
                record.sample_time_s, sum(int(r.train.sum()) for r in self.records),
                sum(int(r.held.sum()) for r in self.records), every, tables.floor, len(c.search.gains),
                len(c.search.tried), c.course == SMOOTH, depth,
            ),
            calibration=calibration(c),
            observed=observed(c),
            modelled=told,
            changes=changes(c),
        )  # fmt: skip


def _fitted(segments: Segments, motion: Motion, model: FittedModel) -> FittedModel | None:
    """A model fitted anew on some segments; None where nothing stays finite."""
    problem = FitProblem(segments, model.rig, model.keys, motion, model.stiff, model.smooth)
    return problem.homotopy_fit(model.noise_levels, None, (1.0, 0.1, 1.0), 4)


def _cost(search: StepwiseSelection, model: FittedModel, course: str) -> float:
    """The score of a model and the least for each name and for a course of the command other than a held one."""
    return model.score + search.least * (len(model.keys) + bool(course))


def _without_tables(search: StepwiseSelection, model: FittedModel, tables: list[tuple[str, str]]) -> FittedModel | None:
    """The model with its names alone."""
    for key in tables:
        less = search.without(model, key)
        if less is None:
            return None
        model = less
    return model
