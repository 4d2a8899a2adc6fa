"""How much of the mismatch the extended rig explains, what it leaves, and whether that is enough."""

import math
import re
from collections.abc import Mapping

import numpy as np

from dtbacklash import units
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.problem import Fit
from dtbacklash.diagnose.shown import Explained, FitTable, FreeRunning, Left, ModelErrors
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig

#: channel -> largest rms that the user calls good enough, and whether that is a share of the motion instead of SI
Enough = dict[str, tuple[float, bool]]


def read_enough(given: Mapping[str, object], rig: Rig) -> Enough:
    """What the user calls good enough: ``0.05 mm``, or a share of the channel's motion (``0.02`` or ``2 %``).

    Raises
    ------
    UserError : a channel that the rig does not have, no positive number, or a unit of another quantity.
    """
    found: Enough = {}
    for channel, value in given.items():
        key = f"enough.{channel}"
        if channel not in rig.sensors:
            raise UserError(key, value, f"no such channel; choose one of {', '.join(rig.sensors)}")
        wanted = rig.sensors[channel].unit
        allowed = f"a number above 0 with a unit of {wanted} ({', '.join(units.of_kind(wanted))}), or a share like 2 %"
        parts = re.fullmatch(r"\s*([-+.\deE]+)\s*(.*?)\s*", str(value))
        written = parts[2] if parts else "?"
        unit = units.find(written)
        try:
            size = float(parts[1]) if parts else math.nan
        except ValueError:
            raise UserError(key, value, allowed) from None
        share = written in ("", "%")
        if not (math.isfinite(size) and size > 0.0) or (not share and (unit is None or unit.si != wanted)):
            raise UserError(key, value, allowed)
        factor = (0.01 if written else 1.0) if share else unit.factor if unit else 1.0
        found[channel] = size * factor, share
    return found


def explained(evidence: Evidence, fitted: Fit, table: FitTable, free: FreeRunning, enough: Enough) -> Explained:
    """What the extended rig explains of what judges.

    table, free : errors of the models as they are compared, and simulated freely. enough : channels that are not in it
    do not count, and an empty one asks for nothing.
    """
    left = {}
    for block in evidence.blocks:
        squares = evidence.mean_square(fitted.residuals, "held")[block.name]
        for j, channel in enumerate(block.channels):
            floors, floor = float(np.sqrt(squares[j])), float(evidence.floor[block.name][j])
            size = float(np.std(np.concatenate([r.y[channel][r.held] for r in evidence.records])))
            unit = evidence.nominal.sensors[channel].unit
            left[channel] = Left(floors * floor, unit, floors * floor / max(size, 1e-300), floors)
    asked = [(left[c].of_motion if share else left[c].rms, most) for c, (most, share) in enough.items() if c in left]
    met = all(rest <= most for rest, most in asked) if asked else None
    compared = table.held_out.extended
    beats = any(error is not None and error < 1.0 for error in (compared, free.held_out.extended))
    floor = table.noise_floor
    freely, compared = (_share(errors.held_out, errors.held_out.extended, floor) for errors in (free, table))
    modelled = None
    if table.held_out.modelled is not None:
        modelled = (
            _share(free.held_out, free.held_out.modelled, floor), _share(table.held_out, table.held_out.modelled, floor)
        )  # fmt: skip
    return Explained(freely, compared, left, met, beats, modelled)


def _share(errors: ModelErrors, error: float | None, floor: float) -> float | None:
    """Share of the nominal rig's mean square error above the floor that a rig with this error does not make."""
    if errors.nominal is None or error is None or errors.nominal <= floor:
        return None
    before, after = errors.nominal**2 - floor**2, max(error**2 - floor**2, 0.0)
    return 1.0 - after / before
