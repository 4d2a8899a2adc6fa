"""The kinds of element of a rig: what each needs, which neighbours it has, what a sensor can show of it.

A trait says which role a kind has in the equations of motion; simulation, diagnosis and drawings ask for traits, not
for names of kinds. A field names a parameter in the rig's file (value, unit, tolerance).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from dtbacklash.physics.effects import slots

GROUND = "ground"
ROTARY, LINEAR = "rotary", "linear"

#: units of position, velocity and effort along an axis
AXES: dict[str, tuple[str, str, str]] = {ROTARY: ("rad", "rad/s", "N m"), LINEAR: ("m", "m/s", "N")}
#: what is of a simulator's model, and only shown
MODEL_OUTPUT = "model_output"
#: the parts of a machine, in the order of the power flow
DRIVE, TRANSMISSION, STRUCTURE = PARTS = ("drive", "transmission", "structure")
#: one constant serves as torque and as emf constant, since 1 N m/A = 1 V s/rad
MOTOR_CONSTANT = ("N m/A", "V s/rad")


@dataclass(frozen=True)
class Kind:
    """One kind of element.

    Attributes
    ----------
    required, optional : fields with their SI units; a field may have several. neighbours : role -> kinds that may stand
        there; of role ``between`` two, or one and the ground.
    description : for docs.
    trait : what it is to the equations of motion, one of :mod:`.effects.slots` (``body``, ``spring`` ...), or empty.
    axis : of a body or spring, along which it moves. inertia : the field that is a body's inertia.
    motor_side : whether it lies before the gear, so that the motor's block holds it.
    part : the part of a machine that it belongs to, one of PARTS. one_of : the groups of which a rig has one element at
        most.
    quantities : what a sensor can show of it -> unit.
    first : of a spring that turns one motion into another, the kinds at its first end. lever : its values -> how far
        that end goes per unit of the body there.
    """

    name: str
    required: dict[str, str | tuple[str, ...]]
    optional: dict[str, str]
    neighbours: dict[str, tuple[str, ...]]
    description: str
    trait: str = ""
    axis: str = ""
    inertia: str = ""
    motor_side: bool = False
    part: str = STRUCTURE
    one_of: tuple[str, ...] = ()
    quantities: dict[str, str] = field(default_factory=dict)
    first: tuple[str, ...] = ()
    lever: Callable[[dict[str, float]], float] = lambda values: 1.0

    def at_end(self, place: int) -> tuple[str, ...]:
        """The kinds that may stand at the first end (0) or the second one (1) of a spring."""
        kinds = self.neighbours["between"]
        if not self.first or place == 0:
            return self.first or kinds
        return tuple(k for k in kinds if k not in self.first) or kinds

    def takes(self, slot: slots.Slot) -> bool:
        """Whether an effect in this slot can act at such an element."""
        # friction across a spring needs ends that move along one line; only what joins two kinds of motion passes on
        if self.trait == slots.SPRING and isinstance(slot, slots.Contact):
            return isinstance(slot, slots.Passing) == bool(self.first)
        mine = {self.trait}
        if self.trait == slots.BODY and self.axis == LINEAR:
            mine.add(slots.SLIDING_BODY)
        return bool(mine & set(slot.on))


#: what a sensor can show of a body
_MOTION = {
    axis: {"position": units[0], "velocity": units[1], "acceleration": f"{units[1]}^2"} for axis, units in AXES.items()
}
#: and of a spring: what it pulls its ends together with
_EFFORT = {ROTARY: {"torque": "N m"}, LINEAR: {"force": "N"}}
_SLIDING = ("mass", "carriage", "brake")

KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            "amplifier", {}, {}, {"drives": ("motor_circuit", "actuator", "servo", "linear_servo")},
            "turns the command into a voltage or, with an actuator, a force or a torque; passes on that of a servo",
            trait=slots.AMPLIFIER, motor_side=True, part=DRIVE, one_of=("amplifier",),
        ),
        Kind(
            "motor_circuit",
            {"resistance": "ohm", "inductance": "H", "torque_constant": MOTOR_CONSTANT, "emf_constant": MOTOR_CONSTANT},
            {}, {"drives": ("rotor", "carriage", "mass")}, "L i' + R i = v - k_B omega, torque k_T i",
            trait=slots.WINDING, motor_side=True, part=DRIVE, one_of=("drive",), quantities={"current": "A"},
        ),
        Kind(
            "actuator", {"gain": ("N/V", "N m/V")}, {}, {"drives": ("rotor", *_SLIDING)},
            "an ideal force or, on a rotor, torque: gain times the command",
            trait=slots.ACTUATOR, motor_side=True, part=DRIVE, one_of=("drive",),
        ),
        *(
            Kind(
                name, {"position_gain": f"{AXES[axis][2]}/{AXES[axis][0]}"},
                {"speed_gain": "N m s/rad" if axis == ROTARY else "N s/m"}, {"drives": driven},
                f"a drive with a position loop: the command u is a position [{AXES[axis][0]}], the effort "
                "position_gain (u - q) - speed_gain q'",
                trait=slots.SERVO, axis=axis, motor_side=True, part=DRIVE, one_of=("drive",),
            )
            for name, axis, driven in (("servo", ROTARY, ("rotor",)), ("linear_servo", LINEAR, _SLIDING))
        ),
        Kind(
            "rotor", {"inertia": "kg m^2"}, {}, {}, "an inertia in its bearing; the driven one is the motor's",
            trait=slots.BODY, axis=ROTARY, inertia="inertia", motor_side=True, part=DRIVE, quantities=_MOTION[ROTARY],
        ),
        Kind(
            "shaft", {"stiffness": "N m/rad"}, {"damping": "N m s/rad"}, {"between": ("rotor",)},
            "spring and damper in parallel between two rotors, or a rotor and the ground",
            trait=slots.SPRING, axis=ROTARY, motor_side=True, part=TRANSMISSION, quantities=_EFFORT[ROTARY],
        ),
        Kind(
            "gear", {}, {"ratio": "1"}, {"driven_by": ("rotor",)},
            "where the backlash is, seen at the rotor; its output holds its place (self-locking) and turns 1/ratio as "
            "fast, 1:1 if no ratio is given",
            trait=slots.GEAR, part=TRANSMISSION, one_of=("gear",),
        ),
        Kind(
            "screw", {"lead": "m/rad"}, {}, {"driven_by": ("gear",), "carries": ("mass", "carriage")},
            "turns the angle into the base's position", trait=slots.SCREW, part=TRANSMISSION, one_of=("base",),
        ),
        Kind(
            "gearbox", {"ratio": "1", "stiffness": "N m/rad"}, {"damping": "N m s/rad"}, {"between": ("rotor",)},
            "the second rotor turns 1/ratio as fast as the first; spring and damper of the teeth, at the second one",
            trait=slots.SPRING, axis=ROTARY, motor_side=True, part=TRANSMISSION, quantities=_EFFORT[ROTARY],
            first=("rotor",), lever=lambda values: 1.0 / values["ratio"],
        ),
        *(
            Kind(
                name, {"radius": "m", "stiffness": "N/m"}, {"damping": "N s/m"}, {"between": ("rotor", *_SLIDING)},
                description, trait=slots.SPRING, axis=LINEAR, part=TRANSMISSION, one_of=("base",),
                quantities=_EFFORT[LINEAR], first=("rotor",), lever=lambda values: values["radius"],
            )
            for name, description in (
                ("belt", "a pulley of this radius on the first element, a rotor, pulls the second by an elastic belt"),
                ("rack", "a pinion of this radius on the first element, a rotor, pushes the second by elastic teeth"),
            )
        ),
        Kind(
            "mass", {"mass": "kg"}, {"ground_stiffness": "N/m", "ground_damping": "N s/m"}, {}, "a lumped mass",
            trait=slots.BODY, axis=LINEAR, inertia="mass", quantities=_MOTION[LINEAR],
        ),
        Kind(
            "carriage", {"mass": "kg"}, {}, {}, "a mass that slides on a bearing",
            trait=slots.BODY, axis=LINEAR, inertia="mass", quantities=_MOTION[LINEAR],
        ),
        Kind(
            "link", {"stiffness": "N/m"}, {"damping": "N s/m"}, {"between": _SLIDING}, "spring and damper in parallel",
            trait=slots.SPRING, axis=LINEAR, quantities=_EFFORT[LINEAR],
        ),
        Kind(
            "positioner", {"travel": "m/V"}, {}, {},
            "imposes a position, travel times the command, smoothly between samples (a test machine)",
            part=DRIVE, one_of=("drive", "base"),
        ),
        Kind(
            "coupling", {"stiffness": "N/m"}, {"damping": "N s/m"}, {"between": (*_SLIDING, "positioner")},
            "spring and damper in parallel, in whose force there may be play",
            trait=slots.SPRING, axis=LINEAR, quantities=_EFFORT[LINEAR],
        ),
        Kind(
            "brake", {"mass": "kg", "friction": "N"}, {}, {}, "a mass held by dry friction of a known level",
            trait=slots.BODY, axis=LINEAR, inertia="mass", quantities=_MOTION[LINEAR],
        ),
        *(
            Kind(
                name, {}, {}, {}, f"a joint of a simulator's model that {moves} ([how](simulators.md))",
                trait=slots.BODY, axis=axis, quantities=_MOTION[axis],
            )
            for name, axis, moves in (("turning_joint", ROTARY, "turns"), ("sliding_joint", LINEAR, "slides"))
        ),
        Kind(
            "joint_drive", {}, {}, {"drives": ("turning_joint", "sliding_joint")},
            "an actuator of a simulator's model, with a command of its own ([how](simulators.md))",
            trait=slots.JOINT_DRIVE, part=DRIVE, quantities={**_EFFORT[ROTARY], **_EFFORT[LINEAR]},
        ),
        Kind(
            MODEL_OUTPUT, {}, {}, {},
            "a variable of an FMU that a sensor shows, as the FMU gives it ([how](simulators.md))",
            quantities={"value": "1"},
        ),
    )
}  # fmt: skip

SENSOR = Kind("sensor", {}, {}, {}, "shows what it measures at every sample", slots.SENSOR)

#: optional neighbours
OPTIONAL_NEIGHBOURS = ("carries",)
