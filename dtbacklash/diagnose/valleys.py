"""A law that waves over a position has a fit in every valley: one for each wave more or less over the travel.

Which valley is the right one a regression along the measured motion tells roughly: what the law does to that motion it
does not know. So the neighbours of a fit are tried, and theirs, as long as they explain more.
"""

from collections.abc import Callable

import numpy as np

from dtbacklash.diagnose.earn import merit
from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.free import Key
from dtbacklash.diagnose.problem import Fit
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Role, Values
from dtbacklash.physics.rig import Rig

#: so many to one side are looked at: further away the regression is not wrong
VALLEYS = 10


def best_valley(evidence: Evidence, fitted: Fit, key: Key, quick: Callable[[Values, Rig], Fit]) -> Fit:
    """The best of a fit and of those in the valleys beside it; itself where its law does not wave.

    quick : fits the law quickly from these values of its own, and from a rig's of all others.
    """
    place, name = key
    entry, values = find(evidence.nominal.kind_at(place), name, place), fitted.rig.effect(*key)
    wave, angle = entry.of_role(Role.WAVE), entry.of_role(Role.ANGLE)
    if wave is None or angle is None or values is None or (way := evidence.moving(place).way) <= 0.0:
        return fitted
    lowest = evidence.moving.lowest(place)
    low, high = evidence.bounds(key).get(wave.name, (wave.low, wave.high))
    best = fitted
    for one_more in (2.0 * np.pi / way, -2.0 * np.pi / way):
        for _ in range(VALLEYS):
            values = best.rig.effect(*key) or values
            waves = values[wave.name] + one_more
            if not max(low, wave.low) < waves < min(high, wave.high):
                break
            # at both ends, where a motion is slow as it turns, the waves stay where they are
            phase = float(np.angle(np.exp(1j * (values[angle.name] - one_more * lowest))))
            beside = quick({**values, wave.name: waves, angle.name: phase}, best.rig)
            if merit(evidence, beside) >= merit(evidence, best):
                break
            best = beside
        if best is not fitted:
            break
    return best
