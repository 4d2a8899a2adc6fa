"""Rigs to begin with, by what the machine is: text that a user changes. ``dtb rig new`` writes one of them."""

import json
import shlex

HEAD = """\
# {about}
# Change the numbers to those of your machine; written as here (0.5 N/mm, 12 kg cm^2, 2 mm/rev) or plain in SI.
# tolerance: how well you know a value (relative, one standard deviation); it is 0.1 where nothing is said.
# Leave out friction and play that you are not sure of: dtb diagnose has to find them.
#   dtb rig check {file}            modes, units, and what can be named where
#   dtb run rig={file}{more}
#   dtb diagnose recording=bench.csv rig={file} out=found
name: {name}
description: "{about}"

"""

MOTOR = """\
  R: {{value: 1.2 ohm, tolerance: 0.05, description: winding}}
  L: {{value: 1.5 mH, tolerance: 0.1, description: winding}}
  k_m: {{value: 0.06 N m/A, tolerance: 0.03, description: torque and emf constant (0.06 V s/rad)}}
  J_m: {{value: 0.4 kg cm^2, tolerance: 0.05, description: rotor}}
"""
WINDING = """\
  amplifier: {kind: amplifier, drives: motor}
  motor: {kind: motor_circuit, resistance: R, inductance: L, torque_constant: k_m, emf_constant: k_m, drives: rotor}
  rotor: {kind: rotor, inertia: J_m}
"""

#: machine -> (what it is, parameters, elements, sensors)
MACHINES: dict[str, tuple[str, str, str, str]] = {
    "screw": (
        "DC motor, gear with play, lead screw, a table on a flexible support",
        MOTOR + "  lead: {{value: 2 mm/rev, tolerance: 0.005, description: of the screw}}\n",
        WINDING
        + """\
  gear: {kind: gear, driven_by: rotor, ratio: 1}
  screw: {kind: screw, driven_by: gear, lead: lead, carries: nut}
  nut: {kind: mass, mass: 1.5 kg}
  support: {kind: link, between: [nut, table], stiffness: 20 N/mm, damping: 0.02 N s/mm}
  table: {kind: mass, mass: 4 kg}
""",
        "  theta_m: {of: rotor, quantity: position}\n  x: {of: table, quantity: position, recorded_in: mm}\n",
    ),
    "belt": (
        "linear axis: DC motor, gearbox, a pulley with its belt, a carriage",
        MOTOR + "  radius: {{value: 15 mm, tolerance: 0.005, description: of the pulley}}\n",
        WINDING
        + """\
  gearbox: {kind: gearbox, between: [rotor, pulley], ratio: 3, stiffness: 200 N m/rad, damping: 0.05 N m s/rad}
  pulley: {kind: rotor, inertia: 1 kg cm^2}
  belt: {kind: belt, between: [pulley, carriage], radius: radius, stiffness: 60 N/mm, damping: 0.03 N s/mm}
  carriage: {kind: carriage, mass: 3 kg}
""",
        "  theta_m: {of: rotor, quantity: position}\n  x: {of: carriage, quantity: position, recorded_in: mm}\n",
    ),
    "stage": (
        "linear motor, a free carriage with a table on a flexible support",
        "  k_f: {{value: 12 N/V, tolerance: 0.02, description: force per volt of the command}}\n",
        """\
  amplifier: {kind: amplifier, drives: motor}
  motor: {kind: actuator, gain: k_f, drives: carriage}
  carriage: {kind: carriage, mass: 4 kg}
  support: {kind: link, between: [carriage, table], stiffness: 25 N/mm, damping: 15 N s/m}
  table: {kind: mass, mass: 2.5 kg}
""",
        """\
  x_c: {of: carriage, quantity: position, recorded_in: mm}
  x_t: {of: table, quantity: position, recorded_in: mm}
""",
    ),
    "drive": (
        "DC motor, shaft with coupling, load",
        MOTOR,
        WINDING
        + """\
  shaft: {kind: shaft, between: [rotor, load], stiffness: 4 N m/rad, damping: 1.5e-3 N m s/rad}
  load: {kind: rotor, inertia: 2 kg cm^2}
""",
        """\
  theta_m: {of: rotor, quantity: position}
  theta_l: {of: load, quantity: position}
  i_m: {of: motor, quantity: current}
""",
    ),
    "servo": (
        "a servo that swings an arm: the command is an angle",
        "  K_p: {{value: 8 N m/rad, tolerance: 0.2, description: effort per angle that is missing}}\n"
        "  K_d: {{value: 0.25 N m s/rad, tolerance: 0.2, description: effort against the speed}}\n",
        """\
  amplifier: {kind: amplifier, drives: servo}
  servo: {kind: servo, position_gain: K_p, speed_gain: K_d, drives: arm}   # limits: effects speed_limit, effort_limit
  arm: {kind: rotor, inertia: 0.02 kg m^2}
""",
        "  theta: {of: arm, quantity: position, recorded_in: deg}\n",
    ),
    "pendulum": (
        "a disk or an arm on a torque motor",
        "  k_t: {{value: 0.3 N m/V, tolerance: 0.02, description: torque per volt of the command}}\n",
        """\
  amplifier: {kind: amplifier, drives: motor}
  motor: {kind: actuator, gain: k_t, drives: disk}
  disk: {kind: rotor, inertia: 0.02 kg m^2}
""",
        "  theta: {of: disk, quantity: position}\n",
    ),
    "oscillator": (
        "a shaken mass on a spring",
        "  k_f: {{value: 2 N/V, tolerance: 0.02, description: force per volt of the command}}\n",
        """\
  amplifier: {kind: amplifier, drives: shaker}
  shaker: {kind: actuator, gain: k_f, drives: mass_1}
  mass_1: {kind: mass, mass: 0.8 kg}
  spring: {kind: link, between: [ground, mass_1], stiffness: 0.9 N/mm, damping: 1.2 N s/m}
""",
        "  x: {of: mass_1, quantity: position, recorded_in: mm}\n",
    ),
}


def text(machine: str, name: str, file: str) -> str:
    """The YAML text of a rig to begin with."""
    about, parameters, elements, sensors = MACHINES[machine]
    more = "" if "kind: gear," in elements else " controller=open_loop"
    return "\n".join([
        HEAD.format(about=about, file=shlex.quote(file), name=json.dumps(name), more=more).rstrip("\n"), "",
        "parameters:", parameters.format().rstrip("\n"), "",
        "elements:", elements.rstrip("\n"), "",
        "# what is known beforehand, e.g. rotor: {coulomb_friction: {torque: {value: 0.01, tolerance: 0.3}}}",
        "effects: {}", "", "sensors:", sensors,
    ])  # fmt: skip
