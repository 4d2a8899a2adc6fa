"""The concealing simulator: which rigs it can simulate, and a run of one."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.prove.simulator.given import Errors, Loop, Unlisted
from dtbacklash.prove.simulator.library import buffer, copied, lib, struct
from dtbacklash.prove.simulator.machine import Machine, body_names, machine

#: the kinds of element and the effects that this simulator has
KINDS = (
    "amplifier", "motor_circuit", "actuator", "positioner", "rotor", "gear", "screw", "shaft", "mass", "carriage",
    "brake", "link", "coupling", "gearbox", "belt", "rack", "servo", "linear_servo",
)  # fmt: skip
EFFECTS = frozenset((
    "saturation", "dead_zone", "delay", "gain_error", "offset", "resistance_heating", "torque_ripple",
    "coulomb_friction", "ground_friction", "stribeck_friction", "viscous_friction", "asymmetric_friction", "cogging",
    "constant_load", "constant_force", "gravity", "absorber", "backlash", "compliance", "pitch_error",
    "load_reaction", "cubic_stiffness", "quadratic_damping", "dry_friction", "hysteresis", "bumper", "stiffness_drift",
    "eccentricity", "lag", "speed_limit", "effort_limit", "load_friction",
))  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """The result of a run.

    u : (N+1,) V. truth, seen : sensor -> (N+1,) SI, without and with noise and counts. states : (N+1, 2 + 2 nb)
    current, screw's angle, positions and velocities of ``bodies``. samples : how many stayed finite.
    """

    u: Floats
    truth: dict[str, Floats]
    seen: dict[str, Floats]
    states: Floats
    bodies: list[str]
    samples: int
    sample_time_s: float

    @property
    def diverged(self) -> bool:
        """Whether the loop diverged."""
        return self.samples < len(self.u)


def check_concealable(rig: Rig) -> None:
    """Refuse a rig that this simulator cannot simulate, or that has no drive or no sensor.

    Raises UserError: with what is allowed.
    """
    for element in rig.elements.values():
        if element.kind not in KINDS:
            allowed = f"to conceal, one of {', '.join(KINDS)}"
            raise UserError(f"rig.elements.{element.name}.kind", element.kind, allowed)
    for place, there in rig.effects.items():
        for name in there:
            if name not in EFFECTS:
                allowed = f"to conceal, only effects that the second simulator has: {', '.join(sorted(EFFECTS))}"
                raise UserError(f"rig.effects.{place}.{name}", there[name], allowed)
    if not any(rig.only(kind) for kind in ("motor_circuit", "actuator", "servo", "linear_servo", "positioner")):
        allowed = "to conceal, a rig that a motor, an actuator, a servo or a positioner moves"
        raise UserError("rig", rig.config.name, allowed)
    if not rig.sensors:
        raise UserError("rig.sensors", "(none)", "to conceal, at least one sensor")


def simulate_other(
    rig: Rig, loop: Loop, sample_time_s: float, errors: Errors | None = None, *unknown: Unlisted
) -> Trial:
    """Simulate a rig from rest by the concealing simulator; deterministic to the last bit.

    Raises UserError: as :func:`check_concealable`.
    """
    check_concealable(rig)
    errors = errors or Errors()
    m = machine(rig, sample_time_s, errors, *unknown)
    n, sensors, size = len(loop.reference), len(rig.sensors), 2 + 2 * len(m.inertia)
    u, truth, seen, states = np.zeros(n), np.zeros((n, sensors)), np.zeros((n, sensors)), np.zeros((n, size))
    good = lib.dtb_run_machine(
        _machine(m), _memory(m), _signals(m, loop, errors, rig), _history(m),
        buffer(u), buffer(truth), buffer(seen), buffer(states),
    )  # fmt: skip
    by_sensor = dict(zip(rig.sensors, truth.T, strict=True)), dict(zip(rig.sensors, seen.T, strict=True))
    return Trial(u, *by_sensor, states, body_names(rig), int(good), sample_time_s)


def _machine(m: Machine) -> Any:
    counts = {"bodies": len(m.inertia), "links": len(m.link), "frictions": len(m.friction)}
    return struct("Machine", **counts, sensors=len(m.sensor), unknowns=len(m.unknown), **m._asdict())


def _memory(m: Machine) -> Any:
    """The state of a machine at rest, and room to work in."""
    size, bodies, bristles = 2 + 2 * len(m.inertia), len(m.inertia), (len(m.friction), 2)
    return struct(
        "Memory", x=np.zeros(size), start=np.zeros(size), trial=np.zeros(size), total=np.zeros(size),
        rates=np.zeros(size), force=np.zeros(bodies), lost=np.zeros(bodies), bristle=np.zeros(bristles),
        bristle_start=np.zeros(bristles), yielding_start=np.zeros((len(m.link), 2)), scalar=np.zeros(lib.N_SCALAR),
        control=np.zeros(lib.N_HELD), course=np.zeros((3, len(m.unknown))),
    )  # fmt: skip


def _control(loop: Loop, sample_time_s: float) -> Floats:
    """The numbers of a controller for one sampling time."""
    control = np.zeros(lib.N_CONTROL)
    control[lib.C_MODE], control[lib.C_GAIN], control[lib.C_LIMIT] = loop.mode, loop.gain, loop.limit
    control[lib.C_FILTER] = -math.expm1(-loop.filter_rad_s * sample_time_s)
    control[lib.C_INTEGRAL] = loop.integral * sample_time_s
    control[lib.C_RATE], control[lib.C_CORNER] = loop.rate, -math.expm1(-loop.corner_rad_s * sample_time_s)
    return control


def _signals(m: Machine, loop: Loop, errors: Errors, rig: Rig) -> Any:
    """The inputs of a run, in arrays of the shapes that the inner loop reads."""
    n, sensors, unknowns = len(loop.reference), len(m.sensor), len(m.unknown)
    looked_at = (0, 0) if not loop.closed else (list(rig.sensors).index(loop.pid),) * 2 if loop.pid else roles(rig)
    noise = np.zeros((n, sensors)) if errors.draws is None else errors.draws
    given = {"reference": (loop.reference, (n,)), "dither": (loop.dither, (n,)), "noise": (noise, (n, sensors)),
             "courses": (np.broadcast_to(loop.disturbance.reshape(n, -1), (n, unknowns)), (n, unknowns))}  # fmt: skip
    return struct(
        "Signals", samples=n, control=_control(loop, m.sample_time), roles=np.array(looked_at, dtype=np.int64),
        **{name: copied(array, *shape) for name, (array, shape) in given.items()},
    )  # fmt: skip


def _history(m: Machine) -> Any:
    """The ring that the delays of the sensors need."""
    late = float(m.sensor[:, lib.Y_DELAY].max(initial=0.0))
    depth = 2 + math.ceil(late / m.sample_time * m.substeps + 1e-9)
    return struct("History", depth=depth, newest=0, seen=np.zeros((depth, len(m.sensor))))


def roles(rig: Rig) -> tuple[int, int]:
    """The sensors of the cascade: the motor's angle, and the position of the body farthest from the screw.

    Raises UserError: one of them is missing.
    """
    order = list(rig.elements)
    positions = [(j, s.of, rig.elements[s.of].kind) for j, s in enumerate(rig.sensors.values())
                 if s.quantity == "position"]  # fmt: skip
    angles = [j for j, _, kind in positions if kind == "rotor"]
    outputs = [(order.index(of), -j) for j, of, kind in positions if kind == "mass"]
    if not angles or not outputs:
        allowed = "a closed loop needs a position sensor on the motor and one on a mass"
        raise UserError("rig.sensors", ", ".join(rig.sensors), allowed)
    return angles[-1], -max(outputs)[1]
