"""From recordings to a diagnosis: read the command, search, judge, and put together what is said and shown."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from dtbacklash.diagnose.data.command import held_equivalent
from dtbacklash.diagnose.data.compare import Record
from dtbacklash.diagnose.data.evidence import Evidence, Residuals
from dtbacklash.diagnose.data.floor import channel_noise
from dtbacklash.diagnose.data.tempo import tempo_rad_s
from dtbacklash.diagnose.data.windows import portion, whole
from dtbacklash.diagnose.data.zeros import aligned
from dtbacklash.diagnose.fit import refit
from dtbacklash.diagnose.fit.comparison import held_loss, merit, worst
from dtbacklash.diagnose.fit.errors import each_recording, fit_table, free_running
from dtbacklash.diagnose.fit.free import Errors, Key, all_free, as_given, nominal_free, with_errors, with_priors
from dtbacklash.diagnose.fit.intervals import Linear, standard_errors
from dtbacklash.diagnose.inspect.fault import faulty, mended, not_finite
from dtbacklash.diagnose.inspect.inspection import inspect
from dtbacklash.diagnose.judge.checks import all_checks, at_bounds, at_tolerances, coloured, whiteness
from dtbacklash.diagnose.judge.explained import Enough, explained
from dtbacklash.diagnose.judge.free_form import free_forms
from dtbacklash.diagnose.judge.law_points import law_shown
from dtbacklash.diagnose.judge.limits import limits
from dtbacklash.diagnose.judge.modelling import Beyond, beyond_names, stood_in
from dtbacklash.diagnose.judge.stands import Rival, leader, rivals_of, stands
from dtbacklash.diagnose.judge.verdict import BlockLeft, decide, depends_on, moved_parameters, remaining
from dtbacklash.diagnose.result import UNEXPLAINED, Check, Diagnosis
from dtbacklash.diagnose.say.calibration import calibration
from dtbacklash.diagnose.say.drawn import shown
from dtbacklash.diagnose.say.findings import candidates, finding, located, recalibrated, without, without_known
from dtbacklash.diagnose.say.next_experiment import next_experiment
from dtbacklash.diagnose.say.sentences import beyond_said, explained_said, limits_said, modelled_said, summary
from dtbacklash.diagnose.search.course import Course, silent
from dtbacklash.diagnose.search.friction_by_direction import call_by_direction
from dtbacklash.diagnose.search.grow import FULL, NONE, QUICK, Depth, search
from dtbacklash.diagnose.search.leave_out import drop, eliminate
from dtbacklash.diagnose.search.model import Log, Model
from dtbacklash.diagnose.search.objections import hands_back, raises_the_error
from dtbacklash.diagnose.search.parts import divided, for_judgement, refitted
from dtbacklash.diagnose.search.simpler_law import call_by_its_limit
from dtbacklash.diagnose.search.slow_pull import refit_slowly
from dtbacklash.diagnose.search.wrong_value import believed
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.diagnose.shown import LawShown, Work
from dtbacklash.diagnose.spread import on_cores
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig

#: a command is read as smooth where that leaves less than this of what holding it leaves: held is the rule (share of
#: the mean square)
SMOOTH_COMMAND_SHARE = 0.7

#: the share of a diagnosis before what was found is judged, and before what is left is modelled
JUDGED, MODELLED = 0.8, 0.9
#: what is said while and after a search is stopped
ENDING = "stopped: judging what is known so far (Ctrl-C once more ends it)"
STOPPED = "what was found until then, with nothing tried in its place. More may be missing, and no name is sure."
TO_THE_END = "Let the diagnosis run to its end, before anything is measured because of it."
SMOOTH = "The command is a measured signal: it passes smoothly through its samples instead of being held."
SEARCHED: dict[Depth, str] = {
    NONE: "No physics was looked for (search=none): the rig was calibrated as it is.",
    QUICK: "Only what is large was looked for (search=quick), and nothing was tried in its place: no name is sure.",
    FULL: "",
}


def diagnose_records(
    rig: Rig, records: list[Record], progress: Callable[[str, float], None] | None = None, jobs: int | None = None,
    enough: Enough | None = None, depth: Depth = FULL, keep: bool = False,
) -> Diagnosis:  # fmt: skip
    """Diagnose recordings on a rig.

    Parameters
    ----------
    rig : the nominal rig; effects that it has already have tolerances, and are recalibrated as its parameters are.
    records : with masks of the samples to fit and to judge on. progress : called with a text and a share, 0 to 1.
    jobs : threads; None leaves what joblib has been told, else one. enough : a rest that the user accepts.
    depth : how much is looked for. keep : whether Ctrl-C, once the rig is recalibrated, gives what is known so far,
        judged as a quick search is; a second one ends it.

    Raises
    ------
    UserError : no channel of the rig was recorded, or an integrating part not measured.
    KeyboardInterrupt : it was interrupted, and nothing is to be kept.
    """
    course = Course(progress or silent)
    # many short products of long vectors: threads of the linear algebra would cost more than they bring
    with on_cores(jobs), threadpool_limits(1, "blas"):
        inspected = inspect(rig, records)
        if inspected.fault is not None:
            return faulty(rig, inspected, inspected.fault)
        try:
            known = with_priors(rig)
            records = aligned(known, divided(inspected.records))
            readings = _readings(known, records)
            try:
                found = _found(readings, records, course, depth, enough or {})
            except KeyboardInterrupt:
                if not keep or course.believed is None:
                    raise
                found = _known_so_far(records, course, depth, enough or {})
            return mended(found, inspected)
        except np.linalg.LinAlgError as error:
            return faulty(rig, inspected, not_finite(rig, inspected, error))


def _found(
    readings: list[Evidence], records: list[Record], course: Course, depth: Depth, enough: Enough
) -> Diagnosis:  # fmt: skip
    """Search and judge."""
    model, log, course.smooth = _searched(readings, course, depth)
    course.believe(model, log)
    if depth == FULL:
        model = call_by_direction(call_by_its_limit(model, log), log)
        course.believe(model, log)
    return _concluded(model, log, records, course.smooth, course, depth, enough)


def _concluded(
    model: Model, log: Log, records: list[Record], smooth: bool, course: Course, depth: Depth, enough: Enough,
    stage: str = "fitting to all and judging",
) -> Diagnosis:  # fmt: skip
    """Fit to all, judge, and say it."""
    course.at(stage, JUDGED, MODELLED)
    evidence = whole(model.evidence, records, smooth).pulled_for(model.fitted.rig)
    judged = _without_leaders(_judged(refitted(model, for_judgement(evidence)), log, depth, course), log, depth, course)
    if depth == FULL:
        course.at("modelling what is left", MODELLED, 1.0)
    judged, beyond = _with_table(judged, log, depth, course)
    return _diagnosis(judged, beyond, log, smooth, enough, depth)


def _known_so_far(records: list[Record], course: Course, depth: Depth, enough: Enough) -> Diagnosis:
    """What is believed where a search was stopped, judged without rivals."""
    assert course.believed is not None
    (model, log), stage = course.believed, course.stage
    found = _concluded(model, log, records, course.smooth, course, depth if depth == NONE else QUICK, enough, ENDING)
    said = found.summary.removeprefix(SEARCHED[QUICK]).strip()
    summarised = f"Stopped early ({stage}): {STOPPED} {said}"
    return replace(found, summary=summarised, stopped=stage, next_experiment=TO_THE_END)


@dataclass(frozen=True)
class Judged:
    """The last model, the errors of its fit, and per named effect: what is left without it, its law, its rivals."""

    model: Model
    about: Linear
    errors: Errors
    left_out: dict[Key, Residuals]
    laws: dict[Key, LawShown | None]
    rivals: dict[Key, list[Rival]]


def _judged(model: Model, log: Log, depth: Depth, course: Course) -> Judged:
    """The model without what does not stand its trial, beside the rivals of what does; a quick search fits none."""
    model, about, errors = _with_errors(model, log)
    left_out = without(model)
    laws = {key: law_shown(model.evidence, model.fitted, key, left_out[key]) for key in model.keys}
    rivals: dict[Key, list[Rival]] = {}
    for n, key in enumerate(model.keys):
        tell = course.part((0.5 + n) / (0.5 + len(model.keys)), (1.5 + n) / (0.5 + len(model.keys)))
        rivals[key] = rivals_of(model, log, key, laws[key], tell) if depth == FULL else []
    return Judged(model, about, errors, left_out, laws, rivals)


def _without_leaders(judged: Judged, log: Log, depth: Depth, course: Course) -> Judged:
    """The same with each rival that clearly leads in the place of what it leads."""
    tried = {judged.model.keys}
    while (ahead := leader(judged.model, judged.rivals)) is not None:
        model, (key, rival) = judged.model, ahead
        model = model.instead(rival.fitted, key, replace(model.about(key), key=rival.key))
        if model.keys in tried:
            break
        tried.add(model.keys)
        judged = _judged(model, log, depth, course)
    return judged


def _with_table(judged: Judged, log: Log, depth: Depth, course: Course) -> tuple[Judged, Beyond | None]:
    """What no name explains as a table or formula; without the names in whose place that clearly leaves less."""
    if depth != FULL or not any(block.real for block in _left(judged)[1].values()):
        return judged, None
    beyond = beyond_names(judged.model, log)
    gone = stood_in(judged.model, beyond) if beyond else []
    if beyond is None or not gone:
        return judged, beyond
    model, kept = judged.model, tuple(key for key in beyond.said.instead_of if key not in gone)
    for key in gone:
        if key in model.keys:
            model = drop(model, log, key, "what is left of the rest as a table, or as a formula, is clearly less")
    return _judged(model, log, depth, course), replace(beyond, said=replace(beyond.said, instead_of=kept))


def _left(judged: Judged) -> tuple[dict[str, Check], dict[str, BlockLeft]]:
    """The whiteness of what is left, by channel; and per block what is left."""
    model = judged.model
    white = whiteness(model.evidence, model.fitted)
    # a law that the rig has already has other formulations, too
    known = judged.left_out | without_known(model)
    return white, remaining(model, known, {c for c, row in white.items() if row.passed}, coloured(white))


def _with_errors(model: Model, log: Log) -> tuple[Model, Linear, Errors]:
    """The model without what does not stand its trial; its last fit's problem, linearised, and its standard errors."""
    while key := hands_back(model.evidence, model.nominal, model.fitted, model.keys):
        model = drop(model, log, key, "less guided by the measurement, the rig is further from the recording with it")
    while key := raises_the_error(model.evidence, model.nominal, model.fitted, model.keys):
        model = drop(model, log, key, "the held-out error rises with it")
    while True:
        model, slow, fitted, about = refit_slowly(model)
        less = eliminate(model, log, "used")
        if less.keys == model.keys:
            return less, about, standard_errors(slow, fitted, about)
        for key in set(model.keys) - set(less.keys):
            log.refuse(key, "taken back: fitted to all, the rest does as well without it")
        model = less


def _readings(rig: Rig, records: list[Record]) -> list[Evidence]:
    """What the search looks at, with the command held between its samples; and with it smooth if that fits better."""
    tempo, noise, records = tempo_rad_s(rig, records), channel_noise(records), portion(rig, records)
    held = Evidence.gather(rig, records, tempo, noise)
    if rig.only("actuator") is None or not any(np.any(r.u) for r in records):
        return [held]
    smooth = Evidence.gather(rig, [replace(r, u=held_equivalent(r.u)) for r in records], tempo, noise)
    losses = []
    for evidence in (held, smooth):
        fitted = refit.fit(evidence, rig, nominal_free(rig), rounds=refit.QUICK)
        squares = evidence.mean_square(fitted.residuals, "train")
        losses.append(sum(float(np.sum(v * held.floor[n] ** 2)) for n, v in squares.items()))
    return [held, smooth] if losses[1] < SMOOTH_COMMAND_SHARE * losses[0] else [held]


def _searched(readings: list[Evidence], course: Course, depth: Depth = FULL) -> tuple[Model, Log, bool]:
    """The search about the reading of the command that needs the fewest effects, and whether that is the smooth one.

    Missing physics may make the smooth reading fit better, and a delay of half a sample undo it: where what was found
    with it, but for delays, nearly fits the held one, that is searched as well. The held one is the rule.
    """
    course.smooth = len(readings) > 1
    model, log = search(readings[-1], course, depth)
    course.believe(model, log)
    if len(readings) == 1 or depth != FULL:
        return model, log, len(readings) > 1
    held, rig = readings[0], model.fitted.rig
    for key in model.keys:
        if find(rig.kind_at(key[0]), key[1], key[0]).is_delay:
            rig = as_given(held.nominal, rig, key)
    same_laws = refit.fit(held, rig, *all_free(held, rig))
    near = SETTINGS.hopeless_ratio * max(held_loss(model.evidence, model.fitted), SETTINGS.close_floors)
    if held_loss(held, same_laws) > near:
        return model, log, True
    again, log_again = search(held, course.again(), depth)
    fewer = (len(again.named), merit(held, again.fitted)) <= (len(model.named), merit(model.evidence, model.fitted))
    most = SETTINGS.noise_floors * max(worst(model.evidence, model.fitted), 1.0)
    if fewer and worst(held, again.fitted) <= most:
        return again, log_again, False
    return model, log, True


def _diagnosis(
    judged: Judged, beyond: Beyond | None, log: Log, smooth: bool, enough: Enough, depth: Depth
) -> Diagnosis:
    """What a finished search says."""
    model, errors, left_out, rivals = judged.model, judged.errors, judged.left_out, judged.rivals
    evidence, wrong = model.evidence, model.wrong_value
    given = believed(evidence.nominal, wrong)
    moved = moved_parameters(evidence, given, model.fitted, errors)
    white, left = _left(judged)
    real = {name for name, block in left.items() if block.real}
    # where nothing is left, an effort of free form is tried against what was named, at its place
    forms = free_forms(evidence, model.fitted, None if real else {place for place, _ in model.keys}, real or None)
    form = max(forms, key=lambda f: f.t, default=None)
    modelled = beyond.fitted if beyond else None
    free = free_running(evidence, model.nominal, model.fitted, modelled)
    table = fit_table(evidence, model.nominal, model.fitted, modelled)
    much = explained(evidence, model.fitted, table, free, enough)
    grounds = {key: stands(model, log, key, judged.laws[key], rivals[key]) for key in model.keys}
    sure = depth == FULL and model.could_be is None and any(ground.sure for ground in grounds.values())
    verdict = decide(model, left, depends_on(form, left), sure, much, moved)
    rest = max(forms, key=lambda f: f.share, default=None) if real or verdict == UNEXPLAINED else None
    rest = beyond.table.form if beyond else rest
    findings = tuple(finding(model, key, errors, left_out[key], rivals[key], grounds[key]) for key in model.keys)
    if depth != FULL:  # nothing was tried in their places
        findings = tuple(replace(one, confidence="partial") for one in findings)
    values, where = recalibrated(evidence.nominal, moved, wrong), located(left, verdict, rest)
    at_limits = limits_said(at_bounds(model), at_tolerances(evidence.nominal, model.fitted.rig))
    rest_said = explained_said(much, bool(findings))
    found = summary(verdict, findings, values, where if depth != NONE else None, wrong)
    said = replace(beyond.said, sentence=modelled_said(beyond.said, much)) if beyond else None
    parts = SEARCHED[depth], found, rest_said, said.sentence if said else "", at_limits, beyond_said(wrong)
    return Diagnosis(
        verdict=verdict,
        summary=" ".join(filter(None, parts)),
        findings=findings,
        recalibrated=values,
        fit=table,
        recordings=each_recording(evidence, model.nominal, model.fitted),
        candidates=candidates(model, log),
        located=where,
        next_experiment=next_experiment(model, rest, rivals),
        nominal=given,
        extended=with_errors(believed(model.fitted.rig, wrong), errors),
        free_running=free,
        explained=much,
        checks=all_checks(model, errors, free, form, white),
        limits=limits(model, log),
        notes=(SMOOTH,) if smooth else (),
        shown=shown(model, left_out, [law for law in judged.laws.values() if law is not None], rest, said),
        work=_work(evidence, log, smooth),
        calibration=calibration(model.fitted.rig, judged.about, errors),
        modelled=said,
    )


def _work(evidence: Evidence, log: Log, smooth: bool) -> Work:
    records = evidence.records
    return Work(
        sample_time_s=records[0].sample_time_s,
        fitted=sum(int(r.train.sum()) for r in records),
        judged=sum(int(r.held.sum()) for r in records),
        blocks=tuple((b.channels, b.imposed or "", b.pulled or "") for b in evidence.blocks),
        floor={c: float(evidence.floor[b.name][j]) for b in evidence.blocks for j, c in enumerate(b.channels)},
        bank=len(log.scores),
        fits=len(log.trials),
        smooth=smooth,
    )
