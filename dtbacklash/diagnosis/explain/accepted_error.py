"""What the user calls good enough."""

import math
import re
from collections.abc import Mapping

from dtbacklash import units
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
