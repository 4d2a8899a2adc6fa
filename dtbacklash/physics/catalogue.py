"""The catalogue: every physical effect that this tool knows, gathered from :mod:`dtbacklash.physics.effects`.

Simulation, diagnosis, concealed recordings, docs, drawings and the checks of a rig's YAML all read it. An effect of
one's own is added by :func:`register`, at any time.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from dtbacklash import source_hash
from dtbacklash.errors import UserError
from dtbacklash.physics import user_laws
from dtbacklash.physics.effects import body, drive, sensor, servo, spring, table, transmission
from dtbacklash.physics.effects.c_law import c_law_of
from dtbacklash.physics.effects.declare import Effect, Role
from dtbacklash.physics.effects.slots import formula_of
from dtbacklash.physics.element_kinds import KINDS, SENSOR, Kind

#: where a user keeps laws of his own, below the current directory
OWN = Path("conf") / "effect"
#: so many of them a process knows at most: a twin gets them from machines
OWN_MAX = 1000

CATALOGUE: dict[tuple[str, str], Effect] = {}


def kind_named(name: str) -> Kind:
    """The kind of an element, or that of a sensor.

    Raises
    ------
    KeyError : there is no such kind.
    """
    return SENSOR if name == SENSOR.name else KINDS[name]


#: laws that diagnoses of this process have found
_FOUND: set[str] = set()


def check(effect: Effect) -> None:
    """Refuse an effect that is not whole.

    Raises
    ------
    UserError : it acts nowhere (no such kind, a slot that the kind has not), its law asks for what there is not, its
        first parameter does not switch it off, or it is there already.
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


def register(effect: Effect, foreign: bool = True) -> None:
    """Add an effect to the catalogue; its laws are formulas, or in C.

    Raises
    ------
    UserError : it is not whole (:func:`check`), or a law is a function of Python.

    foreign : whether it comes from outside, so that results depend on it; not a law that a diagnosis has found.
    """
    check(effect)
    for field, law in effect.slot.laws().items():
        formula, key = formula_of(law), f"effect {effect.name}.{field}"
        if formula is None and c_law_of(law) is None:
            allowed = 'a formula as text, e.g. "size*sin(position)", or a C function: CLaw(address, "position")'
            raise UserError(key, f"{law.__name__}()", allowed)
        if foreign and effect.declared is None:  # of what is in C its text has to say when it changes
            source_hash.note_foreign(f"{effect.kind}.{key}: {formula.text if formula else effect.law}")
    if effect.declared is not None and foreign:
        source_hash.note_foreign(f"{effect.kind}.{effect.name}: {json.dumps(effect.declared, sort_keys=True)}")
    CATALOGUE[effect.kind, effect.name] = effect
    if not foreign:
        _FOUND.add(effect.name)


def declare(laws: Mapping[str, Any], key: str, foreign: bool = True) -> None:
    """Add laws that a user wrote, name -> declaration; what is there already with the same declaration stays.

    Raises
    ------
    UserError : one is no law, or another effect has its name; ``key`` is the dotted name for it.
    """
    for name, given in laws.items():
        mine = f"{key}.{name}"
        said = user_laws.packaged(name, mine) if given == user_laws.PACKAGED_LAW else given
        known = [effect for (_, other), effect in CATALOGUE.items() if other == name]
        if known and all(effect.declared is not None and effect.declared == said for effect in known):
            continue
        if len(CATALOGUE) > len(SHIPPED) + OWN_MAX:
            raise UserError(mine, name, f"at most {OWN_MAX} laws of one's own in a process")
        if known:
            raise UserError(mine, name, f"a name that no effect has; there is {name} already: {known[0].law}")
        for effect in user_laws.effects_of_declaration(name, said, mine):
            register(effect, foreign)


def withdraw(names: Iterable[str]) -> None:
    """Forget laws of one's own; a rig that has one of them cannot be built any more."""
    gone = set(names)
    for key in [key for key, effect in list(CATALOGUE.items()) if key[1] in gone and effect.declared is not None]:
        del CATALOGUE[key]
    _FOUND.difference_update(gone)


def declarations(names: set[str]) -> dict[str, Any]:
    """The declarations of those of these effects that users wrote."""
    return {name: dict(e.declared) for (_, name), e in CATALOGUE.items() if name in names and e.declared is not None}


def effects_of(kind: str, names: Collection[str] | None = None) -> dict[str, Effect]:
    """The effects that an element of this kind takes, by name; those of these names only."""
    if names is not None and len(names) == 1:
        (name,) = names
        return {name: CATALOGUE[kind, name]} if (kind, name) in CATALOGUE else {}
    among = CATALOGUE.copy().items()
    return {name: effect for (k, name), effect in among if k == kind and (names is None or name in names)}


def is_found(effect: Effect) -> bool:
    """Whether it is a law that a diagnosis of this process has found."""
    return effect.name in _FOUND


def find(kind: str, name: str, key: str) -> Effect:
    """The effect ``name`` at an element of ``kind``; ``key`` is the dotted name for the error."""
    effect = CATALOGUE.get((kind, name))
    if effect is None:
        raise UserError(key, name, f"an element of kind `{kind}` takes {', '.join(effects_of(kind)) or 'no effect'}")
    return effect


def simpler(effect: Effect) -> Effect | None:
    """The law that an effect becomes (:attr:`.Effect.becomes`) at its kind of element; None where that has none."""
    return CATALOGUE.get((effect.kind, effect.becomes[1])) if effect.becomes else None


for _effect in (
    *drive.EFFECTS,
    *body.EFFECTS,
    *transmission.EFFECTS,
    *spring.EFFECTS,
    *servo.EFFECTS,
    *transmission.PASSING,
    *sensor.EFFECTS,
    *table.EFFECTS,
):
    check(_effect)
    CATALOGUE[_effect.kind, _effect.name] = _effect

#: what comes with the package: its laws are compiled into the simulation
SHIPPED = dict(CATALOGUE)

for _effect in user_laws.installed():
    register(_effect)
for _name, _said in user_laws.folder_declarations(OWN) if not (OWN.parent / "__init__.py").exists() else ():
    declare({_name: _said}, str(OWN))
