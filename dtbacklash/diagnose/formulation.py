"""What another formulation of a rig's laws would leave: how far two laws differ that engineers call the same.

How a body is held at rest, how steep a stop is: the catalogue says for each law by which share of its own effect.
"""

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.evidence import Evidence, Residuals
from dtbacklash.diagnose.free import effects_of_rig, taken_out
from dtbacklash.diagnose.problem import Fit
from dtbacklash.diagnose.settings import settings
from dtbacklash.physics.catalogue import find


def other_formulations(
    evidence: Evidence, fitted: Fit, left_out: dict[tuple[str, str], Residuals], part: str = "held"
) -> dict[str, Floats]:
    """Per block, (channels,) mean square that they would leave, in units of the floor's.

    left_out : per effect, what is left without it.
    """
    here = evidence.mean_square(fitted.residuals, part)
    total = {name: np.zeros(len(squares)) for name, squares in here.items()}
    for (place, effect), residuals in left_out.items():
        error = find(evidence.nominal.kind_at(place), effect, place).formulation_error
        share = (settings().formulation_deviations * error) ** 2
        for name, squares in evidence.mean_square(residuals, part).items():
            total[name] += share * np.maximum(squares - here[name], 0.0)
    return total


def formulation_floors(evidence: Evidence, fitted: Fit) -> float:
    """What other formulations of all laws of a fit would leave in the worst channel, in units of the floor's."""
    left_out = {
        key: evidence.residuals(taken_out(fitted.rig, key), fitted.residuals, {key[0]})
        for key in effects_of_rig(fitted.rig)
    }
    return max(float(v.max()) for v in other_formulations(evidence, fitted, left_out).values())
