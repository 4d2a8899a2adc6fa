"""The machines of the benchmark in words: equations of motion, tables of parameters and places; and as MJCF."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree as ET

from dtbacklash.physics.element_kinds import ROTARY
from dtbacklash.physics.rig import Rig

#: the nominal equations; names of parameters and sensors as in the machine's file
EQUATIONS = {
    "lead_screw": """
Motor current i: `L di/dt = u - R i - k_B dtheta_m/dt`, and the motor `J d2theta_m/dt2 = k_T i`.
The gear has no gap, and the screw turns as the motor: the first mass is at `q1 = p theta_m`, and does not push back.
A spring `k` with a damper `c` ties the first mass to the ground, which does not matter as the screw moves it.
Second mass: `m d2q2/dt2 = k (q1 - q2) + c (dq1/dt - dq2/dt) + k (q3 - q2) + c (dq3/dt - dq2/dt)`.
Third mass: `m d2q3/dt2 = k (q2 - q3) + c (dq2/dt - dq3/dt)`.
Sensors: `theta_m`, `q3`, `q2` are positions, `i_m` is the current i.""",
    "two_mass_stage": """
The motor pushes the carriage by `F = K_f u`. The carriage is free; a spring `k` and a damper `c` carry the table.
Carriage: `m_c d2x_c/dt2 = K_f u + k (x_t - x_c) + c (dx_t/dt - dx_c/dt)`.
Table: `m_t d2x_t/dt2 = k (x_c - x_t) + c (dx_c/dt - dx_t/dt)`.
Sensors: `x_c` and `x_t` are positions.""",
    "rotary_drive": """
Motor current i: `L di/dt = u - R i - k_m dtheta_m/dt`.
Motor: `J_m d2theta_m/dt2 = k_m i + k (theta_l - theta_m) + c (dtheta_l/dt - dtheta_m/dt)`.
Load: `J_l d2theta_l/dt2 = k (theta_m - theta_l) + c (dtheta_m/dt - dtheta_l/dt)`.
Sensors: `theta_m` and `theta_l` are angles, `i_m` is the current i.""",
    "pendulum": """
Disk: `J d2theta/dt2 = K_t u`. Nothing else acts on it.
Sensors: `theta` is the angle, `omega` the angular velocity.""",
    "oscillator": """
Mass: `m d2x/dt2 = gain u - k x - c dx/dt`.
Sensors: `x` is the position, `v` the velocity.""",
}
#: step of an MJCF, s
STEP_S = 2e-4


def description(name: str, rig: Rig) -> str:
    """A machine in words: its equations of motion, parameters with their tolerances, sensors, places."""
    lines = [
        f"# {name}",
        "",
        f"{rig.config.description}. u is the command, held over a sample. It begins at rest at 0.",
    ]
    lines += ["", *(f"- {line}" for line in EQUATIONS[name].strip().splitlines())]
    lines += ["", "| parameter | value | unit | tolerance (one standard deviation, relative) | what it is |"]
    lines += ["| --- | --- | --- | --- | --- |"]
    lines += [
        f"| {n} | {p.value:g} | {p.unit} | {p.tolerance:g} | {p.description} |"
        for n, p in rig.config.parameters.items()
    ]
    lines += ["", "| place | what it is |", "| --- | --- |"]
    lines += [f"| {place} | {kind} |" for place, kind in places(rig)]
    return "\n".join(lines) + "\n"


def places(rig: Rig) -> list[tuple[str, str]]:
    """(place, what it is): elements, sensors, and the parameters as places of `wrong_parameter`."""
    found = [(place, rig.kind_at(place).replace("_", " ")) for place in rig.places]
    return [*found, *((name, "parameter") for name in rig.config.parameters)]


def mjcf(rig: Rig) -> str | None:
    """The nominal machine as a MuJoCo model; None if it has a winding, a gear or a screw."""
    kinds = {element.kind for element in rig.elements.values()}
    if not kinds <= {"amplifier", "actuator", "carriage", "mass", "rotor", "link", "shaft"}:
        return None
    root = ET.Element("mujoco", model=rig.config.name)
    ET.SubElement(root, "option", timestep=f"{STEP_S:g}", gravity="0 0 0", integrator="implicitfast")
    world, tendons = ET.SubElement(root, "worldbody"), ET.SubElement(root, "tendon")
    actuators, sensors = ET.SubElement(root, "actuator"), ET.SubElement(root, "sensor")
    joints: dict[str, Any] = {}
    for element in rig.elements.values():
        turns, inertia = element.trait.axis == ROTARY, element.values.get("inertia", element.values.get("mass"))
        if inertia is None or element.kind not in ("carriage", "mass", "rotor"):
            continue
        body = ET.SubElement(world, "body", name=element.name)
        kind, axis = ("hinge", "0 0 1") if turns else ("slide", "1 0 0")
        joints[element.name] = ET.SubElement(body, "joint", name=element.name, type=kind, axis=axis)
        if ground := element.values.get("ground_stiffness"):
            damping = element.values.get("ground_damping", 0.0)
            joints[element.name].attrib.update(stiffness=repr(ground), damping=repr(damping))
        mass, around = (1.0, inertia) if turns else (inertia, 1.0)
        ET.SubElement(body, "inertial", pos="0 0 0", mass=repr(mass), diaginertia=" ".join(3 * [repr(around)]))
    for link in rig.links():
        a, b = link.neighbours["between"]
        tendon = joints[b] if a == "ground" else ET.SubElement(tendons, "fixed", name=link.name)
        tendon.set("stiffness", repr(link.values["stiffness"]))
        tendon.set("damping", repr(link.values.get("damping", 0.0)))
        if a == "ground":
            continue
        ET.SubElement(tendon, "joint", joint=a, coef=repr(-link.lever))
        ET.SubElement(tendon, "joint", joint=b, coef="1")
    for element in rig.elements.values():
        if element.kind == "actuator":
            gain = repr(element.values["gain"])
            ET.SubElement(actuators, "motor", name=element.name, joint=element.neighbours["drives"], gear=gain)
    for name, sensor in rig.sensors.items():
        shows = {"position": "jointpos", "velocity": "jointvel"}[sensor.quantity]
        ET.SubElement(sensors, shows, name=name, joint=sensor.of)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
