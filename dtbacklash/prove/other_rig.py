"""The concealing simulator: from a rig's description to the arrays of :mod:`.other_step`, and a run of it."""

import math
from dataclasses import dataclass, field

import numpy as np

from dtbacklash.errors import UserError
from dtbacklash.physics.plant import Floats, Ints
from dtbacklash.physics.rig import SENSOR_PREFIX, Element, Rig
from dtbacklash.prove import other_step as other
from dtbacklash.prove.other_arrays import Machine, Memory, Signals

#: a screw that gives way is damped like this against the mass that it carries
SCREW_DAMPING_RATIO = 0.02
#: steps a sample, at least; more where the rig is faster than STEP_RATE per step
STEPS_MIN, STEP_RATE = 50, 0.25
#: (frequency, damping ratio) of a bristle at rest with the body that it holds, frequency per step: rotor's, mass's
BRISTLE_ROTOR, BRISTLE_MASS = (0.3, 0.7), (0.1, 0.2)

#: the kinds of element that this simulator knows
KINDS = ("amplifier", "motor_circuit", "rotor", "gear", "screw", "mass", "link")

#: name of the physics that the catalogue lacks -> its kind in the compiled loop
UNKNOWNS = {
    "position_damping": other.POSITION_DAMPING, "disturbance": other.DISTURBANCE,
    "directional_torque": other.DIRECTIONAL_TORQUE, "root_spring": other.ROOT_SPRING,
    "speed_stiffening": other.SPEED_STIFFENING, "angular_play": other.ANGULAR_PLAY,
    "position_mass": other.POSITION_MASS,
}  # fmt: skip


@dataclass(frozen=True)
class Unknown:
    """Physics that no entry of the catalogue describes; ``scale`` is the size of the state at which it is judged."""

    location: str
    name: str
    size: float
    scale: float


@dataclass(frozen=True)
class Loop:
    """What drives the rig: closed loop on a reference (m), or open loop (V); gains of the controller, see other_step.

    reference, dither, disturbance : (N+1,). gain : V/rad. filter_rad_s : of the prefilter. integral : 1/s.
    """

    closed: bool
    reference: Floats
    dither: Floats
    disturbance: Floats
    gain: float = 0.0
    filter_rad_s: float = 1.0
    integral: float = 0.0
    limit: float = 48.0


@dataclass(frozen=True)
class Errors:
    """The sensors' errors: name -> standard deviation and size of a count, SI; ``noise`` (N+1, ns) standard normal."""

    noise: dict[str, float] = field(default_factory=dict)
    resolution: dict[str, float] = field(default_factory=dict)
    draws: Floats | None = None


@dataclass(frozen=True)
class Run:
    """What a run gives: u (N+1,) V; by sensor, SI: ``truth`` without, ``seen`` with noise and counts; the states.

    states (N+1, 2 + 2 nb) : current, screw's angle, positions and velocities of ``bodies``. samples : how many stayed
    finite (N+1, or the loop diverged).
    """

    u: Floats
    truth: dict[str, Floats]
    seen: dict[str, Floats]
    states: Floats
    bodies: list[str]
    samples: int

    @property
    def diverged(self) -> bool:
        """Whether the loop left every plausible range."""
        return self.samples < len(self.u)


@dataclass
class _Net:
    """The bodies and what connects them, while it grows."""

    names: list[str]
    inertia: list[float]
    base: str | None
    link: list[list[float]] = field(default_factory=list)
    link_ends: list[tuple[int, int]] = field(default_factory=list)
    friction: list[list[float]] = field(default_factory=list)
    friction_ends: list[tuple[int, int]] = field(default_factory=list)

    def end(self, name: str) -> int:
        if name == "ground":
            return other.GROUND
        return other.BASE if name == self.base else self.names.index(name)

    def join(self, a: int, b: int, k: float, c: float) -> list[float]:
        """A spring and a damper from a to b; returns its row, for what else is in it."""
        row = [0.0] * other.N_LINK
        row[other.L_K], row[other.L_C] = k, c
        self.link.append(row)
        self.link_ends.append((a, b))
        return row

    def reduced(self, a: int, b: int) -> float:
        """The mass that two ends have against each other; ground and base do not move."""
        free = [1.0 / self.inertia[end] for end in (a, b) if end >= 0]
        return 1.0 / sum(free)


def check_concealable(rig: Rig) -> None:
    """Refuse a rig that is no motor with a gear and a screw that carries a mass.

    Raises
    ------
    UserError : with what is allowed.
    """
    screw = rig.only("screw")
    needed = ("motor_circuit", "rotor", "gear", "screw")
    if any(rig.only(kind) is None for kind in needed) or screw is None or not screw.neighbours.get("carries"):
        allowed = f"a rig with {', '.join(needed)} whose screw carries a mass, e.g. lead_screw"
        raise UserError("rig", rig.config.name, allowed)
    for element in rig.elements.values():
        if element.kind not in KINDS:
            allowed = f"to conceal, one of {', '.join(KINDS)}"
            raise UserError(f"rig.elements.{element.name}.kind", element.kind, allowed)


def machine(rig: Rig, sample_time_s: float, errors: Errors, unknown: Unknown | None = None) -> Machine:
    """The arrays of a rig for one sampling time."""
    net = _bodies(rig)
    links = _links(rig, net)
    drive = _drive(rig, net)
    substeps = _substeps(net, drive, sample_time_s)
    _frictions(rig, net, substeps / sample_time_s)
    body = np.array([_body_row(rig, name) for name in net.names])
    return Machine(
        sample_time=sample_time_s, substeps=substeps, inertia=np.array(net.inertia), body=body,
        link=np.array(net.link).reshape(-1, other.N_LINK), link_ends=_ends(net.link_ends),
        friction=np.array(net.friction).reshape(-1, other.N_FRICTION), friction_ends=_ends(net.friction_ends),
        drive=drive, sensor=_sensors(rig, net, errors), unknown=_unknown(unknown, net, links),
    )  # fmt: skip


def _ends(pairs: list[tuple[int, int]]) -> Ints:
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _screw(rig: Rig) -> Element:
    screw = rig.only("screw")
    assert screw is not None  # check_concealable
    return screw


def _bodies(rig: Rig) -> _Net:
    """Rotor first, then the masses that move by themselves, then hidden ones."""
    rotor, screw = rig.only("rotor"), _screw(rig)
    assert rotor is not None
    gives_way = rig.effect(screw.name, "compliance")
    carried = screw.neighbours["carries"]
    net = _Net([rotor.name], [rotor.values["inertia"]], None if gives_way else carried)
    for element in rig.of_kind("mass"):
        if element.name != net.base:
            net.names.append(element.name)
            net.inertia.append(element.values["mass"])
    if gives_way:
        k, m = 1.0 / gives_way["compliance"], rig.elements[carried].values["mass"]
        net.join(other.BASE, net.end(carried), k, 2.0 * SCREW_DAMPING_RATIO * math.sqrt(k * m))
    for element in rig.of_kind("mass"):
        k, c = element.values.get("ground_stiffness", 0.0), element.values.get("ground_damping", 0.0)
        if k or c:
            net.join(other.GROUND, net.end(element.name), k, c)
        if absorber := rig.effect(element.name, "absorber"):
            net.names.append(f"absorber of {element.name}")
            net.inertia.append(absorber["mass"])
            omega = 2.0 * math.pi * absorber["frequency"]
            c = 2.0 * absorber["damping_ratio"] * omega * absorber["mass"]
            net.join(net.end(element.name), len(net.names) - 1, omega**2 * absorber["mass"], c)
    return net


def _links(rig: Rig, net: _Net) -> dict[str, int]:
    """Add the links with their effects; returns where each is."""
    where = {}
    columns = {
        "cubic_stiffness": ((other.L_CUBIC, "k3"),),
        "quadratic_damping": ((other.L_QUADRATIC, "c2"),),
        "hysteresis": ((other.L_FORCE, "force"), (other.L_YIELD, "displacement")),
        "bumper": ((other.L_STOP, "stiffness"), (other.L_CLEARANCE, "clearance")),
        "stiffness_drift": ((other.L_DRIFT, "rate"),),
    }
    for element in rig.of_kind("link"):
        a, b = (net.end(name) for name in element.neighbours["between"])
        where[element.name] = len(net.link)
        row = net.join(a, b, element.values["stiffness"], element.values.get("damping", 0.0))
        for name, entries in columns.items():
            if effect := rig.effect(element.name, name):
                for column, parameter in entries:
                    row[column] = effect[parameter]
    return where


def _substeps(net: _Net, drive: Floats, sample_time_s: float) -> int:
    """As many steps a sample as the fastest pole needs: the motor's, or (a bound of) the structure's."""
    circuit = np.array([
        [-drive[other.D_R] / drive[other.D_L], -drive[other.D_KB] / drive[other.D_L]],
        [drive[other.D_KT] / net.inertia[0], 0.0],
    ])  # fmt: skip
    fastest = float(np.abs(np.linalg.eigvals(circuit)).max())
    for (a, b), row in zip(net.link_ends, net.link, strict=True):
        if max(a, b) >= 0:
            m = net.reduced(a, b)
            fastest = max(fastest, 2.0 * math.sqrt(row[other.L_K] / m), 2.0 * row[other.L_C] / m)
    return max(STEPS_MIN, math.ceil(fastest * sample_time_s / STEP_RATE))


def _frictions(rig: Rig, net: _Net, step_rate: float) -> None:
    """Bristles: of bearings against the ground, and across links."""
    for element in rig.elements.values():
        coulomb = rig.effect(element.name, "coulomb_friction") or rig.effect(element.name, "ground_friction") or {}
        stribeck = rig.effect(element.name, "stribeck_friction") or {}
        if element.name in net.names and (coulomb or stribeck):
            size = "torque" if element.kind == "rotor" else "force"
            levels = coulomb.get(size, 0.0), stribeck.get(size, 0.0)
            _bristle(net, other.GROUND, net.end(element.name), levels, stribeck.get("speed", 1.0), step_rate)
        if dry := rig.effect(element.name, "dry_friction"):
            a, b = (net.end(name) for name in element.neighbours["between"])
            _bristle(net, a, b, (dry["force"], 0.0), 1.0, step_rate)


def _bristle(net: _Net, a: int, b: int, levels: tuple[float, float], speed: float, step_rate: float) -> None:
    m = net.reduced(a, b)
    per_step, ratio = BRISTLE_ROTOR if b == 0 else BRISTLE_MASS
    omega = per_step * step_rate
    net.friction.append([*levels, speed, m * omega**2, 2.0 * ratio * omega * m])
    net.friction_ends.append((a, b))


def _body_row(rig: Rig, name: str) -> list[float]:
    row, there = [0.0] * other.N_BODY, rig.effects.get(name, {})
    row[other.B_VISCOUS] = there.get("viscous_friction", {}).get("coefficient", 0.0)
    row[other.B_DIFFERENCE] = there.get("asymmetric_friction", {}).get("viscous_difference", 0.0)
    if cogging := there.get("cogging"):
        row[other.B_COGGING : other.B_LOAD] = [cogging["torque"], cogging["periods"], cogging["phase"]]
    row[other.B_LOAD] = there.get("constant_load", {}).get("torque", 0.0)
    row[other.B_LOAD] += there.get("constant_force", {}).get("force", 0.0)
    return row


def _drive(rig: Rig, net: _Net) -> Floats:
    """Amplifier, circuit, gear and screw."""
    circuit, gear, amplifier, screw = rig.only("motor_circuit"), rig.only("gear"), rig.only("amplifier"), _screw(rig)
    assert circuit is not None
    assert gear is not None
    v, row = circuit.values, np.zeros(other.N_DRIVE)
    row[[other.D_R, other.D_L]] = v["resistance"], v["inductance"]
    row[[other.D_KT, other.D_KB]] = v["torque_constant"], v["emf_constant"]
    if ripple := rig.effect(circuit.name, "torque_ripple"):
        row[[other.D_RIPPLE, other.D_PERIODS, other.D_PHASE]] = [ripple[n] for n in ("relative", "periods", "phase")]
    heat = rig.effect(circuit.name, "resistance_heating") or {}
    row[[other.D_HEAT, other.D_TAU]] = heat.get("gain", 0.0), heat.get("time_constant", 1.0)
    row[other.D_LEAD] = screw.values["lead"]
    row[other.D_SHARE] = (rig.effect(screw.name, "load_reaction") or {}).get("share", 0.0)
    row[other.D_BASE_MASS] = rig.elements[net.base].values["mass"] if net.base else 0.0
    if pitch := rig.effect(screw.name, "pitch_error"):
        row[[other.D_PITCH, other.D_WAVE, other.D_SHIFT]] = [pitch[n] for n in ("amplitude", "periods", "phase")]
    row[other.D_GAP] = (rig.effect(gear.name, "backlash") or {}).get("half_gap", 0.0)
    there = rig.effects.get(amplifier.name, {}) if amplifier else {}
    row[other.D_GAIN] = 1.0 + there.get("gain_error", {}).get("relative", 0.0)
    row[other.D_DEAD] = there.get("dead_zone", {}).get("half_width", 0.0)
    row[other.D_LIMIT] = there.get("saturation", {}).get("limit", math.inf)
    row[other.D_DELAY] = there.get("delay", {}).get("time", 0.0)
    return row


def _sensors(rig: Rig, net: _Net, errors: Errors) -> Floats:
    rows = np.zeros((len(rig.sensors), other.N_SENSOR))
    for row, (name, sensor) in zip(rows, rig.sensors.items(), strict=True):
        if sensor.quantity == "current":
            row[other.Y_INDEX] = 0
        elif sensor.of == net.base:
            row[other.Y_INDEX] = other.BASE_POSITION if sensor.quantity == "position" else other.BASE_VELOCITY
        else:
            first = 2 if sensor.quantity == "position" else 2 + len(net.names)
            row[other.Y_INDEX] = first + net.names.index(sensor.of)
        there = rig.effects.get(SENSOR_PREFIX + name, {})
        row[other.Y_GAIN] = 1.0 + there.get("gain_error", {}).get("relative", 0.0)
        row[other.Y_OFFSET] = there.get("offset", {}).get("offset", 0.0)
        row[other.Y_DELAY] = there.get("delay", {}).get("time", 0.0)
        row[other.Y_NOISE], row[other.Y_COUNT] = errors.noise.get(name, 0.0), errors.resolution.get(name, 0.0)
    return rows


def _unknown(unknown: Unknown | None, net: _Net, links: dict[str, int]) -> Floats:
    if unknown is None:
        return np.array([other.NO_UNKNOWN, -1.0, 0.0, 1.0])
    place = links.get(unknown.location, net.names.index(unknown.location) if unknown.location in net.names else -1)
    return np.array([UNKNOWNS[unknown.name], place, unknown.size, unknown.scale])


def simulate_other(
    rig: Rig, loop: Loop, sample_time_s: float, errors: Errors | None = None, unknown: Unknown | None = None
) -> Run:
    """Simulate a rig from rest by the concealing simulator; deterministic to the last bit.

    Raises
    ------
    UserError : the rig is not one that this simulator takes (:func:`check_concealable`).
    """
    check_concealable(rig)
    errors = errors or Errors()
    m = machine(rig, sample_time_s, errors, unknown)
    n, sensors, size = len(loop.reference), len(rig.sensors), 2 + 2 * len(m.inertia)
    memory = _at_rest(m)
    control = np.zeros(other.N_CONTROL)
    control[other.C_CLOSED], control[other.C_GAIN], control[other.C_LIMIT] = loop.closed, loop.gain, loop.limit
    control[other.C_FILTER] = -math.expm1(-loop.filter_rad_s * sample_time_s)
    control[other.C_INTEGRAL] = loop.integral * sample_time_s
    roles = np.array(_roles(rig) if loop.closed else (0, 0), dtype=np.int64)
    noise = np.zeros((n, sensors)) if errors.draws is None else errors.draws
    signals = Signals(loop.reference, loop.dither, loop.disturbance, noise, roles)
    late = float(m.sensor[:, other.Y_DELAY].max(initial=0.0))
    history = np.zeros((2 + math.ceil(late / sample_time_s * m.substeps + 1e-9), sensors))
    u, truth, seen, states = np.zeros(n), np.zeros((n, sensors)), np.zeros((n, sensors)), np.zeros((n, size))
    good = other.run_machine(m, memory, control, signals, history, u, truth, seen, states)
    columns = list(enumerate(rig.sensors))
    return Run(
        u, {name: truth[:, j] for j, name in columns}, {name: seen[:, j] for j, name in columns}, states,
        _bodies(rig).names, int(good),
    )  # fmt: skip


def _at_rest(m: Machine) -> Memory:
    nb, bristles = len(m.inertia), 2 * len(m.friction)
    n = 2 + 2 * nb
    return Memory(
        x=np.zeros(n), start=np.zeros(n), trial=np.zeros(n), total=np.zeros(n), rates=np.zeros(n), force=np.zeros(nb),
        bristle=np.zeros(bristles), bristle_start=np.zeros(bristles), yielding_start=np.zeros(2 * len(m.link)),
        scalar=np.zeros(other.N_SCALAR), control=np.zeros(3),
    )  # fmt: skip


def _roles(rig: Rig) -> tuple[int, int]:
    """The sensors of the loop: the motor's angle, and the position of the body farthest from the screw.

    Raises
    ------
    UserError : one of them is missing.
    """
    angle = output = -1
    order = list(rig.elements)
    for j, sensor in enumerate(rig.sensors.values()):
        kind = rig.elements[sensor.of].kind
        if sensor.quantity == "position" and kind == "rotor":
            angle = j
        elif sensor.quantity == "position" and kind == "mass":
            best = list(rig.sensors.values())[output] if output >= 0 else None
            if best is None or order.index(sensor.of) > order.index(best.of):
                output = j
    if angle < 0 or output < 0:
        allowed = "a closed loop needs a position sensor on the motor and one on a mass"
        raise UserError("rig.sensors", ", ".join(rig.sensors), allowed)
    return angle, output


def loop_sensors(rig: Rig) -> list[str]:
    """The sensors that the loop needs, in the rig's order: the motor's angle and the position of the farthest mass."""
    roles, names = _roles(rig), list(rig.sensors)
    return [names[j] for j in sorted(roles)]
