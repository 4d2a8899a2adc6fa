"""What no recording of motion can show: all forces, masses and springs of a block grown alike, at the same voltage.

Positions and speeds stay the same, exactly; only the priors know how large forces are. Differences of simulations
with contacts err, each column by itself, and do not cancel as the columns do: they make the recording look as if it had
seen the direction.
"""

from collections.abc import Iterator

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import places_of
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import Free, effects_of_rig, unit_at
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig

#: powers of the effort in units, where volts, metres, radians and seconds have none
POWERS = {"N": 1, "kg": 1, "A": 1, "W": 1, "ohm": -1, "H": -1} | dict.fromkeys(
    ("V", "m", "rad", "rev", "s", "Hz", "1"), 0
)
#: what grows with the efforts itself
EFFORTS = ("current", "force")


def power(unit: str) -> int | None:
    """With which power of all efforts a quantity of a unit grows; None where the unit is not known."""
    if unit.count("/") > 1:
        return None
    total = 0
    for sign, part in zip((1, -1), (*unit.split("/"), ""), strict=False):
        for factor in part.replace("(", " ").replace(")", " ").split():
            name, _, exponent = factor.partition("^")
            if name not in POWERS or not (exponent or "1").isdigit():
                return None
            total += sign * POWERS[name] * int(exponent or 1)
    return total


def unseen_scalings(evidence: Evidence, rig: Rig, free: list[Free], x: Floats) -> list[Floats]:
    """(parameters,) directions in which a block's efforts grow alike.

    None of a block in which one of them is fixed, has no unit, or acts on another block, too.
    """
    names = {(f.place, f.effect, f.name): j for j, f in enumerate(free)}
    used = [(key, power(unit), users) for key, unit, users in _used(rig)]
    found = []
    for block in evidence.blocks:
        if any(rig.sensors[c].quantity in EFFORTS for c in block.channels):
            continue
        places = places_of(rig, block)
        powers = {key: p for key, p, users in used if users & places}
        others = set[str]().union(*(places_of(rig, b) for b in evidence.blocks if b is not block))
        inside = all(users <= places - others for _, p, users in used if users & places and p)
        if not inside or None in powers.values() or any(p and key not in names for key, p in powers.items()):
            continue
        direction = np.zeros(len(free))
        for key, p in powers.items():
            if p:
                f = free[names[key]]
                direction[names[key]] = p if f.log else p * f.value(x[names[key]]) / f.scale
        if direction.any():
            found.append(direction)
    return found


def _used(rig: Rig) -> Iterator[tuple[tuple[str, str, str], str, set[str]]]:
    """Key of a free parameter, its unit and the places that use it, of all that act in a rig."""
    for name, p in rig.config.parameters.items():
        users = {e for e, spec in rig.config.elements.items() if name in spec.values()}
        if users:
            yield ("", "", name), p.unit or "?", users
    for (place, effect), values in effects_of_rig(rig).items():
        entry = find(rig.kind_at(place), effect, place)
        for q in entry.parameters:
            if q.name not in entry.idle(values):
                yield (place, effect, q.name), unit_at(rig, place, q.unit), {place}
