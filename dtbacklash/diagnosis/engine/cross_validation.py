"""Each recording is left out in turn: what the others alone say of the rig, and whether a name predicts it there.

Recordings are factors of one likelihood. Each has a triangular factor of its rows of the Jacobian, and those of several
are stacked: leaving one out is leaving its factor out, and the values move on by one step of the fit to the others.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.fit import FitProblem, FittedModel
from dtbacklash.diagnosis.engine.intervals import inverse
from dtbacklash.diagnosis.engine.least_squares import STEP_MAX
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.engine.recording_effects import split
from dtbacklash.diagnosis.engine.segments import NoiseLevels, Segments
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig

#: what the others show of a parameter, at least (share of its column's square): else it stays as all have it
SHOWN = 1e-6


def left_out(
    segments: Segments, motion: Motion, model: FittedModel, noise_levels: NoiseLevels | None = None
) -> dict[int, Rig]:
    """Number of a recording -> the rig as the others alone have it.

    What belongs to the recording itself (zeros, ``own``), and a law that it alone shows, stay as they were fitted.
    noise_levels : of what is unknown, other than the model's.
    """
    problem = FitProblem(segments, model.rig, model.keys, motion, model.stiff, model.smooth)
    x, gains = problem.start(), segments.gains(model.rig, noise_levels or model.noise_levels)
    rows = problem.residuals(x, gains)
    if rows is None or not problem.free:
        return dict.fromkeys(segments.recordings, model.rig)
    J = np.column_stack([problem.jacobian(x, gains, rows), rows])
    of = split(segments, np.ones(len(rows))).T > 0.0
    factors = [*(np.asarray(np.linalg.qr(J[own], mode="r")) for own in of), J[problem.innovation_rows :]]
    return {k: problem.rig(x + _step(factors, n)) for n, k in enumerate(segments.recordings)}


def _step(factors: Sequence[Floats], n: int) -> Floats:
    """(free,) the step to the optimum without one of the factors, of a Jacobian and, behind it, its rows."""
    others, most = np.vstack([f for k, f in enumerate(factors) if k != n]), np.vstack(factors)
    free = (others[:, :-1] ** 2).sum(axis=0) > SHOWN * (most[:, :-1] ** 2).sum(axis=0)
    step, J = np.zeros(len(free)), others[:, np.flatnonzero(free)]
    step[free] = -inverse(J) @ (J.T @ others[:, -1])
    return np.clip(step, -STEP_MAX, STEP_MAX)


def predicted(
    segments: Segments, motion: Motion, rigs: Mapping[int, Rig], model: FittedModel, less: Mapping[Key, FittedModel]
) -> dict[Key, tuple[float, ...]]:
    """Name -> per recording, the rms that is left there without the name over that with it, left out of both fits.

    rigs : :func:`left_out` of the model. less : the model without each name. At the noise levels of the model; infinite
    where the rig without it runs away, NaN where that with it does.
    """
    here = _left(segments, rigs, model.noise_levels)
    return {
        key: tuple(
            (_left(segments, left_out(segments, motion, m, model.noise_levels), model.noise_levels) / here).tolist()
        )
        for key, m in less.items()
    }


def _left(segments: Segments, rigs: Mapping[int, Rig], noise_levels: NoiseLevels) -> Floats:
    """(recordings,) rms of the whitened innovations of each, by the rig for it; infinite where it runs away."""
    found = []
    for k, rig in rigs.items():
        own = [(p, s) for p, s in zip(segments.predictors, noise_levels, strict=True) if p.readings.recording == k]
        alone = Segments(segments.nominal, tuple(p for p, _ in own))
        try:
            rows = alone.residuals(rig, alone.gains(rig, tuple(s for _, s in own)))
        except (UserError, np.linalg.LinAlgError):
            rows = None
        found.append(np.inf if rows is None else float(np.sqrt(np.mean(rows**2))))
    return np.array(found)
