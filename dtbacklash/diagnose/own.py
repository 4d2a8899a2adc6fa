"""A parameter that several elements share may be another one in one of them: looked at before physics is invented."""

from dataclasses import dataclass, replace

import numpy as np

from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.free import all_free
from dtbacklash.diagnose.projection import Projection
from dtbacklash.diagnose.refit import Fit, fit
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.rig import Rig, build_rig

#: step of the difference that a signature is, in tolerances
STEP = 0.1


@dataclass(frozen=True)
class Own:
    """A rig in which one element has a parameter of its own, and its fit. evidence : about that rig."""

    evidence: Evidence
    fitted: Fit


def own_parameter(evidence: Evidence, before: Fit) -> Own | None:
    """The parameter of one element that alone explains what a fit leaves, if there is one.

    Each is scored by one simulation, as effects are; the best is fitted where that promises something, and has to leave
    noise.
    """
    listed = shared(evidence.nominal)
    if not listed or is_noise(evidence, before):
        return None
    projection = Projection(evidence, before)
    best, least = None, np.inf
    for name, element, field in listed:
        rig = split(before.rig, name, element, field)
        width = rig.config.parameters[name].tolerance * evidence.nominal.config.parameters[name].value
        own = title(name, element)
        moved = rig.with_parameters({own: rig.config.parameters[own].value + STEP * width})
        changed = evidence.residuals(moved, before.residuals, {element})
        column = projection.project(projection.stack(before.residuals) - projection.stack(changed))
        left = projection.total - float(column @ projection.residual) ** 2 / max(float(column @ column), 1e-300)
        if left < least:
            best, least = (name, element, field), left
    # in the weights of the residual as it is now, noise has its own share of what is left
    noise = sum(float(np.sum(projection.weights[b.name])) for b in evidence.blocks) * projection.samples
    if best is None or least - noise > (1.0 - settings().own_promise_share) * (projection.total - noise):
        return None
    evidence = replace(evidence, nominal=split(evidence.nominal, *best))
    start = split(before.rig, *best)
    fitted = fit(evidence, start, *all_free(evidence, start))
    return Own(evidence, fitted) if is_noise(evidence, fitted) else None


def is_noise(evidence: Evidence, fitted: Fit) -> bool:
    """Whether a fit leaves nothing but noise of what is held out."""
    squares, least = evidence.mean_square(fitted.residuals, "held"), evidence.least()
    return all(bool(np.all(squares[n] < settings().noise_floors * least[n])) for n in squares)


def shared(rig: Rig) -> list[tuple[str, str, str]]:
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
