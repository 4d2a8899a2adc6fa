"""Findings: from the effects and parameters of the last fit to what is said of them, with intervals and rivals."""

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.evidence import Residuals
from dtbacklash.diagnose.fit.comparison import lead_of
from dtbacklash.diagnose.fit.free import (
    Errors,
    Free,
    Key,
    as_given,
    effects_of_rig,
    is_known,
    nominal_free,
    taken_out,
    unit_at,
)
from dtbacklash.diagnose.fit.intervals import NORMAL95
from dtbacklash.diagnose.judge.free_form import Recovered
from dtbacklash.diagnose.judge.stands import Rival
from dtbacklash.diagnose.judge.verdict import BlockLeft, Moved
from dtbacklash.diagnose.named import (
    Alternative,
    Confidence,
    Finding,
    Instead,
    Interval,
    ParameterEstimate,
    Recalibrated,
    Stands,
)
from dtbacklash.diagnose.result import UNEXPLAINED, Candidate, Located, Rest, Verdict
from dtbacklash.diagnose.say.sentences import as_well_said, less, open_said, quantity, when
from dtbacklash.diagnose.search.model import Log, Model, WrongValue, rescaled
from dtbacklash.diagnose.search.objections import unseen
from dtbacklash.diagnose.words import all_in_words, named_in_words, place_in_words
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig


def without(model: Model) -> dict[Key, Residuals]:
    """Per finding, what the last fit leaves if the finding alone is taken out of it."""
    evidence, fitted = model.evidence, model.fitted
    return {
        key: evidence.residuals(as_given(evidence.nominal, fitted.rig, key), fitted.residuals, {key[0]})
        for key in model.keys
    }


def without_known(model: Model) -> dict[Key, Residuals]:
    """The same for each effect that the rig has had from the beginning."""
    rig = model.fitted.rig
    return {
        key: model.evidence.residuals(taken_out(rig, key), model.fitted.residuals, {key[0]})
        for key in effects_of_rig(rig) if is_known(rig, key)
    }  # fmt: skip


def finding(
    model: Model, key: Key, errors: Errors, left_out: Residuals, rivals: list[Rival], grounds: Stands
) -> Finding:
    """What is said of one effect.

    left_out : what remains without it. rivals : that were fitted in its place. grounds : what its name rests on.
    """
    evidence = model.evidence
    place, name = key
    entry = find(evidence.nominal.kind_at(place), name, place)
    values = model.fitted.rig.effect(place, name) or {}
    parameters: dict[str, ParameterEstimate] = {}
    idle, gone = entry.idle(values), _is_not_there(model, key)
    for p in entry.parameters:
        if p.name in idle:
            continue  # nothing asked for it
        error, value = errors.get((place, name, p.name), float("nan")), values[p.name]
        ends = max(value - NORMAL95 * error, p.low), min(value + NORMAL95 * error, p.high)
        if gone and p.neutral is not None:
            ends = min(ends[0], p.neutral), max(ends[1], p.neutral)
        parameters[p.name] = ParameterEstimate(value, unit_at(evidence.nominal, place, p.unit), ends)
    instead = _instead(model, key, rivals)
    shown = {n: quantity(p.value, p.unit) for n, p in parameters.items()}
    silent = idle | unseen(evidence, model.fitted.rig, key, errors)
    said = entry.said(silent).format(location=place_in_words(place), **shown)
    if gone:
        said = f"{named_in_words(name, place)} is not there, or too small to be seen."
    sure: Confidence = "sure" if grounds.sure and model.could_be is None else "partial"
    sentence = said[:1].upper() + said[1:] + _instead_of_known(evidence.nominal, key)
    return Finding(
        place, name, parameters, _also_fits(model, key, rivals), when(model, left_out), instead,
        sentence + open_said(grounds) + less(instead), sure, grounds,
    )  # fmt: skip


def _is_not_there(model: Model, key: Key) -> bool:
    """Whether an effect that the nominal rig has does nothing any more, as what judges is no worse without it."""
    evidence = model.evidence
    if evidence.nominal.effect(*key) is None:
        return False
    here, rig = model.fitted.residuals, taken_out(model.fitted.rig, key)
    return not lead_of(evidence, evidence.residuals(rig, here, {key[0]}), here).clear


def _instead_of_known(nominal: Rig, key: Key) -> str:
    """What the nominal rig says of an effect that it has already, and that was found to be another one."""
    known = nominal.effect(*key)
    if known is None:
        return ""
    entry = find(nominal.kind_at(key[0]), key[1], key[0])
    said = ", ".join(f"{p.name} {quantity(known[p.name], unit_at(nominal, key[0], p.unit))}" for p in entry.parameters)
    return f" The nominal rig has it with {said}; the recording differs from that by more than the tolerance."


def _also_fits(model: Model, key: Key, rivals: list[Rival]) -> tuple[Alternative, ...]:
    """What this recording cannot tell from a finding: rivals that are not beaten, and what no recording tells."""
    others = tuple(Alternative(*t.key, t.reason) for t in model.about(key).alike)
    others += tuple(Alternative(*r.key) for r in rivals if not r.behind.clear)
    return others if model.could_be is None else (*others, _wrong_value(model.could_be))


def _wrong_value(as_well: WrongValue) -> Alternative:
    """A parameter of the rig that would explain as much, at the first element that has it."""
    elements = as_well.evidence.nominal.config.elements
    place = next(name for name, spec in elements.items() if as_well.name in spec.values())
    return Alternative(place, as_well.name, as_well_said(as_well))


def _instead(model: Model, key: Key, rivals: list[Rival]) -> Instead | None:
    """What would be named if an effect were not in the catalogue: the closest of the laws there that are beaten."""
    here = [r for r in rivals if r.key[0] == key[0] and r.behind.clear]
    if not here:
        return None
    close = min(here, key=lambda r: r.behind.ratio)
    place, name = close.key
    size = find(model.evidence.nominal.kind_at(place), name, place).size
    values = close.fitted.rig.effect(place, name) or {}
    return Instead(place, name, values.get(size.name, size.neutral or 0.0), size.unit, close.behind.ratio)


def recalibrated(rig: Rig, moved: Moved, beyond: WrongValue | None) -> dict[str, Recalibrated]:
    """The parameters of the rig that had to move, their intervals, and the effects whose place one of them took."""
    known = {f.title: f for f in nominal_free(rig)}
    taken = {} if beyond is None else {beyond.name: _as_good(beyond.instead_of)}
    return {
        name: Recalibrated(
            known[name].centre, value, unit_of(rig, known[name]), around(value, error), taken.get(name, ())
        )
        for name, (value, error) in moved.items()
    }


def _as_good(keys: tuple[Key, ...]) -> tuple[Alternative, ...]:
    """The effects whose place a parameter took; several explain no less together only."""
    others = {key: all_in_words(other for other in keys if other != key) for key in keys}
    return tuple(Alternative(*key, f"with {rest}" if rest else "") for key, rest in others.items())


def unit_of(rig: Rig, free: Free) -> str:
    """The unit of a free parameter."""
    if not free.effect:
        return rig.config.parameters[free.name].unit
    entry = find(rig.kind_at(free.place), free.effect, free.place)
    return unit_at(rig, free.place, next(p.unit for p in entry.parameters if p.name == free.name))


def around(value: float, error: float) -> Interval:
    """The 95 % interval of a value with a standard error."""
    return value - NORMAL95 * error, value + NORMAL95 * error


def located(left: dict[str, BlockLeft], verdict: Verdict, rest: Recovered | None) -> Located | None:
    """Where what nothing explains sits: the block, and the place and state whose effort explains most of it.

    left : per block.
    """
    if verdict != UNEXPLAINED:
        return None
    name = max(left, key=lambda n: (left[n].real, left[n].share))
    if rest is None:
        return Located(name, name, left[name].share)
    points = tuple(zip(*(_listed(v) for v in (rest.knots, rest.effort, rest.error)), strict=True))
    form = Rest(rest.state, rest.state_unit, rest.effort_unit, rest.share, points)
    return Located(name, rest.place if rest.shown else name, left[name].share, form, rest.shown)


def _listed(values: Floats) -> list[float]:
    return [float(v) for v in values]


def candidates(model: Model, log: Log) -> tuple[Candidate, ...]:
    """The bank about the recalibrated rig, and what became of each entry."""
    tried = {trial.key: (trial, evidence) for trial, evidence in log.trials}
    rows = []
    for score in log.scores:
        key = score.candidate.key
        left, verdict = None, "low score"
        if key in tried:
            trial, evidence = tried[key]
            # all in units of the last floor
            left = rescaled(trial, evidence, log.banks[-1].evidence).held_out
            others = f" beside {trial.beside} found" if trial.beside else ""
            verdict = log.refused.get(key) or log.verdict(trial) or f"fitted{others}, does not earn its place"
        if key in model.keys:
            verdict = "added"
        rows.append(Candidate(*key, score.gain, left, verdict))
    return tuple(rows)
