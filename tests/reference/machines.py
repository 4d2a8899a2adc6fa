"""From a rig's description to the equations of motion of :mod:`.newton`."""

from __future__ import annotations

import math
from collections.abc import Callable

from dtbacklash.physics.rig import Rig

from .newton import GROUND, SCREW, Body, Contact, Effort, Link, Machine, Screw

#: efforts on single bodies by the name of their effect, each from the effect's parameters
EFFORTS: dict[str, Callable[[dict[str, float]], Effort]] = {
    "gravity": lambda p: lambda q, v, t: p["torque"] * math.sin(q + p["phase"]),
    "quadratic_drag": lambda p: lambda q, v, t: -p["coefficient"] * v * abs(v),
}


def machine(rig: Rig) -> Machine:
    """Read a rig's description."""
    it = Machine()
    rotor, screw = rig.motor_rotor(), rig.only("screw")
    circuit, actuator, amplifier = rig.only("motor_circuit"), rig.only("actuator"), rig.only("amplifier")
    it.amplifier = dict(rig.effects.get(amplifier.name, {})) if amplifier else {}
    masses = [e for kind in ("mass", "carriage", "brake") for e in rig.of_kind(kind)]
    carried = screw.neighbours.get("carries") if screw else None
    compliance = rig.effect(screw.name, "compliance") if screw else None
    inertia = {rotor.name: rotor.values["inertia"]} if rotor else {}
    inertia |= {e.name: e.values["inertia"] for e in rig.of_kind("rotor")}
    inertia |= {e.name: e.values["mass"] for e in masses if e.name != carried or compliance}
    inertia |= {f"{e.name}'s absorber": a["mass"] for e in masses if (a := rig.effect(e.name, "absorber"))}
    first, n = (1 if circuit else 0), len(inertia)
    for j, (name, value) in enumerate(inertia.items()):
        it.bodies[name] = _body(Body(value, first + j, first + n + j), rig.effects.get(name, {}))
        own = rig.elements[name].values.get("friction", 0.0) if name in rig.elements else 0.0
        _contact(it, name, rig.effects.get(name, {}), own, _losses(rig, name))
    it.size = first + 2 * n
    if circuit:
        it.circuit, it.driven = circuit.values, circuit.neighbours["drives"]
        if ripple := rig.effect(circuit.name, "torque_ripple"):
            it.ripple = ripple["relative"], ripple["periods"], ripple["phase"]
    elif actuator:
        it.driven, it.gain = actuator.neighbours["drives"], actuator.values["gain"]
        it.lag = (rig.effect(actuator.name, "lag") or {}).get("time", 0.0)
    elif servo := rig.servo:
        limits = list(rig.effects.get(servo.name, {}).values())
        it.driven, it.servo = servo.neighbours["drives"], {k: v for d in (servo.values, *limits) for k, v in d.items()}
    it.driving = rig.drive.name if rig.drive else ""
    if rotor:
        it.rotor = rotor.name
    if screw:
        reaction, pitch = rig.effect(screw.name, "load_reaction"), rig.effect(screw.name, "pitch_error")
        it.screw = Screw(
            screw.values["lead"],
            share=reaction["share"] if reaction else 0.0,
            pitch=(pitch["amplitude"], pitch["periods"], pitch["phase"]) if pitch else (0.0, 0.0, 0.0),
            carried=carried,
            carried_mass=rig.elements[carried].values["mass"] if carried else 0.0,
            name=screw.name,
        )
        if compliance:  # the axial spring has 2 % of critical damping with the mass that it pushes
            stiffness = 1.0 / compliance["compliance"]
            damping = 2.0 * 0.02 * math.sqrt(stiffness * it.screw.carried_mass)
            it.links.append(Link(SCREW, carried, stiffness, damping))
    for element in masses:
        values = element.values
        it.links.append(
            Link(GROUND, element.name, values.get("ground_stiffness", 0.0), values.get("ground_damping", 0.0))
        )
        if absorber := rig.effect(element.name, "absorber"):
            omega, mass = 2.0 * math.pi * absorber["frequency"], absorber["mass"]
            damping = 2.0 * absorber["damping_ratio"] * omega * mass
            it.links.append(Link(element.name, f"{element.name}'s absorber", omega**2 * mass, damping))
    for element in (e for e in rig.elements.values() if "between" in e.neighbours):
        _link(it, rig, element.name)
    if circuit and (heating := rig.effect(circuit.name, "resistance_heating")):
        it.heating = heating["gain"], heating["time_constant"]
        it.size += 1
    it.size += 1 if it.lag else 0
    return it


def _body(body: Body, effects: dict[str, dict[str, float]]) -> Body:
    body.viscous = effects.get("viscous_friction", {}).get("coefficient", 0.0)
    directed = effects.get("asymmetric_friction", {})
    body.difference = directed.get("viscous_difference", 0.0)
    body.levels = directed.get("coulomb_difference", 0.0)
    if cogging := effects.get("cogging"):
        size = cogging.get("torque", cogging.get("force"))
        body.cogging = size, cogging.get("periods", cogging.get("wave_number")), cogging["phase"]
    load = effects.get("constant_load") or effects.get("constant_force") or {}
    body.load = load.get("torque", load.get("force", 0.0))
    body.others = [EFFORTS[name](values) for name, values in effects.items() if name in EFFORTS]
    return body


def _losses(rig: Rig, body: str) -> dict[str, float]:
    """What brakes a body by a share of what it passes on: its drive, the screw that it turns, a transmission."""
    rotor, found = rig.motor_rotor(), {}
    for name, element in rig.elements.items():
        first = element.neighbours.get("between", [""])[0] == body
        turns = element.kind == "screw" and rotor is not None and rotor.name == body
        drives = element is rig.drive and element.neighbours["drives"] == body
        if (first or turns or drives) and (loss := rig.effect(name, "load_friction")):
            found[name] = loss["share"]
    return found


def _contact(
    it: Machine, name: str, effects: dict[str, dict[str, float]], own: float, losses: dict[str, float]
) -> None:
    dry = effects.get("coulomb_friction") or effects.get("ground_friction") or {}
    stribeck = effects.get("stribeck_friction", {})
    if dry or stribeck or own or losses:
        coulomb = own + dry.get("torque", dry.get("force", 0.0))
        extra = stribeck.get("torque", stribeck.get("force", 0.0))
        it.contacts.append(Contact(GROUND, name, coulomb, extra, stribeck.get("speed", 1.0), losses=losses))


def _link(it: Machine, rig: Rig, name: str) -> None:
    element, effects = rig.elements[name], rig.effects.get(name, {})
    a, b = element.neighbours["between"]
    link = Link(a, b, element.values["stiffness"], element.values.get("damping", 0.0))
    if element.kind in ("belt", "rack"):
        link.arm = element.values["radius"]
    elif element.kind == "gearbox":
        link.arm = 1.0 / element.values["ratio"]
    link.name, link.play = name, effects.get("backlash", {}).get("lost_motion", 0.0)
    link.cubic = effects.get("cubic_stiffness", {}).get("k3", 0.0)
    link.quadratic = effects.get("quadratic_damping", {}).get("c2", 0.0)
    link.drift = effects.get("stiffness_drift", {}).get("rate", 0.0)
    if bumper := effects.get("bumper"):
        link.stop, link.clearance = bumper["stiffness"], bumper["clearance"]
    if hysteresis := effects.get("hysteresis"):
        link.hysteresis = hysteresis.get("force", hysteresis.get("torque"))
        link.displacement = hysteresis["displacement"]
        link.z = it.size
        it.size += 1
    it.links.append(link)
    if dry := effects.get("dry_friction"):
        it.contacts.append(Contact(a, b, dry.get("force", dry.get("torque"))))
