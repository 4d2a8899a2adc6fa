"""The kinds of element that a rig can be made of, and what each of them needs.

``fields`` name parameters of the rig (value, unit, tolerance stand there); ``links`` name other elements.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """One kind of element: its required and optional parameters with their SI units, and its neighbours."""

    name: str
    required: dict[str, str]
    optional: dict[str, str]
    neighbours: tuple[str, ...]
    description: str


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("amplifier", {}, {}, ("drives",), "turns the command into a voltage or, with an actuator, a force"),
        Kind(
            "motor_circuit",
            {"resistance": "ohm", "inductance": "H", "torque_constant": "N m/A", "emf_constant": "V s/rad"},
            {},
            ("drives",),
            "L i' + R i = v - k_B omega, torque k_T i",
        ),
        Kind("actuator", {"gain": "N/V"}, {}, ("drives",), "an ideal force, gain times the command"),
        Kind("rotor", {"inertia": "kg m^2"}, {}, (), "the motor's inertia in its bearing"),
        Kind(
            "gear",
            {},
            {},
            ("driven_by",),
            "1:1, where the backlash is; its output holds its place (self-locking)",
        ),
        Kind(
            "screw",
            {"lead": "m/rad"},
            {},
            ("driven_by", "carries"),
            "turns the angle into the base's position",
        ),
        Kind(
            "mass",
            {"mass": "kg"},
            {"ground_stiffness": "N/m", "ground_damping": "N s/m"},
            (),
            "a lumped mass",
        ),
        Kind("carriage", {"mass": "kg"}, {}, (), "a mass that slides on a bearing"),
        Kind("link", {"stiffness": "N/m"}, {"damping": "N s/m"}, ("between",), "spring and damper in parallel"),
        Kind(
            "positioner",
            {"travel": "m/V"},
            {},
            (),
            "imposes a position, travel times the command, straight between samples (a test machine)",
        ),
        Kind(
            "coupling",
            {"stiffness": "N/m"},
            {"damping": "N s/m"},
            ("between",),
            "spring and damper in parallel, in whose force there may be play",
        ),
        Kind("brake", {"mass": "kg", "friction": "N"}, {}, (), "a mass held by dry friction of a known level"),
    )
}

BODY_KINDS = ("rotor", "mass", "carriage", "brake")
SLIDING_KINDS = BODY_KINDS[1:]
LINK_KINDS = ("link", "coupling")
GROUND = "ground"

#: quantity -> unit, for a sensor on a body that turns, on those that slide, a circuit and a coupling
QUANTITIES: dict[str, dict[str, str]] = {
    "rotor": {"position": "rad", "velocity": "rad/s"},
    "mass": {"position": "m", "velocity": "m/s"},
    "carriage": {"position": "m", "velocity": "m/s"},
    "brake": {"position": "m", "velocity": "m/s"},
    "motor_circuit": {"current": "A"},
    "coupling": {"force": "N"},
}
