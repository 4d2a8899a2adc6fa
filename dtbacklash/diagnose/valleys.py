"""A law that waves over a position has a fit in every valley: one for each wave more or less over the travel.

Which valley is the right one a regression along the measured motion tells roughly: what the law does to that motion it
does not know. So the neighbours of a fit are tried, and theirs, as long as they explain more.
"""

import numpy as np

from dtbacklash.diagnose.earn import merit
from dtbacklash.diagnose.evidence import Evidence
from dtbacklash.diagnose.free import Key
from dtbacklash.diagnose.leave_out import refit_with
from dtbacklash.diagnose.problem import Fit
from dtbacklash.diagnose.refit import QUICK
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.declare import Role

#: so many to one side are looked at: further away the regression is not wrong
VALLEYS = 10


def in_the_best_valley(evidence: Evidence, current: Fit, key: Key, fitted: Fit) -> Fit:
    """A full fit of a law beside those of ``current``, where the number of waves explains most."""
    best = _best_valley(evidence, current, key, fitted)
    values = best.rig.effect(*key)
    if best is fitted or values is None:
        return fitted
    again = refit_with(evidence, current, [(key, values)], near=best.rig)
    return min(fitted, again, key=lambda f: merit(evidence, f))


def _best_valley(evidence: Evidence, current: Fit, key: Key, fitted: Fit) -> Fit:
    """The best of a fit and of quick ones in the valleys beside it; itself where its law does not wave."""
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
            there = {**values, wave.name: waves, angle.name: phase}
            beside = refit_with(evidence, current, [(key, there)], rounds=QUICK, near=best.rig)
            if merit(evidence, beside) >= merit(evidence, best):
                break
            best = beside
        if best is not fitted:
            break
    return best
