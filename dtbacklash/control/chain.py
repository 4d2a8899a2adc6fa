"""From a rig to what the design of a controller needs: the motor, and the chain behind the screw."""

from dtbacklash.control.design import MotorParameters, StructureParameters
from dtbacklash.errors import UserError
from dtbacklash.physics.bodies import screw_spring
from dtbacklash.physics.effects import slots
from dtbacklash.physics.rig import Element, Rig


def driven_chain(rig: Rig) -> tuple[list[Element], list[Element]]:
    """Masses and links behind the mass that the screw carries, in order.

    Raises
    ------
    UserError : the rig is not a screw-driven chain of masses, for which the paper's controllers are made.
    """
    screw = rig.only("screw")
    base = screw.neighbours.get("carries") if screw else None
    allowed = (
        "a rig with a motor, a screw that carries a mass, and a chain of links from there, or controller=open_loop"
    )
    if base is None or rig.only("motor_circuit") is None or len(rig.of_kind("rotor")) != 1:
        raise UserError("rig", rig.config.name, f"this controller needs {allowed}")
    links, masses, here = [], [], base
    remaining = {e.name: e for e in rig.of_kind("link")}
    while step := [e for e in remaining.values() if here in e.neighbours["between"]]:
        link = step[0]
        here = next(end for end in link.neighbours["between"] if end != here)
        if len(step) > 1 or here not in rig.elements:
            break
        del remaining[link.name]
        if link.values["stiffness"] == 0.0:
            name = rig.config.elements[link.name]["stiffness"]
            raise UserError(f"rig.parameters.{name}.value", 0.0, f"above 0 N/m: {link.name} drives {here}")
        links.append(link)
        masses.append(rig.elements[here])
    if remaining or not links:
        raise UserError("rig", rig.config.name, f"this controller needs {allowed}")
    return masses, links


def structure_parameters(rig: Rig) -> StructureParameters:
    """The chain that the screw drives, as the design wants it; raises as :func:`driven_chain`."""
    masses, links = driven_chain(rig)
    screw = rig.only("screw")
    assert screw is not None
    springs = [(e.values["stiffness"], e.values.get("damping", 0.0)) for e in links]
    yielding = screw_spring(rig)
    if yielding is not None:  # then the mass on the screw has a motion of its own
        masses, springs = [rig.elements[screw.neighbours["carries"]], *masses], [yielding, *springs]
    ground = [
        (
            e.values.get("ground_stiffness", 0.0),
            e.values.get("ground_damping", 0.0) + rig.amount(e.name, slots.BodyDamping, "coefficient"),
        )
        for e in masses
    ]
    return StructureParameters(
        tuple(e.values["mass"] for e in masses),
        tuple(k for k, _ in springs),
        tuple(c for _, c in springs),
        screw.values["lead"],
        tuple(k for k, _ in ground) if any(k for k, _ in ground) else (),
        tuple(c for _, c in ground) if any(c for _, c in ground) else (),
    )


def motor_parameters(rig: Rig) -> MotorParameters:
    """The motor of a rig as the design wants it; the rig has one (:func:`driven_chain` checks it)."""
    circuit, rotor = rig.only("motor_circuit"), rig.motor_rotor()
    assert circuit is not None
    assert rotor is not None
    v, amplifier = circuit.values, rig.only("amplifier")
    gain = rig.effects.get(amplifier.name, {}).get("gain_error", {}).get("relative", 0.0) if amplifier else 0.0
    return MotorParameters(
        rotor.values["inertia"], v["inductance"], v["resistance"], v["torque_constant"], v["emf_constant"],
        rig.amount(rotor.name, slots.BodyDamping, "coefficient"), 1.0 + gain,
    )  # fmt: skip
