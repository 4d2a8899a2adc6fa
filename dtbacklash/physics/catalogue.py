"""The catalogue: every physical effect that this tool knows, gathered from :mod:`dtbacklash.physics.effects`.

Simulation, diagnosis, concealed recordings, docs, drawings and the checks of a rig's YAML all read it. Register your
own effect by :func:`register` before anything is simulated.
"""

from __future__ import annotations

from dtbacklash import sources
from dtbacklash.errors import UserError
from dtbacklash.physics.effects import body, drive, sensor, spring, table, transmission
from dtbacklash.physics.effects.declare import Effect, Role
from dtbacklash.physics.effects.slots import plain_function
from dtbacklash.physics.kinds import KINDS, SENSOR, Kind

CATALOGUE: dict[tuple[str, str], Effect] = {}

_closed: list[str] = []


def kind_named(name: str) -> Kind:
    """The kind of an element, or that of a sensor.

    Raises
    ------
    KeyError : there is no such kind.
    """
    return SENSOR if name == SENSOR.name else KINDS[name]


def register(effect: Effect) -> None:
    """Add an effect to the catalogue.

    Raises
    ------
    UserError : it acts nowhere (no such kind, a slot that the kind has not), its law asks for what there is not, its
        first parameter does not switch it off, it is there already, or the simulation has been compiled without it.
    """
    key = f"effect {effect.name}"
    if effect.kind not in KINDS and effect.kind != SENSOR.name:
        raise UserError(key, effect.kind, f"acts nowhere; choose one of {', '.join([*KINDS, SENSOR.name])}")
    if not kind_named(effect.kind).takes(effect.slot):
        slot = type(effect.slot).__name__
        raise UserError(key, slot, f"acts nowhere: an element of kind `{effect.kind}` has no such slot")
    if effect.size.neutral is None or effect.size.role not in (Role.SIZE, Role.TIME, Role.KNOT):
        raise UserError(key, effect.size.name, "the first parameter is the size and has a neutral value")
    for parameter in effect.parameters:
        if parameter.name in effect.slot.states:
            raise UserError(key, parameter.name, "is the name of a state of its slot; give the parameter another")
    effect.slot.check(effect)
    if (effect.kind, effect.name) in CATALOGUE:
        raise UserError(key, effect.kind, "is in the catalogue already")
    if _closed:
        raise UserError(key, effect.kind, "register it before the simulation is imported, which compiles all laws")
    for law in effect.slot.laws().values():
        sources.note_foreign(plain_function(law))
    CATALOGUE[effect.kind, effect.name] = effect


def close() -> None:
    """The laws are being compiled: nothing can be registered any more."""
    _closed.append("closed")


def effects_of(kind: str) -> dict[str, Effect]:
    """The effects that an element of this kind takes, by name."""
    return {name: effect for (k, name), effect in CATALOGUE.items() if k == kind}


def find(kind: str, name: str, key: str) -> Effect:
    """The effect ``name`` at an element of ``kind``; ``key`` is the dotted name for the error."""
    effect = CATALOGUE.get((kind, name))
    if effect is None:
        raise UserError(key, name, f"an element of kind `{kind}` takes {', '.join(effects_of(kind)) or 'no effect'}")
    return effect


for _effect in (
    *drive.EFFECTS,
    *body.EFFECTS,
    *transmission.EFFECTS,
    *spring.EFFECTS,
    *sensor.EFFECTS,
    *table.EFFECTS,
):
    register(_effect)
