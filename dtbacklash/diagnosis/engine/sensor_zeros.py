"""Zeros of position sensors that begin anywhere, where nothing else is fitted yet, or is to be."""

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.parameters import apply, zeros_free
from dtbacklash.diagnosis.engine.resampling import first_read
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig

#: steps of Gauss and Newton; a better start's squares
STEPS, BETTER = 4, 0.99


def zeroed(segments: Segments, rig: Rig) -> Rig:
    """The rig with the zeros that are likeliest on some segments, all else as it is.

    They are looked for from what each sensor reads first, and from where they are.
    """
    free = zeros_free(rig, segments.spreads)
    if not free:
        return rig
    gains = segments.gains(rig, tuple(p.first_noise_levels() for p in segments.predictors))

    def rows(x: Floats, start: Floats, recording: int | None = None, others: Floats | None = None) -> Floats | None:
        try:
            there = segments.residuals(apply(rig, free, x), gains, recording, others)
        except (UserError, np.linalg.LinAlgError):
            return None
        return None if there is None else np.append(there, x - start)  # what shows nowhere stays where it starts

    first = {
        (SENSOR_PREFIX + c, p.readings.recording): first_read(y)
        for p in reversed(segments.predictors) for c, y in zip(p.readings.channels, p.readings.y.T, strict=True)
    }  # fmt: skip
    best = np.inf, np.zeros(len(free))
    for start in (np.array([(first[f.place, f.recording or 0] - f.centre) / f.scale for f in free]), best[1]):
        x, here = start, rows(start, start)
        for _ in range(STEPS):
            if here is None:
                break
            steps = np.diag([f.step for f in free])
            each = (rows(x + step, start, f.recording, here) for f, step in zip(free, steps, strict=True))
            moved = [there for there in each if there is not None]
            if len(moved) < len(free):
                break
            J = (np.column_stack(moved) - here[:, None]) / steps.diagonal()
            there = rows(z := x - np.linalg.lstsq(J, here)[0], start)
            if there is None or not there @ there < here @ here:
                break
            x, here = z, there
        if here is not None and here @ here < BETTER * best[0]:
            best = float(here @ here), x
    return apply(rig, free, best[1])
