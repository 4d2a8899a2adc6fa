"""A rig taken apart into bodies, what connects them, and the contacts at which dry friction acts."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.element_kinds import GROUND, LINEAR
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.rig import Element, Rig

#: damping ratio of the axial spring of a compliant screw, with the mass that it carries
SCREW_DAMPING_RATIO = 0.02


@dataclass
class Bodies:
    """The bodies that have a state of their own: names, inertias, and stiffness and damping between them."""

    names: list[str]
    inertia: Floats
    K: Floats
    C: Floats
    base_k: Floats  # force on each body per metre of the base
    base_c: Floats
    at_base: float = 0.0  # stiffness that the base feels,
    at_base_c: float = 0.0  # and damping

    def end(self, name: str, base: str | None) -> int:
        """Index of a body, or BASE or GROUND."""
        if name == GROUND:
            return pl.GROUND
        return pl.BASE if name == base else self.names.index(name)

    def connect(self, a: int, b: int, k: float, c: float, lever: float = 1.0) -> None:
        """Put a spring and a damper between two ends; ``lever`` : how far the spring's end goes per unit of end a."""
        for one, other, own in ((a, b, lever**2), (b, a, 1.0)):
            if one >= 0:
                self.K[one, one] += own * k
                self.C[one, one] += own * c
                if other >= 0:
                    self.K[one, other] -= lever * k
                    self.C[one, other] -= lever * c
                elif other == pl.BASE:
                    self.base_k[one] += k
                    self.base_c[one] += c
            elif one == pl.BASE:
                self.at_base += k
                self.at_base_c += c


@dataclass
class FrictionContact:
    """Dry friction between two ends.

    effects : that make its level. loads : what each of them carries: the index of a spring, DRIVE, SCREW or NOTHING.
    level : of the element itself, N or N m.
    """

    ends: tuple[int, int]
    effects: list[tuple[Effect, Values]]
    loads: list[int]
    level: float = 0.0


@dataclass
class Parts:
    """The rig taken apart into what the arrays need.

    base : the mass that moves with a rigid screw, or the positioner. rotor : index of the motor's among the bodies, or
    -1. springs : the links, couplings and shafts that are simulated, in the order of ``link``.
    """

    rig: Rig
    bodies: Bodies
    base: str | None
    imposed: bool
    rotor: int = -1
    springs: list[Element] = field(default_factory=list)
    link: list[list[float]] = field(default_factory=list)
    link_ends: list[tuple[int, int]] = field(default_factory=list)
    contacts: list[FrictionContact] = field(default_factory=list)


def take_apart(rig: Rig, imposed: bool) -> Parts:
    """Bodies, springs and contacts of a rig.

    ``imposed`` : the motor's angle (or the positioner's command) is given; then nothing that turns is simulated.

    Raises
    ------
    UserError : an effect that cannot act in this rig: a force on a mass that moves as the screw does.
    """
    if rig.config.model:
        raise UserError("rig.model", rig.config.model, "is simulated in a diagnosis only, by its own simulator")
    screw, base = rig.only("screw"), _base(rig)
    carried = screw.neighbours.get("carries") if screw else None
    simulated = [e for e in rig.bodies() if e.name != base and not (imposed and e.trait.axis != LINEAR)]
    motor = rig.motor_rotor()
    simulated.sort(key=lambda e: (motor is None or e.name != motor.name, e.trait.axis == LINEAR))
    inertia = {e.name: e.values[e.trait.inertia] for e in simulated}
    hidden = hidden_bodies(rig)
    inertia |= {name: mass for name, (_, mass, _, _) in hidden.items()}
    parts = Parts(rig, _no_springs(inertia, rig.number), base, imposed)
    bodies = parts.bodies
    parts.rotor = bodies.names.index(motor.name) if motor and motor.name in bodies.names else -1
    axial = screw_spring(rig)
    if axial is not None and carried:
        bodies.connect(pl.BASE, bodies.names.index(carried), *axial)
    for element in rig.bodies():
        ground = element.values.get("ground_stiffness", 0.0), element.values.get("ground_damping", 0.0)
        if {"ground_stiffness", "ground_damping"} & set(element.values):
            bodies.connect(pl.GROUND, bodies.end(element.name, base), *ground)
    for name, (host, _, k, c) in hidden.items():
        bodies.connect(bodies.end(host, base), bodies.names.index(name), k, c)
    for element in rig.links():
        if not (imposed and element.trait.axis != LINEAR):
            _add_spring(parts, element)
    if rig.servo and rig.servo.neighbours["drives"] in bodies.names:
        gains = rig.servo.values["position_gain"], rig.servo.values.get("speed_gain", 0.0)
        bodies.connect(pl.GROUND, bodies.names.index(rig.servo.neighbours["drives"]), *gains)
    for element in rig.elements.values():
        _add_bearing(parts, element)
    # what the screw carries depends on the friction at all other places: it comes last
    parts.contacts.sort(key=lambda contact: pl.SCREW in contact.loads)
    _check_base(rig, base)
    return parts


def screw_spring(rig: Rig) -> tuple[float, float] | None:
    """Stiffness, N/m, and damping, N s/m, of a compliant screw; None where it is rigid.

    Raises
    ------
    UserError : it carries no mass.
    """
    screw = rig.only("screw")
    compliance = rig.amount(screw.name, slots.Yielding, "compliance") if screw else 0.0
    if screw is None or not compliance:
        return None
    carried = screw.neighbours.get("carries")
    if not carried:
        raise UserError(f"rig.effects.{screw.name}.compliance", compliance, "a screw that carries a mass")
    stiffness = 1.0 / compliance
    return stiffness, 2.0 * SCREW_DAMPING_RATIO * np.sqrt(stiffness * rig.elements[carried].values["mass"])


def _base(rig: Rig) -> str | None:
    """The body whose motion no force can change: a positioner, or the mass on a rigid screw."""
    if positioner := rig.only("positioner"):
        return positioner.name
    screw = rig.only("screw")
    if screw is None or rig.amount(screw.name, slots.Yielding, "compliance"):
        return None
    return screw.neighbours.get("carries")


def _no_springs(inertia: dict[str, float], number: Any) -> Bodies:
    n, masses = len(inertia), np.array(list(inertia.values()), dtype=number)
    K, C = np.zeros((2, n, n), dtype=number)
    base_k, base_c = np.zeros((2, n), dtype=number)
    return Bodies(list(inertia), masses, K, C, base_k, base_c)


def hidden_bodies(rig: Rig) -> dict[str, tuple[str, float, float, float]]:
    """Hidden bodies: name -> (the body that carries it, its mass, stiffness, damping)."""
    found = {}
    for element in rig.bodies():
        for effect, values in rig.active(element.name, slots.HiddenBody):
            slot = effect.slot
            assert isinstance(slot, slots.HiddenBody)
            m, zeta = values[slot.mass], values[slot.damping_ratio]
            omega = 2.0 * math.pi * values[slot.frequency]
            found[f"{effect.name} of {element.name}"] = element.name, m, m * omega**2, 2 * zeta * omega * m
    return found


def _add_spring(parts: Parts, element: Element) -> None:
    bodies = parts.bodies
    a, b = (bodies.end(name, parts.base) for name in element.neighbours["between"])
    row = [0.0] * pl.N_LINK
    row[pl.L_K], row[pl.L_C] = element.values["stiffness"], element.values.get("damping", 0.0)
    row[pl.L_LEVER] = element.lever
    bodies.connect(a, b, row[pl.L_K], row[pl.L_C], element.lever)
    parts.springs.append(element)
    parts.link.append(row)
    parts.link_ends.append((a, b))
    if not element.trait.first and (dry := parts.rig.active(element.name, slots.Contact)):
        parts.contacts.append(FrictionContact((a, b), dry, [len(parts.link) - 1] * len(dry)))


def _add_bearing(parts: Parts, element: Element) -> None:
    """Add a body's friction against the ground; the viscous part goes into the damping matrix."""
    rig, names = parts.rig, parts.bodies.names
    if element.name not in names:
        return
    body = names.index(element.name)
    parts.bodies.C[body, body] += rig.amount(element.name, slots.BodyDamping, "coefficient")
    drive = rig.drive if rig.drive and rig.drive.neighbours["drives"] == element.name else None
    sources = [(element.name, pl.DRIVE if drive else pl.NOTHING)]
    sources += [(drive.name, pl.DRIVE)] if drive else []
    sources += [
        (spring.name, j)
        for j, spring in enumerate(parts.springs)
        if spring.trait.first and spring.neighbours["between"][0] == element.name
    ]
    screw = rig.only("screw")
    sources += [(screw.name, pl.SCREW)] if screw and body == parts.rotor else []
    found = [(one, load) for place, load in sources for one in rig.active(place, slots.Contact)]
    level = element.values.get("friction", 0.0)
    if found or level:
        effects, loads = [one for one, _ in found], [load for _, load in found]
        parts.contacts.append(FrictionContact((pl.GROUND, body), effects, loads, level))


def _check_base(rig: Rig, base: str | None) -> None:
    """Refuse forces on the mass that a rigid screw carries: it moves as the screw does, whatever pushes it."""
    there = rig.effects.get(base or "", {})
    swinging = [effect.name for effect, _ in rig.active(base or "", slots.HiddenBody)] if there else []
    for name in there:
        if name not in swinging:
            allowed = (
                "no force on a mass that a rigid screw carries; give the screw `compliance` or choose another mass"
            )
            raise UserError(f"rig.effects.{base}.{name}", there[name], allowed)


def natural_frequencies_hz(rig: Rig) -> Floats:
    """Undamped frequencies at which the bodies swing while the gear stands, ascending, Hz; without rigid motions."""
    if rig.config.model:
        return np.zeros(0)
    bodies = take_apart(rig, rig.only("positioner") is not None).bodies
    if not bodies.names:
        return np.zeros(0)
    root = np.sqrt(bodies.inertia)
    squares = np.linalg.eigvalsh(bodies.K / root[:, None] / root[None, :])
    swinging: Floats = np.sqrt(squares[squares > 1e-9 * max(squares.max(), 1e-300)]) / (2.0 * math.pi)
    return swinging
