"""A parameter that several elements share may be another one in one of them: looked at before physics is invented."""

from dataclasses import replace

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.comparison import earns, held_loss, is_noise, merit, same
from dtbacklash.diagnose.fit.free import all_free, nominal_free, tolerances_away, widened, with_tolerance
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.fit.refit import QUICK, fit
from dtbacklash.diagnose.propose.projection import Projection
from dtbacklash.diagnose.search.leave_out import fit_without
from dtbacklash.diagnose.search.trials import Beyond, Search
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.rig import Rig, build_rig

#: parameter, element, field
Use = tuple[str, str, str]
#: step of the difference that a signature is, in tolerances
STEP = 0.1


def own_parameter(evidence: Evidence, before: Fit, likely: float = 1.0) -> Beyond | None:
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
    most = merit(best.evidence, best.fitted) + settings().earn_penalty
    alike = [own for own in others if own is not None and merit(own.evidence, own.fitted) < most]
    return min([best, *alike], key=lambda own: tolerances_away(evidence.nominal, own.fitted.rig)[ranked[0][0]])


def own_instead(found: Search) -> None:
    """Let one element have a parameter of its own instead of all findings, or of one, where that does no worse.

    What fits nearly as well as all of them, and does not take their place, is said.
    """
    if not shared(found.evidence.nominal):
        return
    for left_out in [None, *(found.order if len(found.order) > 1 else [])]:
        before = fit_without(found, left_out) if left_out else found.nominal
        own = own_parameter(found.evidence, before)
        if own is None:
            continue
        if not _does_no_worse(found, own, before):
            if left_out is None and found.order and same(own.evidence, found.fitted, own.fitted):
                found.as_well = own
            continue
        gone = [left_out] if left_out else found.order
        found.refused |= dict.fromkeys(gone, "one element's own parameter does as well")
        if same(own.evidence, own.fitted, found.fitted):
            own = replace(own, instead_of=tuple(gone))
        found.evidence, found.fitted = own.evidence, own.fitted
        found.order, found.as_well = [key for key in found.order if key not in gone], None
        found.beyond = own
        known = own.evidence.nominal
        found.nominal = fit(own.evidence, known, nominal_free(known)) if found.order else own.fitted
        return


def _does_no_worse(found: Search, own: Beyond, before: Fit) -> bool:
    """Whether the effects that were found have not earned what they have more than an own parameter.

    It is known to be there, and they are not: where it explains all but a trifle, and leaves noise of what was fitted
    to as well, the rest may be how a machine differs from any simulation.
    """
    rules, evidence = settings(), own.evidence
    if merit(evidence, own.fitted) < merit(found.evidence, found.fitted) + rules.earn_penalty:
        return True
    if not earns(found.evidence, own.fitted, found.fitted, found.nominal):
        return True
    at_first, by_effects, by_own = (held_loss(evidence, f) ** 2 for f in (before, found.fitted, own.fitted))
    nearly_all = at_first - by_own > (1.0 - rules.same_loss_share) * (at_first - by_effects)
    fitted = max(float(squares.max()) for squares in evidence.mean_square(own.fitted.residuals, "train").values())
    return nearly_all and fitted < rules.noise_floors


def _finished(own: Beyond) -> Beyond | None:
    """A full fit; None if it leaves more than noise."""
    fitted = fit(own.evidence, own.fitted.rig, *all_free(own.evidence, own.fitted.rig))
    return replace(own, fitted=fitted) if is_noise(own.evidence, fitted) else None


def _look(evidence: Evidence, rig: Rig, use: Use) -> Beyond:
    """A quick fit."""
    name, tolerance = title(*use[:2]), evidence.nominal.config.parameters[use[0]].tolerance
    own = with_tolerance(split(evidence.nominal, *use), name, widened(tolerance))
    evidence, start = replace(evidence, nominal=own), split(rig, *use)
    return Beyond(name, tolerance, evidence, fit(evidence, start, *all_free(evidence, start), rounds=QUICK))


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
    return sorted(hopeful, key=lambda use: left[use])[: settings().quick_fits]


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
