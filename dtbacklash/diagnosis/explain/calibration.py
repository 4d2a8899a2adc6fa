"""What a recording says of the rig's own parameters: how they go together, and along which directions it is blind.

The fit is linearised at its end. A direction is a pattern of small changes of all parameters, each counted in its
tolerance (of a found effect, in its size); the data's rows of the Jacobian say how large a change along it they would
notice. Where that is more than the tolerances allow, the recording adds nothing to what was believed: it is blind
there, as for masses, springs and dampers that all grow alike while only positions are recorded. The singular values are
those of Belsley, Kuh and Welsch, Regression Diagnostics (1980).
"""

import math

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.conclusion import Conclusion
from dtbacklash.diagnosis.engine.parameters import FreeParameter, unit_of
from dtbacklash.diagnosis.explain.findings import around
from dtbacklash.diagnosis.findings import Blind, Calibration, Recalibrated
from dtbacklash.diagnosis.labels import listed

#: along a blind direction the data alone leave an error of so many tolerances or more
BLIND_TOLERANCES = 1.0
#: a parameter takes part in a direction where its relative change is at least this of the largest one's
TAKES_PART = 0.3
#: parameters grow alike where their relative changes differ by less than this factor
ALIKE_RATIO = 1.5


def calibration(c: Conclusion) -> Calibration:
    """The parameters at the end of a fit, with intervals, correlations and blind directions."""
    values, rig = c.values, c.model.rig
    if not values.free or not len(values.rows):
        return Calibration({}, {}, ())
    kept = [j for j, f in enumerate(values.free) if not f.is_zero]
    free, covariance = [values.free[j] for j in kept], values.covariance[np.ix_(kept, kept)]
    titles = [c.label(f.shared_title, f.recording) for f in free]
    sizes = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(sizes, sizes)
    rows = {}
    for title, f, x in zip(titles, free, values.x[kept], strict=True):
        value, error = f.value(x), values.errors.get((f.place, f.effect, f.label), math.nan)
        rows[title] = Recalibrated(f.centre, value, unit_of(rig, f), around(value, error))
    data = c.search.segments.innovations
    return Calibration(
        rows,
        {a: dict(zip(titles, map(float, row), strict=True)) for a, row in zip(titles, correlation, strict=True)},
        tuple(_blind(free, titles, values.jacobian[:data, kept])),
    )


def _blind(free: list[FreeParameter], titles: list[str], data: Floats) -> list[Blind]:
    """The directions that the data determine less than the tolerances do, the blindest first."""
    _, sizes, directions = np.linalg.svd(data, full_matrices=False)
    found = []
    for size, direction in sorted(zip(sizes, directions, strict=True), key=lambda pair: float(pair[0])):
        if size * BLIND_TOLERANCES >= 1.0:
            break
        changes = direction * np.array([_relative(one) for one in free])
        leading = changes[np.argmax(np.abs(changes))]  # upwards
        part = {
            title: float(math.copysign(1.0, leading) * change)
            for title, change in zip(titles, changes, strict=True)
            if abs(change) >= TAKES_PART * abs(leading)
        }
        found.append(Blind(part, float(1.0 / max(size, 1e-12)), blind_said(part)))
    return found


def _relative(free: FreeParameter) -> float:
    """The relative change of a parameter for a step of one in its x: its tolerance, or 1 of a found effect's."""
    return 1.0 if free.log or free.centre == 0.0 else free.scale / free.centre


def blind_said(changes: dict[str, float]) -> str:
    """A blind direction in words. changes : parameter -> relative change along it."""
    up = [f"`{name}`" for name, change in changes.items() if change > 0.0]
    down = [f"`{name}`" for name, change in changes.items() if change < 0.0]
    if len(changes) == 1:
        return f"{listed(up or down)} is not seen: it stays as it was believed."
    sizes = np.abs(list(changes.values()))
    alike = " alike" if sizes.max() < ALIKE_RATIO * sizes.min() else " together"
    while_ = f" while {listed(down)} {'falls' if len(down) == 1 else 'fall'}" if up and down else ""
    how = "" if len(up or down) == 1 else alike
    return f"{listed(up or down)} can grow{how}{while_}: the recording does not notice."
