"""Readings that repeat: a sensor that is read less often than it is recorded, and one that hangs for a while."""

import math

import numpy as np
from scipy.interpolate import CubicSpline

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.faults.samples import jump
from dtbacklash.diagnose.floor import quantum, sensor_noise
from dtbacklash.diagnose.settings import settings
from dtbacklash.recording.channels import runs

#: fewer changes of a reading show no pattern
CHANGES_MIN = 30
#: so many steps before a pause, and after the one that ends it, tell how fast the motion is
BESIDE = 2


def fresh(values: Floats) -> np.ndarray | None:
    """(N,) the samples at which a channel was read, where it was read more seldom than it was recorded; else None.

    Such a reading changes by several counts at a time, and still never at two samples in a row.
    """
    rules = settings()
    steps = np.diff(values)
    changed = np.flatnonzero(steps) + 1
    gaps = np.diff(changed)
    if len(changed) < CHANGES_MIN or float(np.mean(gaps == 1)) > rules.held_together_share:
        return None
    if float(np.median(np.abs(steps[changed - 1]))) < rules.held_counts * quantum(values):
        return None  # it moves slowly over the counts of its sensor
    found = np.zeros(len(values), dtype=bool)
    found[changed] = True
    return found


def between(values: Floats, known: np.ndarray) -> Floats:
    """(N,) the values that are known, and on a cubic spline through them those between, with the channel's noise.

    The first value counts as known too: it was read then or shortly before. Quiet stretches would lower the noise
    floor, which is read from all of it.
    """
    at = np.union1d([0], np.flatnonzero(known))
    sigma, count = sensor_noise(values[at])
    where = np.minimum(np.arange(len(values)), at[-1])
    found = np.asarray(CubicSpline(at, values[at])(where), dtype=float)
    found += np.where(known, 0.0, sigma * np.random.default_rng(0).standard_normal(len(values)))
    return count * np.round(found / count) if count > 0.0 else found


def hung(values: Floats) -> np.ndarray:
    """(N,) the samples at which a channel repeats its last reading for so long as chance does not, then jumps on.

    A jump leads to where the motion has gone on to, and is larger than the steps beside it. A machine that friction
    holds does not jump on: it sets off and goes on, as all that has mass. What repeats often anyway (a coarse encoder)
    is no fault.
    """
    rules, steps = settings(), np.diff(values)
    same = np.concatenate([[False], steps == 0.0])
    found = np.zeros(len(values), dtype=bool)
    long = [(a, b) for a, b in runs(same) if b - a >= rules.hung_samples_min]
    often = (same.sum() - sum(b - a for a, b in long)) / len(values)
    if not long or often > rules.hung_repeats_share:
        return found
    least = math.log(rules.hung_chance / len(values)) / math.log(max(often, 1.0 / len(values)))
    sizes = np.abs(steps)
    far = max(jump(steps), rules.held_counts * quantum(values))
    for a, b in long:
        if b - a < least or b == len(values):
            continue
        beside = max(sizes[max(a - 1 - BESIDE, 0) : a - 1].max(initial=0.0), sizes[b : b + BESIDE].max(initial=0.0))
        if sizes[b - 1] > max(far, rules.jump_ratio * beside):
            found[a:b] = True
    return found
