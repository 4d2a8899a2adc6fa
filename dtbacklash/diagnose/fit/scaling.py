"""Parameters' directions that no recorded motion determines: all forces, masses and springs of a block grow alike.

Positions and speeds stay exactly the same at the same voltage; only the priors tell how large forces are. The errors of
finite differences do not cancel along such a direction and would make it look determined.
"""

from collections.abc import Iterator

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnose.data.compare import places_of
from dtbacklash.diagnose.data.evidence import Evidence
from dtbacklash.diagnose.fit.free import Free, effects_of_rig, unit_at
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import Rig

#: unit -> power with which it grows with all efforts at the same voltages, lengths, angles and times
POWERS = {"N": 1, "kg": 1, "A": 1, "W": 1, "ohm": -1, "H": -1} | dict.fromkeys(
    ("V", "m", "rad", "rev", "s", "Hz", "1"), 0
)
#: measured quantities that grow with the efforts
EFFORTS = ("current", "force", "torque")


def power(unit: str) -> int | None:
    """The power with which a quantity of a unit grows with all efforts; None for an unknown unit."""
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
    """(parameters,) per block the direction in which all its efforts grow alike.

    Blocks are left out in which an effort is fixed, has no known unit, or also acts on another block.
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
    """(place, effect, name), unit and places of each parameter that acts in a rig."""
    for name, p in rig.config.parameters.items():
        users = {e for e, spec in rig.config.elements.items() if name in spec.values()}
        if users:
            yield ("", "", name), p.unit or "?", users
    for (place, effect), values in effects_of_rig(rig).items():
        entry = find(rig.kind_at(place), effect, place)
        for q in entry.parameters:
            if q.name not in entry.idle(values):
                yield (place, effect, q.name), unit_at(rig, place, q.unit), {place}
