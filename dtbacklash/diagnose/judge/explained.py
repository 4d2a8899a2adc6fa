"""How much of the mismatch the extended rig explains, what it leaves, and whether that is enough."""

from collections.abc import Mapping

import numpy as np

from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.result import Explained, FitTable, FreeRunning, Left, ModelErrors


def explained(
    evidence: Evidence, fitted: Fit, table: FitTable, free: FreeRunning, enough: Mapping[str, float]
) -> Explained:
    """What the extended rig explains of what judges.

    table, free : errors of the models as they are compared, and simulated freely. enough : channel -> rms, SI, that is
    small enough; channels that are not in it do not count, and an empty one asks for nothing.
    """
    left = {}
    for block in evidence.blocks:
        squares = evidence.mean_square(fitted.residuals, "held")[block.name]
        for j, channel in enumerate(block.channels):
            floors, floor = float(np.sqrt(squares[j])), float(evidence.floor[block.name][j])
            size = float(np.std(np.concatenate([r.y[channel][r.held] for r in evidence.records])))
            unit = evidence.nominal.sensors[channel].unit
            left[channel] = Left(floors * floor, unit, floors * floor / max(size, 1e-300), floors)
    met = all(left[c].rms <= most for c, most in enough.items() if c in left) if enough else None
    compared = table.held_out.extended
    beats = any(error is not None and error < 1.0 for error in (compared, free.held_out.extended))
    return Explained(
        _share(free.held_out, table.noise_floor), _share(table.held_out, table.noise_floor), left, met, beats
    )


def _share(errors: ModelErrors, floor: float) -> float | None:
    """Share of the nominal rig's mean square error above the floor that the extended one does not make."""
    if errors.nominal is None or errors.extended is None or errors.nominal <= floor:
        return None
    before, after = errors.nominal**2 - floor**2, max(errors.extended**2 - floor**2, 0.0)
    return 1.0 - after / before
