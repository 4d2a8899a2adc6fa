"""From a rig and its settings to what the design of a controller needs: the motor, and the chain behind the screw."""

import math

from dtbacklash.config.run import RunConfig
from dtbacklash.control.design import (
    ControllerDesign,
    MotorParameters,
    StructureParameters,
    design_controller,
    dominant_frequency,
)
from dtbacklash.errors import UserError
from dtbacklash.kept import kept
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
    return StructureParameters(
        tuple(e.values["mass"] for e in masses),
        tuple(e.values["stiffness"] for e in links),
        tuple(e.values.get("damping", 0.0) for e in links),
        screw.values["lead"],
    )


def motor_parameters(rig: Rig) -> MotorParameters:
    """The motor of a rig as the design wants it; the rig has one (:func:`driven_chain` checks it)."""
    circuit, rotor = rig.only("motor_circuit"), rig.motor_rotor()
    assert circuit is not None
    assert rotor is not None
    v = circuit.values
    return MotorParameters(
        rotor.values["inertia"], v["inductance"], v["resistance"], v["torque_constant"], v["emf_constant"]
    )


def design_for(config: RunConfig, rig: Rig) -> ControllerDesign | None:
    """The controller's design for a rig, from its nominal parameters alone (effects are what it does not know)."""
    c = config.controller
    if c.structure == "open_loop":
        return None
    if c.structure == "nimc" and rig.only("gear") is None:
        raise UserError("controller", c.name, f"needs a rig with a gear; {rig.config.name} has none")
    structure = structure_parameters(rig)
    frequency = kept(dominant_frequency, structure)
    if frequency * config.sample_time_s >= math.pi:
        allowed = f"sampling above twice the dominant mode's {frequency / (2 * math.pi):.3g} Hz"
        raise UserError("sample_time_s", config.sample_time_s, allowed)
    return kept(
        design_controller,
        motor_parameters(rig), structure, c.k_theta_v_per_rad, c.prefilter, c.tau_r_s, config.sample_time_s,
    )  # fmt: skip
