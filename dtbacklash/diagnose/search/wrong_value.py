"""One value of the rig may be wrong: looked at before physics is said to be missing.

Tolerances are what the user believes. Where one of them is wrong, an effect that nearly fits is found in its place, and
the other parameters go far from nominal to make up for the rest. Either a parameter is beyond its tolerance, or one of
the elements that share it has a value of its own.
"""

from collections.abc import Callable
from dataclasses import replace

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import alike, held_loss, is_noise, lead, lead_of, merit, worst
from dtbacklash.diagnose.fit.free import (
    Key,
    all_free,
    known_free,
    nominal_free,
    tolerances_away,
    widened,
    with_tolerance,
)
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import QUICK, fit
from dtbacklash.diagnose.propose.projection import Projection
from dtbacklash.diagnose.search.leave_out import fit_without
from dtbacklash.diagnose.search.model import Log, Model, WrongValue
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.rig import Rig, build_rig

#: so much less of the prior's penalty makes up for no gain: parameters come back from four tolerances (-2 log-
#: likelihood)
EARN_PENALTY = 15.0

#: one wrong value that explains this share of what effects do, and leaves noise, is likelier than they are
NEARLY_ALL = 0.98
#: a quick fit that leaves more of the nominal rig's loss than this has not begun to explain it
BEGUN = 0.5
#: parameter, element, field
Use = tuple[str, str, str]
#: step of the difference that a signature is, in tolerances
STEP = 0.1


def explains_alone(model: Model, log: Log, recalibrate: Callable[[Evidence], Fit]) -> bool:
    """Whether one parameter, beyond its tolerance, leaves nothing but noise where the nominal rig leaves more.

    Then no two effects are looked for: a conspiracy of them is less likely than one wrong number.

    recalibrate : fits the nominal rig of an evidence.
    """
    if is_noise(model.evidence, model.fitted):
        return False
    log.wrong_values += _beyond_tolerance(model, recalibrate)
    best = _best(log.wrong_values)
    return best is not None and is_noise(best.evidence, best.fitted)


def wrong_value_instead(model: Model, log: Log) -> Model:
    """Let one wrong value take the place of effects where that does no worse; one that fits as well is noted."""
    model = _beyond_instead(model, log)
    return model if model.wrong_value is not None else _own_instead(model, log)


def _beyond_instead(model: Model, log: Log) -> Model:
    """Let one parameter go beyond its tolerance where that does better than all effects, or than several parameters."""
    trial = _best([_seen_anew(model.evidence, trial) for trial in log.wrong_values])
    if trial is None:
        return model
    if merit(trial.evidence, trial.fitted) + EARN_PENALTY < merit(model.evidence, model.fitted):
        for key in model.keys:
            log.refuse(key, f"`{trial.name}`, beyond its tolerance, does better alone")
        trial = _as_well(trial, model, model.keys)
        return replace(
            model, evidence=trial.evidence, nominal=trial.fitted, fitted=trial.fitted, named=(), wrong_value=trial
        )
    if model.named and alike(trial.evidence, model.fitted, trial.fitted):
        return replace(model, could_be=trial)
    return model


def _beyond_tolerance(model: Model, recalibrate: Callable[[Evidence], Fit]) -> list[WrongValue]:
    """The parameters that alone, let go beyond their tolerances, do not leave far more than noise."""
    nominal, trials = model.evidence.nominal, []
    for name in (f.name for f in nominal_free(nominal) if not f.effect):
        parameter = nominal.config.parameters[name]
        wide = widened(parameter.tolerance)
        if wide <= parameter.tolerance:
            continue  # nobody claimed to know it
        evidence = replace(model.evidence, nominal=with_tolerance(nominal, name, wide))
        if not _hopeless(model, evidence):
            trials.append(WrongValue(name, parameter.tolerance, evidence, recalibrate(evidence)))
    return trials


def _best(trials: list[WrongValue]) -> WrongValue | None:
    """The likeliest of those that leave little more than noise; None if there is none."""
    able = [trial for trial in trials if worst(trial.evidence, trial.fitted) < SETTINGS.nearly_noise_floors]
    return min(able, key=lambda trial: merit(trial.evidence, trial.fitted), default=None)


def _seen_anew(evidence: Evidence, trial: WrongValue) -> WrongValue:
    """The same about evidence whose floor or pull is another one, fitted from where it ended."""
    known = trial.evidence.nominal
    if evidence.floor is trial.evidence.floor and evidence.blocks is trial.evidence.blocks:
        return trial
    evidence = replace(evidence, nominal=known)
    return replace(trial, evidence=evidence, fitted=fit(evidence, known, *known_free(evidence, trial.fitted.rig)))


def _hopeless(model: Model, evidence: Evidence) -> bool:
    """Whether quick fits, from the nominal rig and from its fit, leave far more than noise, or than the model does."""
    nominal = evidence.nominal
    starts = (known_free(evidence, rig) for rig in (nominal, model.nominal.rig))
    left = min(held_loss(evidence, fit(evidence, nominal, *start, rounds=QUICK)) for start in starts)
    if worst(model.evidence, model.fitted) > SETTINGS.nearly_noise_floors:
        most = max(BEGUN * held_loss(model.evidence, model.nominal), SETTINGS.hopeless_ratio)
    else:
        most = SETTINGS.hopeless_ratio * max(held_loss(model.evidence, model.fitted), 1.0)
    return left > most


def _own_instead(model: Model, log: Log) -> Model:
    """Let one element have a parameter of its own instead of all effects, or of one, where that does no worse.

    What fits nearly as well as all of them, and does not take their place, is noted.
    """
    if not shared(model.evidence.nominal):
        return model
    for left_out in [None, *(model.keys if len(model.named) > 1 else ())]:
        before = fit_without(model, log, left_out) if left_out else model.nominal
        own = own_parameter(model.evidence, before)
        if own is None:
            continue
        if _does_no_worse(model, own, before):
            return _with_own(model, log, own, (left_out,) if left_out else model.keys)
        if left_out is None and model.named and alike(own.evidence, model.fitted, own.fitted):
            model = replace(model, could_be=own)
    return model


def _with_own(model: Model, log: Log, own: WrongValue, gone: tuple[Key, ...]) -> Model:
    """The model with an element's own parameter in the place of some effects."""
    for key in gone:
        log.refuse(key, "one element's own parameter does as well")
    own = _as_well(own, model, gone)
    model = replace(model.minus(own.fitted, *gone), evidence=own.evidence, wrong_value=own, could_be=None)
    known = own.evidence.nominal
    return replace(model, nominal=fit(own.evidence, known, nominal_free(known)) if model.named else own.fitted)


def _as_well(wrong: WrongValue, model: Model, gone: tuple[Key, ...]) -> WrongValue:
    """With the effects whose place it takes noted, where they explain no less."""
    ahead = lead_of(wrong.evidence, model.fitted.residuals, wrong.fitted.residuals).clear
    return wrong if ahead else replace(wrong, instead_of=gone)


def own_parameter(evidence: Evidence, before: Fit, likely: float = 1.0) -> WrongValue | None:
    """The parameter of one element that alone explains what a fit leaves, if there is one.

    Each is scored by one simulation, as effects are; the best are looked at, as masses that swing out of step show
    themselves only when a fit is near; the best of these is fitted, and has to leave noise.

    likely : those are looked at of which the score leaves at most this share of what the fit leaves.
    """
    if not shared(evidence.nominal) or is_noise(evidence, before):
        return None
    looks = {use: _look(evidence, before.rig, use) for use in _promising(evidence, before, likely)}
    if not looks:
        return None
    ranked = sorted(looks, key=lambda use: merit(looks[use].evidence, looks[use].fitted))
    best = _finished(looks[ranked[0]])
    if best is None:
        return None
    # of two elements that share it either one may have its own: the one that leaves the shared value where it was
    others = [_finished(looks[use]) for use in ranked[1:] if use[0] == ranked[0][0]]
    most = merit(best.evidence, best.fitted) + EARN_PENALTY
    alike = [own for own in others if own is not None and merit(own.evidence, own.fitted) < most]
    return min([best, *alike], key=lambda own: tolerances_away(evidence.nominal, own.fitted.rig)[ranked[0][0]])


def _does_no_worse(model: Model, own: WrongValue, before: Fit) -> bool:
    """Whether the effects that are named have not earned what they have more than an own parameter.

    It is known to be there, and they are not: where it explains all but a trifle, and leaves noise of what was fitted
    to as well, the rest may be how a machine differs from any simulation.
    """
    evidence = own.evidence
    if merit(evidence, own.fitted) < merit(model.evidence, model.fitted) + EARN_PENALTY:
        return True
    if not lead(model.evidence, own.fitted, model.fitted).clear:
        return True
    at_first, by_effects, by_own = (held_loss(evidence, f) ** 2 for f in (before, model.fitted, own.fitted))
    nearly_all = at_first - by_own > NEARLY_ALL * (at_first - by_effects)
    fitted = max(float(squares.max()) for squares in evidence.mean_square(own.fitted.residuals, "train").values())
    return nearly_all and fitted < SETTINGS.noise_floors


def _finished(own: WrongValue) -> WrongValue | None:
    """A full fit; None if it leaves more than noise."""
    fitted = fit(own.evidence, own.fitted.rig, *all_free(own.evidence, own.fitted.rig))
    return replace(own, fitted=fitted) if is_noise(own.evidence, fitted) else None


def believed(rig: Rig, trial: WrongValue | None) -> Rig:
    """A rig with the tolerance that was given for the parameter which went beyond it, if one did."""
    return rig if trial is None else with_tolerance(rig, trial.name, trial.tolerance)


def _look(evidence: Evidence, rig: Rig, use: Use) -> WrongValue:
    """A quick fit."""
    name, tolerance = title(*use[:2]), evidence.nominal.config.parameters[use[0]].tolerance
    own = with_tolerance(split(evidence.nominal, *use), name, widened(tolerance))
    evidence, start = replace(evidence, nominal=own), split(rig, *use)
    return WrongValue(name, tolerance, evidence, fit(evidence, start, *all_free(evidence, start), rounds=QUICK))


def _promising(evidence: Evidence, before: Fit, likely: float) -> list[Use]:
    """The shared parameters that, of one element alone, promise to explain most of what is left; the best first."""
    projection, left = Projection(evidence, before), {}
    for use in shared(evidence.nominal):
        name, element, _ = use
        rig, own = split(before.rig, *use), title(name, element)
        width = rig.config.parameters[name].tolerance * evidence.nominal.config.parameters[name].value
        moved = rig.with_parameters({own: rig.config.parameters[own].value + STEP * width})
        changed = evidence.residuals(moved, before.residuals, {element})
        column = projection.project(projection.stack(before.residuals) - projection.stack(changed))
        gain = float(column @ projection.residual) ** 2 / max(float(column @ column), 1e-300)
        left[use] = projection.total - gain
    hopeful = [use for use in left if left[use] <= likely * projection.total]
    return sorted(hopeful, key=lambda use: left[use])[: SETTINGS.quick_fits]


def shared(rig: Rig) -> list[Use]:
    """(parameter, element, field) wherever several elements, or fields of one, use the same parameter."""
    uses = [
        (spec[field], element, field)
        for element, spec in rig.config.elements.items() for field in rig.elements[element].values
    ]  # fmt: skip
    names = [name for name, _, _ in uses]
    return [use for use in uses if names.count(use[0]) > 1 and rig.config.parameters[use[0]].tolerance > 0.0]


def title(parameter: str, element: str) -> str:
    """Name of an element's own parameter."""
    return f"{parameter}_{element}"


def split(rig: Rig, parameter: str, element: str, field: str) -> Rig:
    """The rig with a parameter of its own at one element, which begins where the shared one stands."""
    config = rig.config
    shared, name = config.parameters[parameter], title(parameter, element)
    parameters = {**config.parameters, name: replace(shared, description=f"{shared.description} ({element} alone)")}
    elements = {**config.elements, element: {**config.elements[element], field: name}}
    return build_rig(replace(config, parameters=parameters, elements=elements))
